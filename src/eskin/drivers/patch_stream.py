"""This module holds the state of one patch's data: clock, scan numbers and rate."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Int

from eskin.drivers.clock_sync import DeviceClock, Doubt, ScanNumberWindow
from eskin.drivers.module_registry import AddressSlot
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

    def push(self, stamp: int) -> RateChange | None:
        """Count a scan that began at a time [ns]; return a change of `slow`, if any."""
        start = self.start
        if start is None or not 0 <= stamp - start < 2 * self.window:
            self.start, self.scans = stamp, 0
            return None
        self.scans += 1
        elapsed = stamp - start
        if elapsed < self.window:
            return None
        self.measured = self.scans * NS_PER_S / elapsed
        self.start, self.scans = stamp, 0
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
        newest_in_time: start of the newest scan that came in time [ns].
        used_period: latest period of which a scan was emitted.
        problem: problem of the clock that was reported.
    """

    def __init__(self, slot: AddressSlot, taxels: Int[np.ndarray, "part"]) -> None:
        """Start without data."""
        self.slot = slot
        self.taxels = index_taxels(taxels)
        self.clock = DeviceClock()
        self.rate_meter = ScanRateMeter()
        self.numbers = ScanNumberWindow()
        self.complete = ScanNumberWindow()
        self.partial: dict[int, PartialScan] = {}
        self.reboots = 0
        self.lost_reported = 0
        self.skipped: int | None = None
        self.clock_matched = False
        self.problem: Doubt | None = None
        self.newest: int | None = None
        self.period: int | None = None
        self.newest_in_time: int | None = None
        self.used_period = -1

    def restart(self) -> int:
        """Start over with another module; return the number of dropped packets."""
        packets = sum(scan.packets for scan in self.partial.values())
        self.partial.clear()
        self.clock = DeviceClock()
        self.rate_meter = ScanRateMeter()
        self.numbers.restart()
        self.complete.restart()
        self.reboots, self.clock_matched = 0, False
        self.newest = self.period = self.newest_in_time = self.skipped = None
        self.problem = None
        return packets

    def update_skipped(self, skipped: int) -> int:
        """Return the scans skipped since the last status, from those since power-up."""
        before, self.skipped = self.skipped, skipped
        return 0 if before is None else max(0, skipped - before)

    def clock_matches(self) -> bool:
        """Return whether the module's hello agrees with the clock of its data.

        A data packet identifies its sender by the address only; its clock shows whether
        that is still the module that sent the hello.
        """
        if self.reboots != self.clock.reboots:
            self.reboots, self.clock_matched = self.clock.reboots, False
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
