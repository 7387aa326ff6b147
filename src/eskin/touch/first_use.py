"""This module compiles and loads all code that finds touches before a person acts.

Whoever asks a person for touches calls `warm_up_touches` first, or `eskin.live.warm_up`
where they are recognised, so that no scan waits for the compiler.
"""

from collections.abc import Iterator

import numpy as np

from eskin.skin import MountedSkin
from eskin.touch.calibration import Calibration
from eskin.touch.pipeline import TouchPipeline
from eskin.touch.reading import Scan

PERIOD = 20_000_000
"""Time between the scans of a poke [ns]."""
UNTOUCHED = 40
"""Number of scans before a poke, enough for it to be felt."""
TOUCHED = 15
"""Number of scans during a poke."""
AFTER = 25
"""Number of scans after a poke, until its touch is over."""
PRESSED = 4
"""Number of taxels that a poke presses."""


def warm_up_touches(mounted: MountedSkin) -> None:
    """Load all compiled code that finds and measures touches, without a recogniser.

    Scans of a poke are processed, of a matrix behind a divider, whose readings need
    more code than those of other skins.
    """
    calibration = build_matrix_calibration(mounted)
    pipeline = TouchPipeline(mounted, calibration)
    for scan in make_poke(mounted):
        pipeline.push_scan(scan)
    calibration.compute_pressure(np.zeros(mounted.skin.count))


def build_matrix_calibration(mounted: MountedSkin) -> Calibration:
    """Build the calibration of a matrix of the skin's taxels behind a divider."""
    gain = np.full(mounted.skin.count, 0.1)
    return Calibration(gain, 4000, curve="divider", exponent=0.8, matrix=True)


def make_poke(mounted: MountedSkin) -> Iterator[Scan]:
    """Yield scans in which some taxels of the skin are pressed for a moment."""
    count = mounted.skin.count
    pressed = np.arange(count) < PRESSED
    received = np.ones(count, bool)
    q = np.zeros(len(mounted.robot.joint_names))
    shear = np.zeros((count, 2), np.int32) if mounted.skin.has_shear else None
    for number in range(UNTOUCHED + TOUCHED + AFTER):
        is_touched = UNTOUCHED <= number < UNTOUCHED + TOUCHED
        counts = np.where(pressed & is_touched, 300, 20).astype(np.int32)
        yield Scan(number * PERIOD, counts, received, q, shear)
