"""This module measures durations and sets how often threads take turns."""

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import final

import numpy as np

MIN_DURATION = 1e-6
"""Upper edge of the first bin [s]."""
BIN_RATIO = 1.02
"""Ratio of neighbouring bin edges: a quantile is at most 2 % too long."""
BINS = 1100
"""Number of bins; they reach 2,800 s, and longer durations count in the last."""
SWITCH_INTERVAL = 0.0005
"""Time after which Python switches threads [s]; its default of 5 ms is five readings
at 1 kHz."""


@final
class DurationHistogram:
    """Counts durations in logarithmic bins, which take 9 kB for any number of them.

    Attributes:
        count: number of durations.
        longest: the longest of them [s].
    """

    def __init__(self) -> None:
        """Create an empty histogram."""
        self.bins = np.zeros(BINS, np.int64)
        self.count = 0
        self.longest = 0.0

    def add(self, seconds: float) -> None:
        """Count a duration [s]; one below 1 us counts as 1 us."""
        ratio = max(seconds, MIN_DURATION) / MIN_DURATION
        index = math.ceil(math.log(ratio) / math.log(BIN_RATIO))
        self.bins[min(index, BINS - 1)] += 1
        self.count += 1
        self.longest = max(self.longest, seconds)

    def quantile(self, share: float) -> float:
        """Return a quantile of the durations [s]; 0 where there are none.

        Args:
            share: 0.5 for the median, 0.99 for the 99th percentile.
        """
        sums = np.cumsum(self.bins)
        if not sums[-1]:
            return 0.0
        index = int(np.searchsorted(sums, max(share * sums[-1], 1)))
        edge = MIN_DURATION * BIN_RATIO**index
        return min(edge, max(self.longest, MIN_DURATION))


@contextmanager
def short_switch_interval() -> Iterator[None]:
    """Let Python switch between threads sooner, inside a `with` block.

    It holds for the whole process, so programs choose it, not the library.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
