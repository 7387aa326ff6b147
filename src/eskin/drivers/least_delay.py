"""A device's time as the host's clock counts it, by the packets that came fastest."""

from itertools import combinations
from statistics import median
from typing import final

from eskin.units import NS_PER_S

BUCKET = NS_PER_S
"""How long arrivals compete for the least delay [ns]."""
BUCKETS = 10
"""How many such times are remembered."""
ENOUGH = 5
"""From how many of them drift is told."""
LEARN = 0.3
"""Part of a newly found drift that is believed."""
MOST_DRIFT = 0.01
"""The worst clock of a microcontroller, one without a crystal."""
JUMP = 50_000_000
"""A packet that is faster than any before by so much means that all before lay in some
buffer, or that the device's clock was set [ns]."""


@final
class LeastDelay:
    """Maps device time to host time; offset and drift follow the least delayed.

    Delays only ever make packets late, so the smallest arrival minus device time of a
    while is nearest to the truth. Only times in which the device was heard are
    remembered: after a pause of any length, packets that lay in a buffer keep their
    true spacing.

    Attributes:
        drift: what the device's clock loses against the host's, as a part of time.
    """

    def __init__(self, device: int, arrived: int) -> None:
        """Start with one packet, as if it was not delayed."""
        self.device = device
        self.arrived = arrived
        self.drift = 0.0
        self.least = 0.0
        self.restart(0, 0, arrived)

    def restart(self, elapsed: int, extra: int, arrived: int) -> None:
        """Forget all but one packet."""
        self.past: list[tuple[int, int]] = []
        self.best = (elapsed, extra)
        self.best_rest = extra - self.drift * elapsed
        self.bucket_end = arrived + BUCKET

    def push(self, device: int, arrived: int) -> int:
        """Host time of a device time [ns]; never later than the arrival.

        Args:
            device: unwrapped device time [us].
            arrived: when it was heard [ns].
        """
        elapsed = (device - self.device) * 1000
        extra = arrived - self.arrived - elapsed
        rest = extra - self.drift * elapsed
        if rest < self.least:
            if rest < self.least - JUMP:
                self.restart(elapsed, extra, arrived)
            self.least = rest
        if arrived >= self.bucket_end:
            self.close_bucket(elapsed, extra, arrived)
        elif rest < self.best_rest:
            self.best, self.best_rest = (elapsed, extra), rest
        return min(self.stamp(device), arrived)

    def stamp(self, device: int) -> int:
        """Host time of a device time [ns], by what was heard so far."""
        elapsed = (device - self.device) * 1000
        return self.arrived + elapsed + int((self.least + self.drift * elapsed) // 1)

    def close_bucket(self, elapsed: int, extra: int, arrived: int) -> None:
        """Remember the fastest packet of a while, follow the drift, begin another."""
        self.past = [*self.past, self.best][-BUCKETS:]
        if len(self.past) >= ENOUGH:
            slopes = [
                (y1 - y0) / (x1 - x0)
                for (x0, y0), (x1, y1) in combinations(self.past, 2)
                if x1 != x0
            ]
            found = min(max(median(slopes or [0.0]), -MOST_DRIFT), MOST_DRIFT)
            self.drift += LEARN * (found - self.drift)
        self.best = (elapsed, extra)
        self.best_rest = extra - self.drift * elapsed
        self.least = min(y - self.drift * x for x, y in [*self.past, self.best])
        self.bucket_end = arrived + BUCKET
