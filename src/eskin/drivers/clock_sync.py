"""This module maps a patch's clock and scan numbers to the host's clock."""

from itertools import combinations
from statistics import median
from typing import Literal, NamedTuple, final

from eskin.drivers.packet import DEVICE_TIME_SPAN, SCAN_NUMBER_SPAN
from eskin.units import NS_PER_S

BUCKET = NS_PER_S
"""Length of an interval, of which the least delayed packet is kept [ns]."""
BUCKETS = 10
"""Number of intervals that are kept."""
MIN_DRIFT_BUCKETS = 5
"""Smallest number of intervals from which drift is estimated."""
DRIFT_GAIN = 0.3
"""Weight of a new drift estimate."""
MAX_DRIFT = 0.01
"""Drift of the worst microcontroller clock, one without a crystal."""
JUMP = 50_000_000
"""A packet that is less delayed than all before by more than this shows that those lay
in a buffer, or that the device's clock was set [ns]."""

SCAN_WINDOW = 64
"""Number of scans that are tracked one by one."""
ALL_SEEN = (1 << SCAN_WINDOW) - 1

NS_PER_US = 1000
US_PER_S = 1_000_000
MAX_REORDERING = US_PER_S // 2
"""Largest delay of a packet relative to one that was sent later [us]."""
UNAMBIGUOUS = 5 * US_PER_S
"""Time over which scan numbers are unambiguous at any rate up to 6 kHz [us]; also the
largest time by which a device's clock may seem to outrun the host's, after a delay."""
MAX_SILENCE = 600 * NS_PER_S
"""Silence after which a clock starts over, less than half a wrap [ns]."""
MAX_EARLY = NS_PER_S // 20
"""Largest time by which a packet of the same clock may seem to arrive before it was
sent [ns]."""
MAX_LATE = NS_PER_S
"""Largest delay of a packet of the same clock [ns]."""
SETTLE_TIME = NS_PER_S // 10
"""How long a new clock is observed before it is accepted [ns]."""
SETTLE_SCANS = 3

Novelty = Literal["new", "again", "old"]


@final
class ClockOffsetEstimator:
    """Maps device time to host time; offset and drift follow the least delayed packets.

    A delay only ever makes a packet late, so the smallest difference of arrival and
    device time in an interval is the most accurate one. Only intervals in which the
    device sent are kept: after a pause of any length, packets that lay in a buffer keep
    their true spacing.

    Attributes:
        drift: rate at which the device's clock falls behind the host's [s/s].
    """

    def __init__(self, device: int, arrived: int) -> None:
        """Start with one packet, as if it was not delayed."""
        self.device = device
        self.arrived = arrived
        self.drift = 0.0
        self.min_residual = 0.0
        self.restart(0, 0, arrived)

    def restart(self, elapsed: int, offset: int, arrived: int) -> None:
        """Forget all but one packet."""
        self.past: list[tuple[int, int]] = []
        self.best = (elapsed, offset)
        self.best_residual = offset - self.drift * elapsed
        self.bucket_end = arrived + BUCKET

    def push(self, device: int, arrived: int) -> int:
        """Return the host time of a packet [ns], which is never after its arrival.

        Args:
            device: unwrapped device time [us].
            arrived: arrival by the host's clock [ns].
        """
        elapsed = (device - self.device) * NS_PER_US
        offset = arrived - self.arrived - elapsed
        residual = offset - self.drift * elapsed
        if residual < self.min_residual:
            if residual < self.min_residual - JUMP:
                self.restart(elapsed, offset, arrived)
            self.min_residual = residual
        if arrived >= self.bucket_end:
            self.close_bucket(elapsed, offset, arrived)
        elif residual < self.best_residual:
            self.best, self.best_residual = (elapsed, offset), residual
        return min(self.to_host(device), arrived)

    def to_host(self, device: int) -> int:
        """Return the host time of a device time [ns] by the current estimate."""
        elapsed = (device - self.device) * NS_PER_US
        delay = self.min_residual + self.drift * elapsed
        return self.arrived + elapsed + int(delay // 1)

    def close_bucket(self, elapsed: int, offset: int, arrived: int) -> None:
        """Keep the least delayed packet of an interval and update the drift."""
        self.past = [*self.past, self.best][-BUCKETS:]
        if len(self.past) >= MIN_DRIFT_BUCKETS:
            slopes = [
                (y1 - y0) / (x1 - x0)
                for (x0, y0), (x1, y1) in combinations(self.past, 2)
                if x1 != x0
            ]
            found = min(max(median(slopes or [0.0]), -MAX_DRIFT), MAX_DRIFT)
            self.drift += DRIFT_GAIN * (found - self.drift)
        self.best = (elapsed, offset)
        self.best_residual = offset - self.drift * elapsed
        self.min_residual = min(y - self.drift * x for x, y in [*self.past, self.best])
        self.bucket_end = arrived + BUCKET


@final
class ScanNumberWindow:
    """Tracks which of the latest scan numbers have arrived, in whatever order.

    Attributes:
        gone: how many numbers left the window without having arrived.
    """

    def __init__(self) -> None:
        """Start without numbers."""
        self.first = 0
        self.highest: int | None = None
        self.seen = ALL_SEEN
        self.gone = 0

    def add(self, number: int) -> Novelty:
        """Add an unwrapped number; return whether it is new, seen before or too old."""
        if self.highest is None:
            self.first = self.highest = number
            return "new"
        ahead = number - self.highest
        if ahead > 0:
            self.advance(ahead)
            self.highest = number
            return "new"
        if -ahead >= SCAN_WINDOW or number < self.first:
            return "old"
        bit = 1 << -ahead
        if self.seen & bit:
            return "again"
        self.seen |= bit
        return "new"

    def advance(self, ahead: int) -> None:
        """Move the window; unseen numbers that leave it are gone."""
        if ahead == 1:
            self.gone += not self.seen >> (SCAN_WINDOW - 1)
            self.seen = (self.seen << 1 | 1) & ALL_SEEN
            return
        leaving = self.seen >> max(SCAN_WINDOW - ahead, 0)
        self.gone += ahead - leaving.bit_count()
        self.seen = (self.seen << min(ahead, SCAN_WINDOW) | 1) & ALL_SEEN

    def __contains__(self, number: int) -> bool:
        """Return whether a number in the window has arrived."""
        if self.highest is None or number > self.highest:
            return False
        back = self.highest - number
        return back < SCAN_WINDOW and bool(self.seen >> back & 1)

    @property
    def lost(self) -> int:
        """How many numbers between the first and the highest have not arrived."""
        return self.gone + SCAN_WINDOW - self.seen.bit_count()

    def restart(self) -> None:
        """Start over at the next number; what was lost stays counted."""
        self.gone = self.lost
        self.highest, self.seen = None, ALL_SEEN


class ScanTime(NamedTuple):
    """A scan time identifies a scan and when it began."""

    number: int
    """Unwrapped number of the scan; goes on through reboots."""
    stamp: int
    """Start of the scan by the host's clock [ns]."""


@final
class ClockEpoch:
    """Follows a device's clock from one power-up to the next."""

    def __init__(self, device_time: int, scan: int, arrived: int) -> None:
        """Start with a packet."""
        self.device = device_time
        self.number = scan
        self.since = self.arrived = arrived
        self.scans = 1
        self.offset = ClockOffsetEstimator(device_time, arrived)

    def compute_step(
        self, device_time: int, scan: int, arrived: int
    ) -> tuple[int, int] | None:
        """Return time [us] and scans from the latest packet to this one.

        None if the packet cannot be of this clock: time and scan number have different
        signs, it is too old even for reordering, or it is ahead of the host's clock.
        """
        silence = arrived - self.arrived
        time = wrap_difference(device_time - self.device, DEVICE_TIME_SPAN)
        scans = wrap_difference(scan - self.number, SCAN_NUMBER_SPAN)
        if silence > MAX_SILENCE or time > silence // NS_PER_US + UNAMBIGUOUS:
            return None
        if time > UNAMBIGUOUS:
            return time, scans if scans > 0 else scans + SCAN_NUMBER_SPAN
        if scans > 0:
            return (time, scans) if time >= 0 else None
        if scans == 0:
            return (0, 0) if time == 0 else None
        behind = silence // NS_PER_US - time
        return (time, scans) if time < 0 and behind <= MAX_REORDERING else None

    def update(self, step: tuple[int, int], arrived: int) -> ScanTime:
        """Update the clock by a packet of it; return the packet's scan time."""
        time, scans = step
        device, number = self.device + time, self.number + scans
        if scans > 0:
            self.device, self.number, self.arrived = device, number, arrived
            self.scans += 1
        return ScanTime(number, self.offset.push(device, arrived))

    @property
    def is_settled(self) -> bool:
        """Whether the clock was observed for long enough to be accepted."""
        return self.scans >= SETTLE_SCANS and self.arrived - self.since >= SETTLE_TIME


@final
class DeviceClock:
    """Follows the clock of one patch through wraps, drift, delays and reboots.

    A packet that does not fit the clock is rejected. It starts another clock only when
    the packets that follow fit it and none fits the old one, so neither a packet with a
    long delay nor another module is mistaken for a reboot.

    Attributes:
        epoch: the clock that is accepted.
        reboots: how often it started over.
    """

    def __init__(self) -> None:
        """Start without a clock."""
        self.epoch: ClockEpoch | None = None
        self.candidate: ClockEpoch | None = None
        self.shift = 0
        self.reboots = 0

    def push(self, device_time: int, scan: int, arrived: int) -> ScanTime | None:
        """Return number and start of a packet's scan; None while they are not known.

        Args:
            device_time: device time in the packet [us], modulo 2**32.
            scan: scan number in the packet, modulo 2**16.
            arrived: arrival by the host's clock [ns].
        """
        epoch = self.epoch
        if epoch is not None:
            step = epoch.compute_step(device_time, scan, arrived)
            if step is not None:
                self.candidate = None
                number, stamp = epoch.update(step, arrived)
                return ScanTime(number + self.shift, stamp)
        self.update_candidate(device_time, scan, arrived)
        return None

    def push_echo(self, device_time: int, sent: int, received: int) -> None:
        """Note that the device's clock showed a time between two times of the host.

        Args:
            device_time: device time [us], modulo 2**32.
            sent: before it, by the host's clock [ns].
            received: after it, by the host's clock [ns].
        """

    def update_candidate(self, device_time: int, scan: int, arrived: int) -> None:
        """Let a packet that does not fit the clock start or continue another one."""
        other = self.candidate
        step = other and other.compute_step(device_time, scan, arrived)
        if other is None or step is None:
            self.candidate = ClockEpoch(device_time, scan, arrived)
            return
        other.update(step, arrived)
        if other.is_settled:
            if self.epoch is not None:
                self.shift += self.epoch.number - other.number
                self.reboots += 1
            self.epoch, self.candidate = other, None

    def matches(self, device_time: int, arrived: int) -> bool:
        """Return whether a packet fits the accepted clock; arguments as for `push`."""
        epoch = self.epoch
        if epoch is None:
            return False
        time = wrap_difference(device_time - epoch.device, DEVICE_TIME_SPAN)
        stamp = epoch.offset.to_host(epoch.device + time)
        return -MAX_EARLY <= arrived - stamp <= MAX_LATE

    @property
    def drift(self) -> float:
        """Rate at which the patch's clock falls behind the host's [s/s]."""
        return 0.0 if self.epoch is None else self.epoch.offset.drift


def wrap_difference(difference: int, span: int) -> int:
    """Wrap the difference of two counters to plus or minus half their span."""
    half = span >> 1
    return ((difference + half) & (span - 1)) - half
