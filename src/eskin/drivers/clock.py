"""The one clock that everything on this computer is timed by."""

import time
from abc import ABC, abstractmethod
from typing import final

from eskin.units import NS_PER_S


class Clock(ABC):
    """Tells the time, and never goes back."""

    @abstractmethod
    def now(self) -> int:
        """The time [ns since the epoch]."""

    @abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let some time pass [s]; none where it is not positive."""


@final
class HostClock(Clock):
    """This computer's: the date read once, then the monotonic clock.

    Nobody who sets the date moves it.
    """

    def __init__(self) -> None:
        """Read the date."""
        self.offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        """The time [ns since the epoch]."""
        return self.offset + time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        """Let some time pass [s]."""
        if seconds > 0:
            time.sleep(seconds)


@final
class ManualClock(Clock):
    """One that only goes on when it is told to: for tests, and faster than life."""

    def __init__(self, start: int = NS_PER_S) -> None:
        """Start at a time [ns since the epoch]."""
        self.time = start

    def now(self) -> int:
        """The time [ns since the epoch]."""
        return self.time

    def sleep(self, seconds: float) -> None:
        """Go on by some time [s], at once."""
        self.time += max(0, round(seconds * NS_PER_S))
