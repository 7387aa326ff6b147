"""Packets of single patches to scans of the whole skin."""

from math import inf
from typing import final

import numpy as np
from jaxtyping import Integer

from eskin.drivers.clock_sync import ScanTime
from eskin.drivers.events import EventLog
from eskin.drivers.module_registry import (
    AddressSlot,
    ModuleRegistry,
    PacketCounts,
    PacketOutcome,
)
from eskin.drivers.packet import Data, Hello, Packet, Status
from eskin.drivers.patch_stream import PatchStream, RateChange
from eskin.drivers.source import JointSource
from eskin.drivers.timeline import PeriodGrid, PeriodScans, ScanTimeline
from eskin.skin import Skin
from eskin.touch import Scan
from eskin.units import NS_PER_S

LOOK = NS_PER_S // 50
"""How often it is noticed who is gone [ns]."""


@final
class Assembler:
    """Puts every patch's scans on the skin's grid of periods and gives those out.

    No input, no output, no thread: packets and times come in, scans go out. What has
    not come by a period's deadline is not received; no data is given out twice.

    Attributes:
        roster: which module is at which address.
        feeds: what comes of each patch, by its address.
        fates: of all packets.
        timeline: the scans that are not yet given out; None before `start`.
        given: scans that were given out.
    """

    def __init__(self, skin: Skin, joints: JointSource, log: EventLog) -> None:
        """Start with no patch heard; `start` begins to give out scans."""
        self.skin = skin
        self.joints = joints
        self.log = log
        self.registry = ModuleRegistry(skin, log)
        self.streams = {
            address: PatchStream(seat, skin.taxels_of(seat.patch.id))
            for address, seat in self.registry.slots.items()
        }
        self.outcomes = PacketCounts()
        self.timeline: ScanTimeline | None = None
        self.given = 0
        self.looked = 0

    def start(self, now: int, rate: float, grace: float | None = None) -> None:
        """Give out scans from now on.

        Args:
            now: when the first period begins [ns].
            rate: of the skin's scans [1/s].
            grace: how long after its end a period waits for what is under way [s];
                half a period but at least 20 ms where None.
        """
        grid = PeriodGrid(now, rate, grace)
        self.timeline = ScanTimeline(grid, self.skin.count, self.streams, self.outcomes)

    def push(self, packet: Packet, arrived: int, port: str) -> None:
        """Take a packet in.

        Args:
            packet: it.
            arrived: when, by the host's clock [ns].
            port: or network address that it came from.
        """
        if isinstance(packet, Data):
            fate = self.take(packet, arrived, port)
        elif isinstance(packet, Hello):
            fate = self.handle_hello(packet, arrived, port)
        else:
            fate = self.note(packet, port)
        self.outcomes.add(fate)

    def greet(self, hello: Hello, arrived: int, port: str) -> PacketOutcome:
        """Hear a hello; its fate."""
        changed = self.registry.handle_hello(hello, arrived, port)
        if changed is not None:
            self.change(changed)
        feed = self.streams.get(hello.address)
        if feed is None or not feed.slot.fits(hello):
            return "foreign"
        if feed.slot.module is not None and feed.slot.port == port:
            feed.pace.promised = feed.slot.module.rate
        return "hello"

    def note(self, status: Status, port: str) -> PacketOutcome:
        """Hear how a patch fares; its fate."""
        feed = self.streams.get(status.address)
        if feed is None or feed.slot.port != port:
            return "foreign"
        skipped = feed.skip(status.skipped)
        if skipped:
            patch = feed.slot.patch.id
            self.log.count(
                "lost",
                f"scans of patch '{patch}' were left out by the patch itself, which "
                "had no time; lower its rate or use a faster line",
                skipped,
                patch,
            )
        return "status"

    def change(self, seat: AddressSlot) -> None:
        """Begin anew with another module at an address."""
        given_up = self.streams[seat.patch.address].restart()
        self.outcomes.move("incomplete", given_up)

    def take(self, data: Data, arrived: int, port: str) -> PacketOutcome:
        """Take data in; its fate so far."""
        feed = self.streams.get(data.address)
        if feed is None:
            self.registry.report_unknown_address(data.address, arrived, port)
            return "foreign"
        seat = feed.slot
        if port != seat.port:
            seat.note_rejected_data(arrived, port)
            return "foreign"
        size = len(data.counts)
        if size == 0 or data.first + size > seat.taxels:
            self.log.count(
                "damaged",
                f"packets hold taxels that patch '{seat.patch.id}' has not; check "
                "its address and firmware",
                patch=seat.patch.id,
            )
            return "damaged"
        clock = feed.clock
        known = clock.epoch is not None
        moment = clock.push(data.device_time, data.scan, arrived)
        if moment is None:
            return "late" if known else "held"
        seat.hear(arrived)
        if clock.reboots != feed.reboots:
            seat.say(arrived, "rebooted", "its clock began anew")
        if not feed.vouched or clock.reboots != feed.reboots:
            feed.vouch()
        if not feed.vouched or arrived < seat.hold_until or self.timeline is None:
            return "held"
        seat.believe(arrived)
        return self.sort(feed, data, moment, arrived)

    def sort(
        self, feed: PatchStream, data: Data, moment: ScanTime, arrived: int
    ) -> PacketOutcome:
        """Put believed data to its scan; its fate so far."""
        number = moment.number
        novelty = feed.numbers.take(number)
        if novelty == "old":
            return "late"
        if len(data.counts) == feed.slot.taxels:
            if novelty == "again":
                return "duplicate"
            return self.place(feed, moment, data.counts, 1, arrived)
        if novelty == "again" and number not in feed.parts:
            return "duplicate" if feed.complete.has(number) else "incomplete"
        part = feed.add_part(number, moment.stamp, data)
        if part is None:
            return "duplicate"
        if not part.have.all():
            self.outcomes.move("incomplete", feed.give_up(0))
            return "waiting"
        del feed.parts[number]
        feed.complete.take(number)
        fate = self.place(feed, moment, part.counts, part.packets, arrived)
        self.outcomes.move(fate, part.packets - 1)
        return fate

    def place(
        self,
        feed: PatchStream,
        moment: ScanTime,
        counts: Integer[np.ndarray, "part"],
        packets: int,
        arrived: int,
    ) -> PacketOutcome:
        """Put a complete scan to its period; the fate of its packets so far."""
        if self.timeline is None:
            return "held"
        change = feed.pace.push(moment.stamp)
        if change is not None:
            self.say_pace(feed, change, arrived)
        return self.timeline.place(
            feed, moment.number, moment.stamp, counts, packets, arrived
        )

    def say_pace(self, feed: PatchStream, change: RateChange, arrived: int) -> None:
        """Tell that a patch has become slow, or is no longer."""
        measured, promised = feed.pace.measured, feed.pace.promised
        text = f"{measured:.1f} of {promised} scans a second come"
        if change == "slow":
            text += "; check its power and how much its line can carry"
        feed.slot.say(arrived, change, text)

    def poll(self, now: int) -> list[Scan]:
        """Scans that are complete or due; all that arrived before `now` was pushed.

        Args:
            now: the time [ns].
        """
        if now - self.looked >= LOOK:
            self.looked = now
            for seat in self.registry.poll(now):
                self.change(seat)
            self.tell_lost(now)
        scans = [] if self.timeline is None else self.timeline.poll(now)
        return [self.finish(stamp, scan) for stamp, scan in scans]

    def finish(self, stamp: int, period: PeriodScans) -> Scan:
        """The scan of a period that is over."""
        self.given += 1
        for feed in self.streams.values():
            if feed.parts:
                self.drop_parts(feed, stamp)
        return Scan(stamp, period.counts, period.received, self.joints.q_at(stamp))

    def drop_parts(self, feed: PatchStream, before: int) -> None:
        """Give up scans of which parts are missing, and tell."""
        packets = feed.give_up(before)
        self.outcomes.move("incomplete", packets)
        if packets:
            patch = feed.slot.patch.id
            self.log.count(
                "lost",
                f"packets of patch '{patch}' are of scans that came only in part and "
                "do not count; check its line",
                packets,
                patch,
            )

    def tell_lost(self, now: int) -> None:
        """Count what is lost for good, and let the log say what is due."""
        for feed in self.streams.values():
            lost = feed.numbers.gone - feed.lost_said
            if lost:
                feed.lost_said += lost
                patch = feed.slot.patch.id
                self.log.count(
                    "lost",
                    f"scans of patch '{patch}' did not arrive; check its line",
                    lost,
                    patch,
                )
        self.log.poll(now)

    def due(self) -> int | None:
        """When the next scan is given out at the latest [ns]."""
        line = self.timeline
        return None if line is None else line.grid.deadline(line.next)

    def ages(self, now: int) -> dict[str, float]:
        """How old each patch's newest data is [s]; infinite where there is none."""
        return {
            feed.slot.patch.id: inf if fresh is None else (now - fresh) / NS_PER_S
            for feed in self.streams.values()
            for fresh in (feed.fresh,)
        }

    def skews(self) -> dict[str, float]:
        """How long after its reading's stamp each patch began its newest scan [s]."""
        grid = None if self.timeline is None else self.timeline.grid
        return {
            feed.slot.patch.id: (feed.newest - grid.start(feed.period)) / NS_PER_S
            for feed in self.streams.values()
            if grid and feed.newest is not None and feed.period is not None
        }

    def counters(self) -> dict[str, int]:
        """Readings given, packets by their fate, lost scans, skipped periods."""
        lost = sum(feed.numbers.lost for feed in self.streams.values())
        skipped = 0 if self.timeline is None else self.timeline.skipped
        counts = {"readings": self.given, "lost": lost, "skipped": skipped}
        return {**counts, **self.outcomes.counts}
