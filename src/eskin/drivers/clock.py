"""This module provides the host's clock, and estimates a device's clock by it.

Everything on this computer is timed by one clock. Offsets are host time minus device
time [ns], drift is their rate of change [s/s]: it is positive where the device's clock
is too slow. A delay that grows looks the same.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from itertools import combinations
from statistics import median
from typing import NamedTuple, final

from eskin.drivers.packet import DEVICE_TIME_SPAN
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


NS_PER_US = 1000

BUCKET = NS_PER_S
"""Length of an interval, of which the least delayed packet is kept [ns]."""
BUCKETS = 10
"""Number of intervals that are kept."""
MIN_DRIFT_BUCKETS = 5
"""Smallest number of intervals from which drift is estimated."""
DRIFT_GAIN = 0.3
"""Weight of a new drift estimate."""
JUMP = 50_000_000
"""A packet that is less delayed than all before by more than this shows that those lay
in a buffer, or that the device's clock was set [ns]."""

MAX_CLOCK_ERROR = 0.012
"""Error of the worst clock that sends echoes, one without a crystal: 1 % and some."""
MAX_GROWTH = 250e-6
"""Rise of the offset that is believed to be drift where no echo measures it. A growth
of 500 ppm is noticed before it adds 80 ms, and every crystal is twice as good."""
LATE = 40_000_000
"""Delay in excess of what is believed, from which a packet is late [ns]."""
LATE_END = LATE // 2
"""Excess up to which a packet shows that a delay is over [ns]."""
LATE_TIME = NS_PER_S // 2
"""How long all packets are late until their patch is [ns]."""
MAX_LATE_TIME = 600 * NS_PER_S
"""How long a patch may be late and still be believed when it is in time again [ns]."""

ECHOES = 32
"""Number of echoes from which the rate of a clock is bounded."""
ECHO_INTERVAL = NS_PER_S
"""Time between two of them [ns]."""
RATE_MARGIN = 300e-6
"""How much the rate of a clock may change while these echoes are kept."""


def wrap_difference(difference: int, span: int) -> int:
    """Wrap the difference of two counters to plus or minus half their span."""
    half = span >> 1
    return ((difference + half) & (span - 1)) - half


@final
class LateRun:
    """Notes for how long packets have been late without a break.

    Attributes:
        since: arrival of the first of them [ns]; None where the latest was in time.
    """

    def __init__(self) -> None:
        """Start in time."""
        self.since: int | None = None

    def check_late(self, late: bool, arrived: int) -> bool:
        """Add a packet; return whether packets have been late for long enough."""
        if not late:
            self.since = None
            return False
        self.since = arrived if self.since is None else self.since
        return arrived - self.since >= LATE_TIME


@final
class ClockOffsetEstimator:
    """Maps device time to host time; offset and drift follow the least delayed packets.

    A delay only ever makes a packet late, so the smallest difference of arrival and
    device time in an interval is the most accurate one. Only intervals in which the
    device sent are kept: after a pause of any length, packets that lay in a buffer keep
    their true spacing.

    No packet alone tells drift from a delay that grows. So the offset is bounded: from
    the least delayed packet on it may rise by the largest believed drift, no faster.
    Packets far above the bound teach nothing. When all packets are, for half a second,
    the patch is late, and the bound does not even rise by drift, until one is in time.

    Attributes:
        drift: rate at which the device's clock falls behind the host's [s/s].
        drift_range: smallest and largest drift that is believed.
        is_late: whether all packets are late.
        excess: delay of the latest packet beyond the bound [ns].
    """

    def __init__(self, device: int, arrived: int) -> None:
        """Start with one packet, as if it was not delayed."""
        self.device = device
        self.arrived = arrived
        self.drift = 0.0
        self.drift_range = (-MAX_CLOCK_ERROR, MAX_GROWTH)
        self.min_residual = 0.0
        self.bound = (0, 0)
        self.late_run = LateRun()
        self.is_late = False
        self.excess = 0.0
        self.restart(0, 0, arrived)

    def restart(self, elapsed: int, offset: int, arrived: int) -> None:
        """Forget all but one packet."""
        self.past: list[tuple[int, int]] = []
        self.best = (elapsed, offset)
        self.best_residual = offset - self.drift * elapsed
        self.bucket_end = arrived + BUCKET

    def estimate_host_time(self, device: int, arrived: int) -> int:
        """Return the host time of a packet [ns], which is never after its arrival.

        Args:
            device: unwrapped device time [us].
            arrived: arrival by the host's clock [ns].
        """
        elapsed = (device - self.device) * NS_PER_US
        offset = arrived - self.arrived - elapsed
        if self.update_bound(elapsed, offset, arrived):
            self.update_estimate(elapsed, offset, arrived)
        return min(self.to_host(device), arrived)

    def update_bound(self, elapsed: int, offset: int, arrived: int) -> bool:
        """Update the bound and `is_late`; return whether a packet is in time."""
        self.excess = offset - self.largest_offset(elapsed)
        if self.excess < 0:
            self.bound = (elapsed, offset)
        late = self.excess > (LATE_END if self.is_late else LATE)
        since = self.late_run.since
        late |= since is not None and arrived - since > MAX_LATE_TIME
        is_late = self.late_run.check_late(late, arrived)
        self.is_late = late and (self.is_late or is_late)
        return not late

    def largest_offset(self, elapsed: int) -> float:
        """Return the largest offset that is believed [ns]."""
        at, offset = self.bound
        growth = min(0.0, self.drift) if self.is_late else self.drift_range[1]
        return offset + growth * (elapsed - at)

    def update_estimate(self, elapsed: int, offset: int, arrived: int) -> None:
        """Update offset and drift by a packet that is in time."""
        residual = offset - self.drift * elapsed
        if residual < self.min_residual:
            if residual < self.min_residual - JUMP:
                self.restart(elapsed, offset, arrived)
            self.min_residual = residual
        if arrived >= self.bucket_end:
            self.close_bucket(elapsed, offset, arrived)
        elif residual < self.best_residual:
            self.best = (elapsed, offset)
            self.best_residual = residual

    def to_host(self, device: int) -> int:
        """Return the host time of a device time [ns] by the current estimate."""
        elapsed = (device - self.device) * NS_PER_US
        offset = self.min_residual + self.drift * elapsed
        return (
            self.arrived + elapsed + int(min(offset, self.largest_offset(elapsed)) // 1)
        )

    def close_bucket(self, elapsed: int, offset: int, arrived: int) -> None:
        """Keep the least delayed packet of an interval and update the drift."""
        self.past = [*self.past, self.best][-BUCKETS:]
        if len(self.past) >= MIN_DRIFT_BUCKETS:
            slopes = [
                (y1 - y0) / (x1 - x0)
                for (x0, y0), (x1, y1) in combinations(self.past, 2)
                if x1 != x0
            ]
            smallest, largest = self.drift_range
            found = min(max(median(slopes or [0.0]), smallest), largest)
            self.drift += DRIFT_GAIN * (found - self.drift)
        self.best = (elapsed, offset)
        self.best_residual = offset - self.drift * elapsed
        self.min_residual = min(y - self.drift * x for x, y in [*self.past, self.best])
        self.bucket_end = arrived + BUCKET


class EchoInterval(NamedTuple):
    """An echo bounds the offset of a device's clock at one time."""

    elapsed: int
    """Device time of the echo, since the first one [ns]."""
    low: float
    """Smallest possible offset [ns]."""
    high: float
    """Largest possible offset [ns]."""


@final
class EchoBounds:
    """Bounds the host time of device times by echoes of the host's requests.

    A device reads its clock between a request and the arrival of the echo. A delay, of
    the request or the echo, only widens this interval, so all echoes are true, and the
    tightest bounds count: each holds on, widened by what the drift may have been since.

    Attributes:
        drift_range: smallest and largest possible drift [s/s].
    """

    def __init__(self, device_time: int, sent: int, received: int) -> None:
        """Start with an echo; arguments as for `add_echo`."""
        self.device = device_time
        self.elapsed = 0
        self.restart(EchoInterval(0, sent, received))

    def restart(self, echo: EchoInterval) -> None:
        """Forget all but one echo."""
        self.latest = echo
        self.kept = deque([echo], ECHOES)
        self.drift_range = (-MAX_CLOCK_ERROR, MAX_CLOCK_ERROR)

    def add_echo(self, device_time: int, sent: int, received: int) -> None:
        """Add an echo.

        Args:
            device_time: device time in the echo [us], modulo 2**32.
            sent: when the request was sent by the host's clock [ns].
            received: when the echo arrived by the host's clock [ns].
        """
        elapsed = self.unwrap(device_time)
        low, high = self.bound_offset(elapsed)
        echo = EchoInterval(elapsed, sent - elapsed, received - elapsed)
        low, high = max(low, echo.low), min(high, echo.high)
        if low > high:
            self.restart(echo)
        elif elapsed <= self.latest.elapsed:
            return
        else:
            self.latest = EchoInterval(elapsed, low, high)
            self.update_drift()
        self.device = device_time
        self.elapsed = elapsed

    def update_drift(self) -> None:
        """Bound the drift between the latest bounds and those kept, and keep them."""
        latest = self.latest
        last = self.kept[-1]
        smallest = -MAX_CLOCK_ERROR
        largest = MAX_CLOCK_ERROR
        for echo in self.kept:
            passed = latest.elapsed - echo.elapsed
            if passed >= ECHO_INTERVAL:
                slowest = (latest.low - echo.high) / passed - RATE_MARGIN
                fastest = (latest.high - echo.low) / passed + RATE_MARGIN
                smallest = max(smallest, slowest)
                largest = min(largest, fastest)
        if smallest > largest:
            self.restart(latest)
            return
        self.drift_range = (smallest, largest)
        if latest.elapsed - last.elapsed >= ECHO_INTERVAL:
            self.kept.append(latest)
        elif latest.high - latest.low < last.high - last.low:
            self.kept[-1] = latest

    def unwrap(self, device_time: int) -> int:
        """Return a device time since the first echo [ns], near the latest one."""
        passed = wrap_difference(device_time - self.device, DEVICE_TIME_SPAN)
        return self.elapsed + passed * NS_PER_US

    def bound_offset(self, elapsed: int) -> tuple[float, float]:
        """Return the smallest and the largest possible offset [ns]."""
        smallest, largest = self.drift_range
        at, low, high = self.latest
        if elapsed < at:
            smallest, largest = largest, smallest
        passed = elapsed - at
        return low + smallest * passed, high + largest * passed

    def bound_host_time(self, device_time: int) -> tuple[int, int]:
        """Return the earliest and latest possible host time of a device time [ns]."""
        elapsed = self.unwrap(device_time)
        low, high = self.bound_offset(elapsed)
        return elapsed + int(low), elapsed + int(high)
