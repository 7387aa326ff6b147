"""This module maps a patch's clock and scan numbers to the host's clock."""

from itertools import combinations
from statistics import median
from typing import Literal, NamedTuple, final

from eskin.units import NS_PER_S

BUCKET = NS_PER_S
"""How long arrivals compete for the least delay [ns]."""
BUCKETS = 10
"""How many such times are remembered."""
ENOUGH = 5
"""From how many of them drift is told."""
LEARN = 0.3
"""PartialScan of a newly found drift that is believed."""
MOST_DRIFT = 0.01
"""The worst clock of a microcontroller, one without a crystal."""
JUMP = 50_000_000
"""A packet that is faster than any before by so much means that all before lay in some
buffer, or that the device's clock was set [ns]."""


@final
class ClockOffsetEstimator:
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


WINDOW = 64
"""Scans that are remembered one by one."""
ALL = (1 << WINDOW) - 1

Novelty = Literal["new", "again", "old"]


@final
class ScanNumberWindow:
    """Scan numbers as they are heard, in whatever order; a few are remembered.

    Attributes:
        gone: numbers that were passed over and will not count any more if they come.
    """

    def __init__(self) -> None:
        """Start without having heard any."""
        self.first = 0
        self.highest: int | None = None
        self.heard = ALL
        self.gone = 0

    def take(self, number: int) -> Novelty:
        """Whether an unwrapped number is new, heard before, or too old to say."""
        if self.highest is None:
            self.first = self.highest = number
            return "new"
        ahead = number - self.highest
        if ahead > 0:
            self.advance(ahead)
            self.highest = number
            return "new"
        if -ahead >= WINDOW or number < self.first:
            return "old"
        bit = 1 << -ahead
        if self.heard & bit:
            return "again"
        self.heard |= bit
        return "new"

    def advance(self, ahead: int) -> None:
        """Move the window on; what leaves it unheard is gone."""
        if ahead == 1:
            self.gone += not self.heard >> (WINDOW - 1)
            self.heard = (self.heard << 1 | 1) & ALL
            return
        leaving = self.heard >> max(WINDOW - ahead, 0)
        self.gone += ahead - leaving.bit_count()
        self.heard = (self.heard << min(ahead, WINDOW) | 1) & ALL

    def has(self, number: int) -> bool:
        """Whether a number was heard, as far as is remembered."""
        if self.highest is None or number > self.highest:
            return False
        back = self.highest - number
        return back < WINDOW and bool(self.heard >> back & 1)

    @property
    def lost(self) -> int:
        """Numbers between the first and the highest that were not heard."""
        return self.gone + WINDOW - self.heard.bit_count()

    def forget(self) -> None:
        """Begin anew at the next number; what was lost stays counted."""
        self.gone = self.lost
        self.highest, self.heard = None, ALL


US = 1000
"""One microsecond [ns]."""
SECOND_US = 1_000_000
TIME_SPAN = 1 << 32
SCAN_SPAN = 1 << 16
REORDERED = SECOND_US // 2
"""How much longer than a later packet one may be on its way [us]."""
SURE = 5 * SECOND_US
"""Over how long scan numbers are told apart at any rate up to 6 kHz [us]; also how much
further than the host's a device's clock may seem to have gone, after a delay."""
LONGEST = 600 * SECOND_US * US
"""After such a silence a clock begins anew: half a wrap is not yet over [ns]."""
EARLY = SECOND_US * US // 20
"""By how much a packet may seem to arrive before it was sent [ns]."""
DELAYED = SECOND_US * US
"""By how much a packet may be late that tells whose clock it is [ns]."""
SETTLE = SECOND_US * US // 10
"""How long a new clock is heard before it is believed [ns]."""
SETTLE_SCANS = 3


class ScanTime(NamedTuple):
    """Which scan, and when it began."""

    number: int
    """Of the scan, unwrapped; goes on through reboots."""
    stamp: int
    """When it began by the host's clock [ns]."""


@final
class ClockEpoch:
    """A device's clock from one power-up to the next."""

    def __init__(self, device_time: int, scan: int, arrived: int) -> None:
        """Begin with a packet."""
        self.device = device_time
        self.number = scan
        self.since = self.arrived = arrived
        self.scans = 1
        self.delay = ClockOffsetEstimator(device_time, arrived)

    def step(self, device_time: int, scan: int, arrived: int) -> tuple[int, int] | None:
        """How much later than the latest packet this one is: time [us] and scans.

        None where it cannot be of this clock: time and scan number do not go the same
        way, it is further behind than reordering explains, or ahead of its time.
        """
        silence = arrived - self.arrived
        time = wrapped(device_time - self.device, TIME_SPAN)
        scans = wrapped(scan - self.number, SCAN_SPAN)
        if silence > LONGEST or time > silence // US + SURE:
            return None
        if time > SURE:
            return time, scans if scans > 0 else scans + SCAN_SPAN
        if scans > 0:
            return (time, scans) if time >= 0 else None
        if scans == 0:
            return (0, 0) if time == 0 else None
        behind = silence // US - time
        return (time, scans) if time < 0 and behind <= REORDERED else None

    def take(self, step: tuple[int, int], arrived: int) -> ScanTime:
        """Which scan a packet of this clock is of, and when that began."""
        time, scans = step
        device, number = self.device + time, self.number + scans
        if scans > 0:
            self.device, self.number, self.arrived = device, number, arrived
            self.scans += 1
        return ScanTime(number, self.delay.push(device, arrived))

    @property
    def settled(self) -> bool:
        """Whether it was heard for long enough to be believed."""
        return self.scans >= SETTLE_SCANS and self.arrived - self.since >= SETTLE


@final
class DeviceClock:
    """The clock of one patch, through wraps, drift, delays and reboots.

    A packet that does not fit the clock is not believed, and begins another only when
    those that follow fit it and none fits the old one: so neither a packet that was
    lost for long nor another module is taken for a reboot.

    Attributes:
        epoch: the clock that is believed.
        reboots: how often it began anew.
    """

    def __init__(self) -> None:
        """Start without having heard the patch."""
        self.epoch: ClockEpoch | None = None
        self.candidate: ClockEpoch | None = None
        self.shift = 0
        self.reboots = 0

    def push(self, device_time: int, scan: int, arrived: int) -> ScanTime | None:
        """Which scan a packet is of, and when it began; None while that is not known.

        Args:
            device_time: as the packet says [us], modulo 2**32.
            scan: number as the packet says, modulo 2**16.
            arrived: when it was heard by the host's clock [ns].
        """
        epoch = self.epoch
        if epoch is not None:
            step = epoch.step(device_time, scan, arrived)
            if step is not None:
                self.candidate = None
                number, stamp = epoch.take(step, arrived)
                return ScanTime(number + self.shift, stamp)
        self.try_candidate(device_time, scan, arrived)
        return None

    def try_candidate(self, device_time: int, scan: int, arrived: int) -> None:
        """Let a packet that does not fit begin, or go on with, another clock."""
        other = self.candidate
        step = None if other is None else other.step(device_time, scan, arrived)
        if other is None or step is None:
            self.candidate = ClockEpoch(device_time, scan, arrived)
            return
        other.take(step, arrived)
        if other.settled:
            if self.epoch is not None:
                self.shift += self.epoch.number - other.number
                self.reboots += 1
            self.epoch, self.candidate = other, None

    def agrees(self, device_time: int, arrived: int) -> bool:
        """Whether a packet that arrived at some time is of the believed clock.

        Args:
            device_time: as the packet says [us], modulo 2**32.
            arrived: when it was heard by the host's clock [ns].
        """
        epoch = self.epoch
        if epoch is None:
            return False
        device = epoch.device + wrapped(device_time - epoch.device, TIME_SPAN)
        return -EARLY <= arrived - epoch.delay.stamp(device) <= DELAYED

    @property
    def drift(self) -> float:
        """What the patch's clock loses against the host's, as a part of time."""
        return 0.0 if self.epoch is None else self.epoch.delay.drift


def wrapped(difference: int, span: int) -> int:
    """The difference of two counters that wrap, between minus and plus half a wrap."""
    half = span >> 1
    return ((difference + half) & (span - 1)) - half
