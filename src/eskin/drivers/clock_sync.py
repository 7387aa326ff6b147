"""This module maps a patch's clock and scan numbers to the host's clock."""

from typing import Literal, NamedTuple, final

from eskin.drivers.clock import (
    NS_PER_US,
    ClockOffsetEstimator,
    EchoBounds,
    LateRun,
    wrap_difference,
)
from eskin.drivers.packet import DEVICE_TIME_SPAN, SCAN_NUMBER_SPAN
from eskin.units import NS_PER_S

# Numbers of scans.
SCAN_WINDOW = 64
"""Number of scans that are tracked one by one."""
ALL_SEEN = (1 << SCAN_WINDOW) - 1

# Times by which a clock is told from another.
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

# Age of packets of a patch with echoes.
MAX_UNCERTAINTY = NS_PER_S // 20
"""How much later than at the earliest possible time a packet of a patch with echoes may
be believed to be made [ns]: so much older than it seems it may be at most."""
MAX_AGE = NS_PER_S // 10
"""Age on arrival from which a packet of a patch with echoes is late [ns]."""

# Memory of packets.
DIGEST_BITS = 1 << 22
"""Number of digests of which a memory of packets keeps two sets."""
MAX_DIGESTS = DIGEST_BITS // 4
"""Number of packets in each: nearly six hours at 50 a second."""

Novelty = Literal["new", "again", "old"]
Doubt = Literal["late", "untimed", "replayed"]
"""Why the data of a patch is not believed. `late`: all of it arrives late; `untimed`:
echoes do not tell its age; `replayed`: it was received before."""


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

    def add_scan_number(self, number: int) -> Novelty:
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
        """Return how many numbers from the first to the highest have not arrived."""
        return self.gone + SCAN_WINDOW - self.seen.bit_count()

    def restart(self) -> None:
        """Start over at the next number; what was lost stays counted."""
        self.gone = self.lost
        self.highest = None
        self.seen = ALL_SEEN


class ScanTime(NamedTuple):
    """A scan time identifies a scan and when it began."""

    number: int
    """Unwrapped number of the scan; goes on through reboots."""
    stamp: int
    """Start of the scan by the host's clock [ns]."""


@final
class ClockEpoch:
    """Follows a device's clock from one power-up to the next.

    Attributes:
        known: how many of its packets were received before it.
    """

    def __init__(self, device_time: int, scan: int, arrived: int) -> None:
        """Start with a packet."""
        self.device = device_time
        self.number = scan
        self.since = self.arrived = arrived
        self.scans = self.packets = 1
        self.known = 0
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
        self.packets += 1
        device = self.device + time
        number = self.number + scans
        if scans > 0:
            self.device = device
            self.number = number
            self.arrived = arrived
            self.scans += 1
        return ScanTime(number, self.offset.estimate_host_time(device, arrived))

    @property
    def is_settled(self) -> bool:
        """Return whether the clock was observed for long enough to be accepted."""
        return self.scans >= SETTLE_SCANS and self.arrived - self.since >= SETTLE_TIME

    @property
    def is_replay(self) -> bool:
        """Return whether most of its packets were received before."""
        return 2 * self.known >= self.packets


@final
class PacketMemory:
    """Remembers which packets were received, so that a replay of them is recognised.

    It keeps one bit a packet, and so takes one in some packets for a known one.
    """

    def __init__(self) -> None:
        """Start without packets."""
        self.recent = bytearray(DIGEST_BITS // 8)
        self.former: bytearray | None = None
        self.count = 0

    def add_packet(self, device_time: int, scan: int, content: int) -> bool:
        """Add a packet; return whether it was there already."""
        digest = hash((device_time, scan, content)) % DIGEST_BITS
        place = digest >> 3
        bit = 1 << (digest & 7)
        former = self.former
        known = self.recent[place] & bit or (former and former[place] & bit)
        if not self.recent[place] & bit:
            self.recent[place] |= bit
            self.count += 1
        if self.count >= MAX_DIGESTS:
            self.former = self.recent
            self.recent = bytearray(DIGEST_BITS // 8)
            self.count = 0
        return bool(known)


@final
class DeviceClock:
    """Follows the clock of one patch through wraps, drift, delays and reboots.

    A packet that does not fit the clock is rejected. It starts another clock only when
    the packets that follow fit it and none fits the old one, so neither a packet with a
    long delay nor another module is mistaken for a reboot. Nor is a replay: most of its
    packets were received before.

    Once echoes arrive, they alone say how old data may be, and data whose age they do
    not tell is not believed. Without them a delay that was there from the start is not
    noticed, nor one that grows as slowly as clocks drift.

    Attributes:
        epoch: the clock that is accepted.
        reboots: how often it started over.
        echoes: bounds by echoes; None before the first.
        expects_echoes: whether data is believed only with echoes.
        doubt: why the latest packet must not be used; None where it may.
        problem: what has been wrong with all packets for a while; None where nothing.
        lag: age of the latest packet when it arrived [ns].
    """

    def __init__(self, expects_echoes: bool = False) -> None:
        """Start without a clock."""
        self.epoch: ClockEpoch | None = None
        self.candidate: ClockEpoch | None = None
        self.memory = PacketMemory()
        self.shift = 0
        self.reboots = 0
        self.echoes: EchoBounds | None = None
        self.expects_echoes = expects_echoes
        self.late_run = LateRun()
        self.doubt: Doubt | None = None
        self.problem: Doubt | None = None
        self.lag = 0

    def find_scan_time(
        self, device_time: int, scan: int, arrived: int, content: int = 0
    ) -> ScanTime | None:
        """Return number and start of a packet's scan; None while they are not known.

        Args:
            device_time: device time in the packet [us], modulo 2**32.
            scan: scan number in the packet, modulo 2**16.
            arrived: arrival by the host's clock [ns].
            content: digest of what else is in the packet, to recognise a replay.
        """
        known = self.memory.add_packet(device_time, scan, content)
        epoch = self.epoch
        if epoch is not None:
            step = epoch.compute_step(device_time, scan, arrived)
            if step is not None:
                self.candidate = None
                number, stamp = epoch.update(step, arrived)
                stamp = self.time_packet(epoch, device_time, stamp, arrived)
                return ScanTime(number + self.shift, stamp)
        self.update_candidate(device_time, scan, arrived, known)
        return None

    def push_echo(self, device_time: int, sent: int, received: int) -> None:
        """Add an echo: the device read its clock between a request and its arrival.

        Args:
            device_time: device time in the echo [us], modulo 2**32.
            sent: when the request was sent by the host's clock [ns].
            received: when the echo arrived by the host's clock [ns].
        """
        self.expects_echoes = True
        if self.echoes is None:
            self.echoes = EchoBounds(device_time, sent, received)
        else:
            self.echoes.add_echo(device_time, sent, received)
        if self.epoch is not None:
            self.epoch.offset.drift_range = self.echoes.drift_range

    def time_packet(
        self, epoch: ClockEpoch, device_time: int, stamp: int, arrived: int
    ) -> int:
        """Update `doubt` and `problem` by a packet; return when its scan began [ns]."""
        if self.expects_echoes:
            bounds = self.bound_host_time(device_time, arrived)
            self.doubt = "untimed" if bounds is None else None
            low, high = bounds or (stamp, stamp)
            stamp = min(max(stamp, low), high, arrived)
            self.lag = arrived - stamp
            wrong = self.doubt is not None or self.lag > MAX_AGE
            if not wrong:
                self.problem = None
            if self.late_run.check_late(wrong, arrived):
                vague = high - low >= MAX_UNCERTAINTY
                self.problem = self.doubt or ("untimed" if vague else "late")
        else:
            self.lag = arrived - stamp
            self.doubt = self.problem = "late" if epoch.offset.is_late else None
        return stamp

    def bound_host_time(self, device_time: int, arrived: int) -> tuple[int, int] | None:
        """Return the earliest and latest time at which a packet is believed made [ns].

        None without echoes, or if by them it was made after it arrived.
        """
        if self.echoes is None:
            return None
        low, high = self.echoes.bound_host_time(device_time)
        if low > arrived + MAX_EARLY:
            return None
        return low, min(high, low + MAX_UNCERTAINTY)

    def update_candidate(
        self, device_time: int, scan: int, arrived: int, known: bool
    ) -> None:
        """Let a packet that does not fit the clock start or continue another one."""
        other = self.candidate
        step = other and other.compute_step(device_time, scan, arrived)
        if other is None or step is None:
            self.candidate = ClockEpoch(device_time, scan, arrived)
            self.candidate.known = int(known)
            return
        other.update(step, arrived)
        other.known += known
        if not other.is_settled:
            return
        if self.epoch is not None:
            if other.is_replay:
                self.doubt = self.problem = "replayed"
                return
            if self.expects_echoes and not self.is_recent(device_time, arrived):
                return
            self.shift += self.epoch.number - other.number
            self.reboots += 1
        if self.echoes is not None:
            other.offset.drift_range = self.echoes.drift_range
        self.epoch = other
        self.candidate = None
        self.doubt = self.problem = None

    def is_recent(self, device_time: int, arrived: int) -> bool:
        """Return whether echoes tell that a packet was made shortly before it came."""
        bounds = self.bound_host_time(device_time, arrived)
        return bounds is not None and arrived - bounds[1] <= MAX_LATE

    def matches(self, device_time: int, arrived: int) -> bool:
        """Return whether a packet fits the accepted clock.

        The arguments are as for `find_scan_time`.
        """
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
