"""This module provides the one clock that everything on this computer is timed by."""

import time
from abc import ABC, abstractmethod
from typing import final

from eskin.units import NS_PER_S


class Clock(ABC):
    """Tells the time and never goes back."""

    @abstractmethod
    def now(self) -> int:
        """Return the time [ns since the epoch]."""

    @abstractmethod
    def sleep(self, seconds: float) -> None:
        """Wait [s]; return at once where the time is not positive."""


@final
class HostClock(Clock):
    """Reads the date once and then follows the monotonic clock of this computer.

    Setting the date does not move it.
    """

    def __init__(self) -> None:
        """Read the date."""
        self.offset = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        """Return the time [ns since the epoch]."""
        return self.offset + time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        """Wait [s]."""
        if seconds > 0:
            time.sleep(seconds)


@final
class ManualClock(Clock):
    """Advances only on `sleep`: for tests, and for running faster than real time."""

    def __init__(self, start: int = NS_PER_S) -> None:
        """Start at a time [ns since the epoch]."""
        self.time = start

    def now(self) -> int:
        """Return the time [ns since the epoch]."""
        return self.time

    def sleep(self, seconds: float) -> None:
        """Advance by some time [s], at once."""
        self.time += max(0, round(seconds * NS_PER_S))
