"""Presses of a small skin, and a page that stands for that of a person who presses."""

from itertools import groupby

import numpy as np

from eskin.calibration.fingertip import press_taxels
from eskin.recording import Metadata, RecordingWriter, write_all
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from helpers.touch import build_grid_skin

SKIN = build_grid_skin(8, 8, patches=2)
MOUNTED = MountedSkin(SKIN, load_robot("table"))
CALIBRATION = Calibration.uniform(SKIN.count, 4095, 400.0)
PERIOD = 50_000_000
RATE = 20
REST = 200
PRESS_SCANS = 12


def press_counts(taxel, force=4.0, offset=0.003, gain=1.0, width=0):
    """Return counts above rest of a fingertip on a taxel, or of a hand of a width."""
    tip = press_taxels(force, np.array([160e-6]), np.full((1, 2), offset), 0.01)[0]
    rows, columns = (each - each[taxel] for each in (SKIN.rows, SKIN.columns))
    reach = np.maximum(abs(rows), abs(columns))
    own = SKIN.patch_index == SKIN.patch_index[taxel]
    shown = tip[(rows + 2) % 5, (columns + 2) % 5] if not width else 20.0
    pressure = np.where(own & (reach <= (width or 2)), shown, 0.0)
    return np.round(pressure / (gain * CALIBRATION.gain[0])).astype(int)


def rest(scans):
    """Return counts above rest of some scans without touch."""
    return [np.zeros(SKIN.count, int)] * scans


def press(taxel, **options):
    """Return the counts of a press on a taxel, and of a pause after it."""
    return [press_counts(taxel, **options)] * PRESS_SCANS + rest(12)


def make_scans(above, noise=1.0, seed=0, stuck=()):
    """Yield noisy scans with some counts above rest; some taxels are stuck."""
    rng = np.random.default_rng(seed)
    for number, counts in enumerate(above):
        total = REST + np.round(noise * rng.standard_normal(SKIN.count)) + counts
        total[list(stuck)] = 1000
        received = np.ones(SKIN.count, bool)
        yield Scan(PERIOD * (number + 1), total.astype(np.int32), received, np.zeros(0))


def record(path, scans):
    """Write a recording of scans of the skin on a table, and return its path."""
    metadata = Metadata("test", "nobody", "one")
    with RecordingWriter(path, "table", SKIN, CALIBRATION, metadata) as writer:
        write_all(writer, scans, [])
    return path


def act_during_next_press(guide, action, scans):
    """Push scans, and skip or withdraw in the press that follows the first one."""
    acted = False
    for scan in scans:
        guide.push(scan)
        if guide.is_pressed and guide.presses and not acted:
            getattr(guide, action)()
            acted = True
    assert acted


class RememberedPage:
    """A page that stores what it is given, opened by its browser at some scan.

    Args:
        act: function called with the page and each board, as a person's clicks.
        skipped: place that is skipped at first.
        opened_at: number of scans before the page is opened.
    """

    def __init__(self, act=None, skipped=None, opened_at=0):
        self.act = act
        self.skipped = skipped
        self.opened_at = opened_at
        self.asked = 0
        self.repeated = None
        self.clicks = 0
        self.lines = []
        self.boards = []

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
