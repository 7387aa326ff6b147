"""How many scans a second really come from a patch."""

from typing import Literal, final

from eskin.units import NS_PER_S

LEAST_SCANS = 10
"""Fewer tell no rate."""
ENOUGH = 0.8
"""Part of the promised rate below which a patch is slow."""

Change = Literal["slow", "on_rate"]


@final
class Pace:
    """Counts scans by their own stamps, so that delays do not matter.

    Attributes:
        promised: scans a second that the patch means to make; 0 where it does not say.
        measured: scans a second that came lately; 0 while that is not known.
        slow: whether too few came.
    """

    def __init__(self) -> None:
        """Start without having heard any."""
        self.promised = 0
        self.measured = 0.0
        self.slow = False
        self.start: int | None = None
        self.scans = 0

    @property
    def rate(self) -> float:
        """What to expect [1/s]: as promised, else as measured."""
        return float(self.promised or self.measured)

    @property
    def window(self) -> int:
        """How long scans are counted for [ns]."""
        promised = self.promised or NS_PER_S
        return max(NS_PER_S, LEAST_SCANS * NS_PER_S // promised)

    def push(self, stamp: int) -> Change | None:
        """Count a scan that began at a time [ns]; what has changed, if anything."""
        start = self.start
        if start is None or not 0 <= stamp - start < 2 * self.window:
            self.start, self.scans = stamp, 0
            return None
        self.scans += 1
        elapsed = stamp - start
        if elapsed < self.window:
            return None
        self.measured = self.scans * NS_PER_S / elapsed
        self.start, self.scans = stamp, 0
        slow = self.measured < ENOUGH * self.promised
        if slow == self.slow:
            return None
        self.slow = slow
        return "slow" if slow else "on_rate"
