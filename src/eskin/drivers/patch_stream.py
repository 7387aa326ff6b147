"""This module holds the state of one patch's data: clock, scan numbers, parts and rate."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Int

from eskin.drivers.clock_sync import DeviceClock, ScanNumberWindow
from eskin.drivers.module_registry import AddressSlot
from eskin.drivers.packet import Data
from eskin.units import NS_PER_S

LEAST_SCANS = 10
"""Fewer tell no rate."""
ENOUGH = 0.8
"""PartialScan of the promised rate below which a patch is slow."""

RateChange = Literal["slow", "on_rate"]


@final
class ScanRateMeter:
    """Counts scans by their own stamps, so that delays do not matter.

    Attributes:
        promised: scans a second that the patch means to make; 0 where it does not say.
        measured: scans a second that came lately; 0 while that is not known.
        slow: whether too few came.
    """

    def __init__(self) -> None:
        """Start without having heard any."""
        self.promised = 0
        self.measured = 0.0
        self.slow = False
        self.start: int | None = None
        self.scans = 0

    @property
    def rate(self) -> float:
        """What to expect [1/s]: as promised, else as measured."""
        return float(self.promised or self.measured)

    @property
    def window(self) -> int:
        """How long scans are counted for [ns]."""
        promised = self.promised or NS_PER_S
        return max(NS_PER_S, LEAST_SCANS * NS_PER_S // promised)

    def push(self, stamp: int) -> RateChange | None:
        """Count a scan that began at a time [ns]; what has changed, if anything."""
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
        slow = self.measured < ENOUGH * self.promised
        if slow == self.slow:
            return None
        self.slow = slow
        return "slow" if slow else "on_rate"


MAX_PARTIAL_SCANS = 4
"""Scans of which only parts have come; more are given up."""


@dataclass(eq=False)
class PartialScan:
    """A scan of which some packets have come."""

    stamp: int
    """When it began [ns]."""
    counts: Int[np.ndarray, "part"]
    """Of the patch's taxels."""
    have: Bool[np.ndarray, "part"]
    """Which of them have come."""
    packets: int
    """How many."""


@final
class PatchStream:
    """State of one patch's data; `Assembler` decides what is done with it.

    Attributes:
        vouched: whether a hello of the believed module agrees with the clock.
        newest: when the newest complete scan began [ns].
        period: that this scan belongs to.
        fresh: when the newest scan began that came in time [ns].
        used_period: the latest period of which a scan was given out.
    """

    def __init__(self, seat: AddressSlot, taxels: Int[np.ndarray, "part"]) -> None:
        """Start without data."""
        self.slot = seat
        whole = np.arange(taxels[0], taxels[0] + len(taxels)) if len(taxels) else taxels
        self.taxels = (
            slice(int(taxels[0]), int(taxels[-1]) + 1)
            if len(taxels) and np.array_equal(whole, taxels)
            else taxels
        )
        self.clock = DeviceClock()
        self.pace = ScanRateMeter()
        self.numbers = ScanNumberWindow()
        self.complete = ScanNumberWindow()
        self.parts: dict[int, PartialScan] = {}
        self.reboots = 0
        self.lost_said = 0
        self.skipped: int | None = None
        self.vouched = False
        self.newest: int | None = None
        self.period: int | None = None
        self.fresh: int | None = None
        self.used_period = -1

    def restart(self) -> int:
        """Begin anew with another module; packets of scans that are given up."""
        packets = sum(part.packets for part in self.parts.values())
        self.parts.clear()
        self.clock = DeviceClock()
        self.pace = ScanRateMeter()
        self.numbers.forget()
        self.complete.forget()
        self.reboots, self.vouched = 0, False
        self.newest = self.period = self.fresh = self.skipped = None
        return packets

    def skip(self, skipped: int) -> int:
        """How many scans the patch has left out since it was last asked.

        Args:
            skipped: by its status, since power-up; it begins anew with the patch.
        """
        before, self.skipped = self.skipped, skipped
        return 0 if before is None else max(0, skipped - before)

    def vouch(self) -> bool:
        """Whether the believed module's hello is of the clock that its data has.

        Data says by its address alone who sent it; its clock says whether that is still
        the module whose hello was heard.
        """
        if self.reboots != self.clock.reboots:
            self.reboots, self.vouched = self.clock.reboots, False
        holder = self.slot.module
        if not self.vouched and holder is not None:
            self.vouched = self.clock.agrees(holder.device_time, holder.greeted)
        return self.vouched

    def add_part(self, number: int, stamp: int, data: Data) -> PartialScan | None:
        """Put a packet to its scan; None where it was there already."""
        part = self.parts.get(number)
        if part is None:
            size = self.slot.taxels
            part = PartialScan(stamp, np.zeros(size, np.int32), np.zeros(size, bool), 0)
            self.parts[number] = part
        place = slice(data.first, data.first + len(data.counts))
        if part.have[place].all():
            return None
        part.counts[place] = data.counts
        part.have[place] = True
        part.packets += 1
        return part

    def give_up(self, before: int) -> int:
        """Packets of scans that began before a time [ns], or are too many."""
        packets = 0
        while self.parts:
            number = min(self.parts)
            part = self.parts[number]
            if part.stamp >= before and len(self.parts) <= MAX_PARTIAL_SCANS:
                break
            packets += part.packets
            del self.parts[number]
        return packets
