"""Rows of the table: what is wrong with the sensor, build by build."""

from collections.abc import Callable
from typing import Literal

from benchmarks.attacks.skin_faults import FaultySkin, build_target
from eskin.sim.interactive import InteractiveSkin
from eskin.touch import Scan

BuildKind = Literal["fresh", "shifted"]

KINDS: tuple[BuildKind, ...] = ("fresh", "shifted")
FAULTS = ("0.2 % noisy, sigma 9", "1 % noisy, sigma 9", "telegraph, 0.2 %")
ROWS = (*KINDS, *FAULTS)
"""Names of the rows; the first is that without flaw, which others are compared to."""


def build_row_skin(
    row: str, seed: int
) -> tuple[InteractiveSkin, Callable[[Scan], Scan]]:
    """Build the skin of a row, and what corrupts its scans."""
    if row == "shifted":
        return InteractiveSkin("ur5", seed, "shifted"), lambda scan: scan
    live = InteractiveSkin("ur5", seed)
    if row == "fresh":
        return live, lambda scan: scan
    target = build_target(live.mounted.skin, live.calibration, seed)
    return live, FaultySkin(row, target).corrupt
