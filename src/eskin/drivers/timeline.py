"""This module puts the scans of all patches on the skin's grid of periods.

It also holds the state of each patch's data: clock, scan numbers and rate.
"""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Int, Integer

from eskin.drivers.clock_sync import DeviceClock, Doubt, ScanNumberWindow, ScanTime
from eskin.drivers.module_registry import AddressSlot, PacketCounts, PacketOutcome
from eskin.drivers.packet import Data
from eskin.units import NS_PER_S

MIN_RATE_SCANS = 10
"""Smallest number of scans from which a rate is measured."""
SLOW_RATE = 0.8
"""Fraction of the nominal rate below which a patch is slow."""
MAX_PARTIAL_SCANS = 4
"""Largest number of incomplete scans; more are dropped."""

RateChange = Literal["slow", "on_rate"]


@final
class ScanRateMeter:
    """Measures the scan rate of a patch by the scans' stamps, so delays have no effect.

    Attributes:
        nominal: nominal scan rate [1/s]; 0 where it is not known.
        measured: measured scan rate [1/s]; 0 while it is not known.
        slow: whether the measured rate is too low.
    """

    def __init__(self) -> None:
        """Start without scans."""
        self.nominal = 0
        self.measured = 0.0
        self.slow = False
        self.start: int | None = None
        self.scans = 0

    @property
    def rate(self) -> float:
        """The rate to expect [1/s]: the nominal one, else the measured one."""
        return float(self.nominal or self.measured)

    @property
    def window(self) -> int:
        """Duration over which scans are counted [ns]."""
        nominal = self.nominal or NS_PER_S
        return max(NS_PER_S, MIN_RATE_SCANS * NS_PER_S // nominal)

    def count_scan(self, stamp: int) -> RateChange | None:
        """Count a scan that began at a time [ns]; return a change of `slow`, if any."""
        start = self.start
        if start is None or not 0 <= stamp - start < 2 * self.window:
            self.start = stamp
            self.scans = 0
            return None
        self.scans += 1
        elapsed = stamp - start
        if elapsed < self.window:
            return None
        self.measured = self.scans * NS_PER_S / elapsed
        self.start = stamp
        self.scans = 0
        slow = self.measured < SLOW_RATE * self.nominal
        if slow == self.slow:
            return None
        self.slow = slow
        return "slow" if slow else "on_rate"


@dataclass(eq=False)
class PartialScan:
    """A scan of which some packets have arrived."""

    stamp: int
    """Start of the scan [ns]."""
    counts: Int[np.ndarray, "part"]
    """Counts of the patch's taxels."""
    received: Bool[np.ndarray, "part"]
    """Which of them have arrived."""
    packets: int
    """Number of packets that have arrived."""


@final
class PatchStream:
    """Holds the state of one patch's data, on which `Assembler` decides.

    Attributes:
        numbers: numbers of the scans of which any packet has arrived.
        complete: numbers of the scans that have arrived in several packets.
        clock_matched: whether a hello of the module agrees with the clock.
        newest: start of the newest complete scan [ns].
        period: period that this scan belongs to.
        used_period: latest period of which a scan was emitted.
        problem: problem of the clock that was reported.
    """

    def __init__(self, slot: AddressSlot, taxels: Int[np.ndarray, "part"]) -> None:
        """Start without data."""
        self.slot = slot
        self.taxels = index_taxels(taxels)
        self.numbers = ScanNumberWindow()
        self.complete = ScanNumberWindow()
        self.partial: dict[int, PartialScan] = {}
        self.lost_reported = 0
        self.used_period = -1
        self.restart()

    def restart(self) -> int:
        """Start over with another module; return the number of dropped packets."""
        packets = sum(scan.packets for scan in self.partial.values())
        self.partial.clear()
        self.clock = DeviceClock()
        self.rate_meter = ScanRateMeter()
        self.numbers.restart()
        self.complete.restart()
        self.reboots = 0
        self.clock_matched = False
        self.skipped: int | None = None
        self.newest: int | None = None
        self.period: int | None = None
        self.problem: Doubt | None = None
        return packets

    def update_skipped(self, skipped: int) -> int:
        """Return the scans skipped since the last status, from those since power-up."""
        previous = self.skipped
        self.skipped = skipped
        return 0 if previous is None else max(0, skipped - previous)

    def clock_matches(self) -> bool:
        """Return whether the module's hello agrees with the clock of its data.

        A data packet identifies its sender by the address only; its clock shows whether
        that is still the module that sent the hello.
        """
        if self.reboots != self.clock.reboots:
            self.reboots = self.clock.reboots
            self.clock_matched = False
        module = self.slot.module
        if not self.clock_matched and module is not None:
            self.clock_matched = self.clock.matches(module.device_time, module.hello_at)
        return self.clock_matched

    def add_part(self, number: int, stamp: int, data: Data) -> PartialScan | None:
        """Add a packet to its scan; return the scan, or None for a duplicate."""
        scan = self.partial.get(number)
        if scan is None:
            size = self.slot.taxels
            scan = PartialScan(stamp, np.zeros(size, np.int32), np.zeros(size, bool), 0)
            self.partial[number] = scan
        place = slice(data.first, data.first + len(data.counts))
        if scan.received[place].all():
            return None
        scan.counts[place] = data.counts
        scan.received[place] = True
        scan.packets += 1
        return scan

    def drop_partial(self, before: int) -> int:
        """Drop partial scans before a time [ns], and too many; return their packets."""
        packets = 0
        while self.partial:
            number = min(self.partial)
            scan = self.partial[number]
            if scan.stamp >= before and len(self.partial) <= MAX_PARTIAL_SCANS:
                break
            packets += scan.packets
            del self.partial[number]
        return packets


def index_taxels(taxels: Int[np.ndarray, "part"]) -> slice | Int[np.ndarray, "part"]:
    """Return a fast index of a patch's taxels: a slice where they are consecutive."""
    if len(taxels) and (np.diff(taxels) == 1).all():
        return slice(int(taxels[0]), int(taxels[-1]) + 1)
    return taxels


MIN_GRACE = 20_000_000
"""Shortest default wait for late packets after the end of a period [ns]: USB serial
chips hold bytes back for up to 16 ms, and a busy computer as long."""
STALL_GRACE = 100_000_000
"""Wait after the end of a period while nothing arrives at all [ns]: what comes after so
long is not fresh any more."""
BURST_SPREAD = 10_000_000
"""Time in which the packets of all patches arrive after nothing has arrived [ns]."""
RATE_TOLERANCE = 0.2
"""Relative difference to the skin's rate up to which a patch keeps its phase."""
MAX_DELAY = NS_PER_S // 2
"""How late scans may be emitted after a stall [ns]; older periods are skipped."""


@final
class PeriodGrid:
    """Divides time into periods of equal length from a start.

    Attributes:
        period: length [ns].
        grace: wait for late packets after the end of a period [ns].
    """

    def __init__(self, start: int, rate: float, grace: float | None = None) -> None:
        """Start at a time [ns]; rate [1/s] and grace [s] as for `Assembler.start`."""
        self.origin = start
        self.rate = rate
        self.period = round(NS_PER_S / rate)
        default = max(self.period // 2, MIN_GRACE)
        self.grace = default if grace is None else round(grace * NS_PER_S)

    def start(self, k: int) -> int:
        """Return when a period begins [ns]."""
        return self.origin + k * self.period

    def deadline(self, k: int) -> int:
        """Return the time by which a period is emitted while others arrive [ns]."""
        return self.start(k + 1) + self.grace

    def stall_deadline(self, k: int) -> int:
        """Return the time by which a period is emitted where nothing arrives [ns]."""
        return self.start(k + 1) + max(self.grace, STALL_GRACE)

    def find(self, stamp: int) -> int:
        """Return the period that contains a time [ns]."""
        return (stamp - self.origin) // self.period

    def is_near(self, k: int, stamp: int) -> bool:
        """Return whether a time is within 0.75 periods of a period's middle."""
        slack = self.period // 4
        return -slack <= stamp - self.start(k) <= self.period + slack

    def matches_rate(self, rate: float) -> bool:
        """Return whether a patch of that rate gives about one scan a period."""
        return abs(rate - self.rate) <= RATE_TOLERANCE * self.rate


@final
class PeriodScans:
    """Collects the scans of all patches that belong to one period.

    Attributes:
        began: arrival of the first scan [ns].
        counts: counts of the whole skin.
        received: which of them have arrived.
        scans: scan number and number of packets, by the patch's address.
    """

    def __init__(self, taxels: int, began: int = 0) -> None:
        """Start without scans."""
        self.began = began
        self.counts = np.zeros(taxels, np.int32)
        self.received = np.zeros(taxels, bool)
        self.scans: dict[int, tuple[int, int]] = {}


@final
class ScanTimeline:
    """Waits for the scans of each period and emits each period once.

    A patch that is missing while others go on is waited for until the period's
    deadline. While nothing arrives at all, as when the line or a sender stalls, a
    period waits for as long as its data would be fresh: what then comes in one burst is
    all emitted, in order.

    Attributes:
        pending: periods of which scans have arrived, by their number.
        next_period: number of the period that is emitted next.
        skipped: periods that were never emitted, since `poll` was called too late.
    """

    def __init__(
        self,
        grid: PeriodGrid,
        taxels: int,
        streams: dict[int, PatchStream],
        outcomes: PacketCounts,
    ) -> None:
        """Start at the grid's first period, for patches by their addresses."""
        self.grid = grid
        self.taxels = taxels
        self.streams = streams
        self.outcomes = outcomes
        self.pending: dict[int, PeriodScans] = {}
        self.next_period = 0
        self.skipped = 0

    def place(
        self,
        stream: PatchStream,
        scan_time: ScanTime,
        counts: Integer[np.ndarray, "part"],
        packets: int,
        arrived: int,
    ) -> PacketOutcome:
        """Place a complete scan in its period; return its packets' outcome so far."""
        number, stamp = scan_time
        k = self.find_period(stream, stamp)
        if k < self.next_period:
            return "superseded" if k == stream.used_period else "late"
        if arrived - self.grid.deadline(k) > MAX_DELAY:
            return "late"
        period = self.pending.get(k)
        if period is None:
            period = self.pending[k] = PeriodScans(self.taxels, arrived)
        address = stream.slot.patch.address
        previous, others = period.scans.get(address, (number, 0))
        if previous > number:
            return "superseded"
        self.outcomes.settle("superseded", others)
        period.scans[address] = (number, packets)
        period.counts[stream.taxels] = counts
        period.received[stream.taxels] = True
        return "waiting"

    def find_period(self, stream: PatchStream, stamp: int) -> int:
        """Return the period that a scan of a patch belongs to.

        A patch of about the skin's rate keeps its phase until it is 0.75 periods off,
        so that jitter does not put two scans in one period and none in the next.
        """
        grid = self.grid
        k = grid.find(stamp)
        if stream.newest is not None and stream.period is not None:
            passed = (stamp - stream.newest + grid.period // 2) // grid.period
            same = stream.period + passed
            if grid.is_near(same, stamp) and grid.matches_rate(stream.rate_meter.rate):
                k = same
        if stream.newest is None or stamp > stream.newest:
            stream.newest = stamp
            stream.period = k
        return k

    def poll(self, now: int) -> list[tuple[int, PeriodScans]]:
        """Return stamps and scans of the periods that are complete or due."""
        grid = self.grid
        ready = []
        if now - grid.deadline(self.next_period) > MAX_DELAY:
            self.skip_to(grid.find(now - MAX_DELAY - grid.grace))
        while now >= grid.start(k := self.next_period) and (
            now >= self.next_deadline() or self.is_complete(k)
        ):
            ready.append((grid.start(k), self.pop_next()))
        return ready

    def next_deadline(self) -> int:
        """Return by when the next period is emitted, if nothing more arrives [ns]."""
        grid = self.grid
        k = self.next_period
        deadline = grid.deadline(k)
        later = [scans.began for j, scans in self.pending.items() if j > k]
        if later:
            return max(deadline, min(later) + BURST_SPREAD)
        if any(self.is_awaited(stream, k) for stream in self.streams.values()):
            return grid.stall_deadline(k)
        return deadline

    def is_complete(self, k: int) -> bool:
        """Return whether every connected patch has delivered its scan of a period."""
        period = self.pending.get(k)
        if period is None:
            return False
        return all(
            address in period.scans or not self.is_awaited(stream, k)
            for address, stream in self.streams.items()
        )

    def is_awaited(self, stream: PatchStream, k: int) -> bool:
        """Return whether a patch is likely to deliver another scan in a period."""
        slot = stream.slot
        if slot.port is None or slot.silent or stream.newest is None:
            return False
        rate = stream.rate_meter.rate
        interval = NS_PER_S / rate if rate else self.grid.period
        return stream.newest + 0.75 * interval < self.grid.start(k + 1)

    def pop_next(self) -> PeriodScans:
        """Return the scans of the next period and move on."""
        k = self.next_period
        self.next_period += 1
        period = self.pending.pop(k, None) or PeriodScans(self.taxels)
        for address, (_, packets) in period.scans.items():
            self.outcomes.settle("used", packets)
            self.streams[address].used_period = k
        return period

    def skip_to(self, k: int) -> None:
        """Skip the periods before one, for which `poll` was called too late."""
        for old in [old for old in self.pending if old < k]:
            for _, packets in self.pending.pop(old).scans.values():
                self.outcomes.settle("late", packets)
        self.skipped += k - self.next_period
        self.next_period = k
