"""This module measures durations and sets how often threads take turns."""

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import final

import numpy as np

LEAST = 1e-6
"""Duration below which all are alike [s]."""
RATIO = 1.02
"""Of one bin's edge to the last: a quantile is at most 2 % too long."""
BINS = 1100
"""Up to 2,800 s; what is longer lies in the last."""


@final
class DurationHistogram:
    """Counts durations in bins that grow with them; 9 kB, however many there are.

    Attributes:
        count: how many there were.
        longest: of them [s].
    """

    def __init__(self) -> None:
        """Start with none."""
        self.bins = np.zeros(BINS, np.int64)
        self.count = 0
        self.longest = 0.0

    def add(self, seconds: float) -> None:
        """Count one [s]; one below 1 us counts as that."""
        place = math.log(max(seconds, LEAST) / LEAST) / math.log(RATIO)
        self.bins[min(math.ceil(place), BINS - 1)] += 1
        self.count += 1
        self.longest = max(self.longest, seconds)

    def quantile(self, share: float) -> float:
        """The duration that a share of them does not pass [s]; 0 where there are none.

        Args:
            share: 0.5 for the median, 0.99 for all but the longest hundredth.
        """
        sums = np.cumsum(self.bins)
        if not sums[-1]:
            return 0.0
        place = int(np.searchsorted(sums, max(share * sums[-1], 1)))
        return min(LEAST * RATIO**place, max(self.longest, LEAST))


TURN = 0.0005
"""Python gives a thread 5 ms before another may go on: at 1 kHz, five readings [s]."""


@contextmanager
def short_switch_interval() -> Iterator[None]:
    """Let threads of this process take turns sooner; as before at the end.

    It holds for the whole process, so programs choose it, not the library.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
