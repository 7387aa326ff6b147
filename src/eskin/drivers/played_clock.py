"""The time in what is played."""

import math
from typing import final

from eskin.drivers.clock import Clock
from eskin.units import NS_PER_S


@final
class PlayedClock(Clock):
    """Tells the time in a recording that is played, at any pace.

    It stands at the first stamp until playing begins. A scan's age by it is the same
    as if the scan were taken now.
    """

    def __init__(self, host: Clock, pace: float, start: int | None) -> None:
        """Wait for the first scan.

        Args:
            host: the clock that playing is timed by.
            pace: seconds played in a second; infinite goes from stamp to stamp.
            start: time at which playing begins [ns since the epoch]; None: the host's.
        """
        self.host = host
        self.pace = pace
        self.start = start
        self.began: int | None = None
        self.reached = 0

    def begin(self) -> int:
        """Go from now on, unless it goes already; returns the time it began at."""
        if self.start is None:
            self.start = self.host.now()
        if self.began is None:
            self.reached, self.began = self.start, self.host.now()
        return self.start

    def reach(self, stamp: int) -> None:
        """Note the latest stamp given [ns since the epoch]."""
        self.reached = stamp

    def now(self) -> int:
        """The time in what is played [ns since the epoch]."""
        if self.start is None:
            return self.host.now()
        if self.began is None:
            return self.start
        if math.isinf(self.pace):
            return self.reached
        return self.start + round((self.host.now() - self.began) * self.pace)

    def until(self, stamp: int) -> float:
        """How long until that stamp is due, by the host's clock [s]."""
        return (stamp - self.now()) / NS_PER_S / self.pace

    def sleep(self, seconds: float) -> None:
        """Let some time of what is played pass [s]."""
        self.host.sleep(seconds / self.pace)
