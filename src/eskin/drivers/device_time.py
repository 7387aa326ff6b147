"""A patch's clock and scan numbers, unwrapped and mapped to the host's clock."""

from typing import NamedTuple, final

from eskin.drivers.least_delay import LeastDelay

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
class Epoch:
    """A device's clock from one power-up to the next."""

    def __init__(self, device_time: int, scan: int, arrived: int) -> None:
        """Begin with a packet."""
        self.device = device_time
        self.number = scan
        self.since = self.arrived = arrived
        self.scans = 1
        self.delay = LeastDelay(device_time, arrived)

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
class DeviceTime:
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
        self.epoch: Epoch | None = None
        self.candidate: Epoch | None = None
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
            self.candidate = Epoch(device_time, scan, arrived)
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
