"""The grid of times that a skin's scans are put on."""

from typing import final

import numpy as np

from eskin.units import NS_PER_S

LEAST_GRACE = 20_000_000
"""How long after its end a period waits at least for what is under way [ns]: USB serial
chips hold bytes back for up to 16 ms, and a busy computer as long."""
SAME_PACE = 0.2
"""By what part a patch's rate may differ from the skin's to keep its phase."""


@final
class Grid:
    """Periods of equal length, counted from a start.

    Attributes:
        period: length [ns].
        grace: how long after its end a period waits [ns].
    """

    def __init__(self, start: int, rate: float, grace: float | None = None) -> None:
        """Start at a time [ns], with a rate [1/s] and a grace [s]; half a period."""
        self.origin = start
        self.rate = rate
        self.period = round(NS_PER_S / rate)
        half = max(self.period // 2, LEAST_GRACE)
        self.grace = half if grace is None else round(grace * NS_PER_S)

    def start(self, k: int) -> int:
        """When a period begins [ns]."""
        return self.origin + k * self.period

    def deadline(self, k: int) -> int:
        """When it is given out at the latest [ns]."""
        return self.start(k + 1) + self.grace

    def at(self, stamp: int) -> int:
        """The period that a time [ns] lies in."""
        return (stamp - self.origin) // self.period

    def beside(self, k: int, stamp: int) -> bool:
        """Whether a time is within 0.75 periods of the middle of a period."""
        slack = self.period // 4
        return -slack <= stamp - self.start(k) <= self.period + slack

    def keeps_pace(self, rate: float) -> bool:
        """Whether a patch of that rate gives about one scan a period."""
        return abs(rate - self.rate) <= SAME_PACE * self.rate


@final
class PeriodScans:
    """The scans of all patches that belong to one period, while it is waited for.

    Attributes:
        counts: of the whole skin.
        received: which of them are there.
        scans: number of the scan and of its packets, by the patch's address.
    """

    def __init__(self, taxels: int) -> None:
        """Start without any."""
        self.counts = np.zeros(taxels, np.int32)
        self.received = np.zeros(taxels, bool)
        self.scans: dict[int, tuple[int, int]] = {}
