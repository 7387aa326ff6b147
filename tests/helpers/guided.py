"""A page that stands for the one in the browser of a person who is guided."""

from itertools import groupby


class RememberedPage:
    """A page that stores what it is given, opened by its browser at some scan.

    Args:
        act: function called with the page and each board, as a person's clicks.
        skipped: place that is skipped at first.
        opened_at: number of scans before the page is opened.
    """

    def __init__(self, act=None, skipped=None, opened_at=0):
        self.act, self.skipped, self.opened_at = act, skipped, opened_at
        self.asked, self.repeated, self.clicks = 0, None, 0
        self.lines, self.boards = [], []

    @property
    def is_opened(self):
        self.asked += 1
        return self.asked > self.opened_at

    def wants(self):
        return True

    def tell(self, line):
        self.lines.append(line)

    def show(self, state, board):
        self.boards.append(board)
        if self.act is not None:
            self.act(self, board)

    def list_places(self):
        """Return the names of the places that were marked, each once in turn."""
        names = [board.place.name for board in self.boards if board.place is not None]
        return [name for name, _ in groupby(names)]
