"""Which scans of a patch were heard: twice, too late, or never."""

from typing import Literal, final

WINDOW = 64
"""Scans that are remembered one by one."""
ALL = (1 << WINDOW) - 1

Novelty = Literal["new", "again", "old"]


@final
class ScanNumbers:
    """Scan numbers as they are heard, in whatever order; a few are remembered.

    Attributes:
        gone: numbers that were passed over and will not count any more if they come.
    """

    def __init__(self) -> None:
        """Start without having heard any."""
        self.first = 0
        self.highest: int | None = None
        self.heard = ALL
        self.gone = 0

    def take(self, number: int) -> Novelty:
        """Whether an unwrapped number is new, heard before, or too old to say."""
        if self.highest is None:
            self.first = self.highest = number
            return "new"
        ahead = number - self.highest
        if ahead > 0:
            self.advance(ahead)
            self.highest = number
            return "new"
        if -ahead >= WINDOW or number < self.first:
            return "old"
        bit = 1 << -ahead
        if self.heard & bit:
            return "again"
        self.heard |= bit
        return "new"

    def advance(self, ahead: int) -> None:
        """Move the window on; what leaves it unheard is gone."""
        if ahead == 1:
            self.gone += not self.heard >> (WINDOW - 1)
            self.heard = (self.heard << 1 | 1) & ALL
            return
        leaving = self.heard >> max(WINDOW - ahead, 0)
        self.gone += ahead - leaving.bit_count()
        self.heard = (self.heard << min(ahead, WINDOW) | 1) & ALL

    def has(self, number: int) -> bool:
        """Whether a number was heard, as far as is remembered."""
        if self.highest is None or number > self.highest:
            return False
        back = self.highest - number
        return back < WINDOW and bool(self.heard >> back & 1)

    @property
    def lost(self) -> int:
        """Numbers between the first and the highest that were not heard."""
        return self.gone + WINDOW - self.heard.bit_count()

    def forget(self) -> None:
        """Begin anew at the next number; what was lost stays counted."""
        self.gone = self.lost
        self.highest, self.heard = None, ALL
