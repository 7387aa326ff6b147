"""This module puts the scans of all patches on the skin's grid of periods."""

from typing import final

import numpy as np
from jaxtyping import Integer

from eskin.drivers.module_registry import PacketCounts, PacketOutcome
from eskin.drivers.patch_stream import PatchStream
from eskin.units import NS_PER_S

LEAST_GRACE = 20_000_000
"""How long after its end a period waits at least for what is under way [ns]: USB serial
chips hold bytes back for up to 16 ms, and a busy computer as long."""
SAME_PACE = 0.2
"""By what part a patch's rate may differ from the skin's to keep its phase."""


@final
class PeriodGrid:
    """Periods of equal length, counted from a start.

    Attributes:
        period: length [ns].
        grace: how long after its end a period waits [ns].
    """

    def __init__(self, start: int, rate: float, grace: float | None = None) -> None:
        """Start at a time [ns], with a rate [1/s] and a grace [s]; half a period."""
        self.origin = start
        self.rate = rate
        self.period = round(NS_PER_S / rate)
        half = max(self.period // 2, LEAST_GRACE)
        self.grace = half if grace is None else round(grace * NS_PER_S)

    def start(self, k: int) -> int:
        """When a period begins [ns]."""
        return self.origin + k * self.period

    def deadline(self, k: int) -> int:
        """When it is given out at the latest [ns]."""
        return self.start(k + 1) + self.grace

    def at(self, stamp: int) -> int:
        """The period that a time [ns] lies in."""
        return (stamp - self.origin) // self.period

    def beside(self, k: int, stamp: int) -> bool:
        """Whether a time is within 0.75 periods of the middle of a period."""
        slack = self.period // 4
        return -slack <= stamp - self.start(k) <= self.period + slack

    def keeps_pace(self, rate: float) -> bool:
        """Whether a patch of that rate gives about one scan a period."""
        return abs(rate - self.rate) <= SAME_PACE * self.rate


@final
class PeriodScans:
    """The scans of all patches that belong to one period, while it is waited for.

    Attributes:
        counts: of the whole skin.
        received: which of them are there.
        scans: number of the scan and of its packets, by the patch's address.
    """

    def __init__(self, taxels: int) -> None:
        """Start without any."""
        self.counts = np.zeros(taxels, np.int32)
        self.received = np.zeros(taxels, bool)
        self.scans: dict[int, tuple[int, int]] = {}


BEHIND = NS_PER_S // 2
"""How far readings may be given out late after a stall; older periods are skipped."""


@final
class ScanTimeline:
    """Waits for each period's scans, and gives it out once.

    Attributes:
        grid: the periods.
        fates: of the packets.
        skipped: periods that were never given out, since nobody asked in time.
        next: the period that is given out next.
    """

    def __init__(
        self,
        grid: PeriodGrid,
        taxels: int,
        feeds: dict[int, PatchStream],
        fates: PacketCounts,
    ) -> None:
        """Start at the grid's first period, for patches by their addresses."""
        self.grid = grid
        self.taxels = taxels
        self.streams = feeds
        self.outcomes = fates
        self.pending: dict[int, PeriodScans] = {}
        self.next = 0
        self.skipped = 0

    def place(
        self,
        feed: PatchStream,
        number: int,
        stamp: int,
        counts: Integer[np.ndarray, "part"],
        packets: int,
        arrived: int,
    ) -> PacketOutcome:
        """Put a complete scan to its period; the fate of its packets so far.

        Args:
            feed: of its patch.
            number: of the scan.
            stamp: when it began [ns].
            counts: of the patch's taxels.
            packets: that it came in.
            arrived: when the last of them came [ns].
        """
        k = self.period_of(feed, stamp)
        if k < self.next:
            return "superseded" if k == feed.used_period else "late"
        if arrived - self.grid.deadline(k) > BEHIND:
            return "late"
        period = self.pending.get(k)
        if period is None:
            period = self.pending[k] = PeriodScans(self.taxels)
        address = feed.slot.patch.address
        before, others = period.scans.get(address, (number, 0))
        if before > number:
            return "superseded"
        self.outcomes.move("superseded", others)
        period.scans[address] = (number, packets)
        period.counts[feed.taxels] = counts
        period.received[feed.taxels] = True
        feed.fresh = max(stamp, feed.fresh or 0)
        return "waiting"

    def period_of(self, feed: PatchStream, stamp: int) -> int:
        """The period that a scan of a patch belongs to.

        A patch of about the skin's rate keeps its phase until it is 0.75 periods off,
        so that jitter does not put two scans in one period and none in the next.
        """
        grid = self.grid
        k = grid.at(stamp)
        if feed.newest is not None and feed.period is not None:
            passed = (stamp - feed.newest + grid.period // 2) // grid.period
            same = feed.period + passed
            if grid.beside(same, stamp) and grid.keeps_pace(feed.pace.rate):
                k = same
        if feed.newest is None or stamp > feed.newest:
            feed.newest, feed.period = stamp, k
        return k

    def poll(self, now: int) -> list[tuple[int, PeriodScans]]:
        """Stamps and scans of the periods that are complete or due."""
        grid, given = self.grid, []
        if now - grid.deadline(self.next) > BEHIND:
            self.skip_to(grid.at(now - BEHIND - grid.grace))
        while now >= grid.start(self.next) and (
            now >= grid.deadline(self.next) or self.is_complete(self.next)
        ):
            given.append((grid.start(self.next), self.give()))
        return given

    def is_complete(self, k: int) -> bool:
        """Whether every patch that is there has delivered its scan of a period."""
        period = self.pending.get(k)
        if period is None:
            return False
        return all(
            address in period.scans or not self.is_awaited(feed, k)
            for address, feed in self.streams.items()
        )

    def is_awaited(self, feed: PatchStream, k: int) -> bool:
        """Whether a patch is there and its next scan is likely to fall in a period."""
        seat = feed.slot
        if seat.port is None or seat.silent or feed.newest is None:
            return False
        interval = NS_PER_S / feed.pace.rate if feed.pace.rate else self.grid.period
        return feed.newest + 0.75 * interval < self.grid.start(k + 1)

    def give(self) -> PeriodScans:
        """The scans of the next period."""
        k = self.next
        self.next += 1
        period = self.pending.pop(k, None) or PeriodScans(self.taxels)
        for address, (_, packets) in period.scans.items():
            self.outcomes.move("used", packets)
            self.streams[address].used_period = k
        return period

    def skip_to(self, k: int) -> None:
        """Go on with a later period; nobody was there to take those before."""
        for old in [old for old in self.pending if old < k]:
            for _, packets in self.pending.pop(old).scans.values():
                self.outcomes.move("late", packets)
        self.skipped += k - self.next
        self.next = k
