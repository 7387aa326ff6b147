"""This module assembles packets of single patches into scans of the whole skin."""

import zlib
from typing import final

import numpy as np
from jaxtyping import Integer

from eskin.drivers.clock import NS_PER_US
from eskin.drivers.clock_sync import Doubt, ScanTime
from eskin.drivers.events import EventLog
from eskin.drivers.joints import JointSource, PoseLog
from eskin.drivers.module_registry import (
    AddressSlot,
    ModuleRegistry,
    PacketCounts,
    PacketOutcome,
    is_authenticated,
)
from eskin.drivers.packet import Data, Echo, Hello, Packet, Status
from eskin.drivers.timeline import (
    PatchStream,
    PeriodGrid,
    PeriodScans,
    RateChange,
    ScanTimeline,
)
from eskin.skin import Skin
from eskin.touch import Scan
from eskin.units import NS_PER_S

CHECK_INTERVAL = NS_PER_S // 50
"""How often silence and losses are checked [ns]."""
DOUBTS: dict[Doubt, str] = {
    "late": "its packets arrive {:.0f} ms after they were made",
    "untimed": "no echo tells how old its packets are",
    "replayed": "its packets were received before",
}
"""What events say of data that is not believed, and of its age."""


@final
class Assembler:
    """Assembles the scans of all patches into one scan of the skin a period.

    It does no input or output and has no thread: packets and times are passed in, scans
    are returned. What has not arrived by a period's deadline is marked as not received;
    no data is emitted twice.

    Attributes:
        registry: which module is at which address.
        streams: state of each patch's data, by its address.
        outcomes: how many packets had which outcome.
        timeline: scans that are not yet emitted; None before `start`.
        emitted: number of scans that were emitted.
    """

    def __init__(self, skin: Skin, joints: JointSource, log: EventLog) -> None:
        """Start without data; scans are emitted after `start`."""
        self.skin = skin
        self.log = log
        self.pose = PoseLog(joints, log)
        self.registry = ModuleRegistry(skin, log)
        self.streams = {
            address: PatchStream(slot, skin.find_taxels(slot.patch.id))
            for address, slot in self.registry.slots.items()
        }
        self.outcomes = PacketCounts()
        self.timeline: ScanTimeline | None = None
        self.emitted = 0
        self.checked_at = 0

    def start(self, now: int, rate: float, grace: float | None = None) -> None:
        """Emit scans from now on.

        Args:
            now: start of the first period [ns].
            rate: rate of the skin's scans [1/s].
            grace: wait for late packets after the end of a period while others arrive
                [s]; None waits half a period, at least 20 ms.
        """
        grid = PeriodGrid(now, rate, grace)
        self.timeline = ScanTimeline(grid, self.skin.count, self.streams, self.outcomes)

    def push_packet(
        self, packet: Packet, arrived: int, port: str, sent: int | None = None
    ) -> None:
        """Process a packet that arrived from a port or address.

        Args:
            packet: the packet; a request, which no patch sends, is foreign.
            arrived: when it arrived [ns].
            port: port or network address that it came from.
            sent: when the request was sent that an echo answers [ns], if it is known.
        """
        if isinstance(packet, Data):
            outcome = self.handle_data(packet, arrived, port)
        elif isinstance(packet, Hello):
            outcome = self.handle_hello(packet, arrived, port)
        elif isinstance(packet, Status):
            outcome = self.handle_status(packet, port)
        elif isinstance(packet, Echo):
            outcome = self.handle_echo(packet, arrived, port, sent)
        else:
            outcome = "foreign"
        self.outcomes.count_outcome(outcome)

    def handle_hello(self, hello: Hello, arrived: int, port: str) -> PacketOutcome:
        """Process a hello; return its outcome."""
        changed = self.registry.handle_hello(hello, arrived, port)
        if changed is not None:
            self.restart_stream(changed)
        stream = self.streams.get(hello.address)
        if stream is None or not stream.slot.fits(hello):
            return "foreign"
        if stream.slot.module is not None and stream.slot.port == port:
            stream.rate_meter.nominal = stream.slot.module.rate
            # A module with a key answers requests: without its echoes somebody holds
            # them back, and its data may be as old as he likes.
            stream.clock.expects_echoes |= is_authenticated(port)
        return "hello"

    def handle_status(self, status: Status, port: str) -> PacketOutcome:
        """Process a status; return its outcome."""
        stream = self.streams.get(status.address)
        if stream is None or stream.slot.port != port:
            return "foreign"
        text = "were skipped by the patch; lower its rate or use a faster line"
        self.count_lost(stream, stream.update_skipped(status.skipped), "scans", text)
        return "status"

    def handle_echo(
        self, echo: Echo, arrived: int, port: str, sent: int | None
    ) -> PacketOutcome:
        """Process an echo; return its outcome.

        The patch's clock showed `device_time` after the request was sent and before the
        echo arrived, less the time for which the patch held it.
        """
        stream = self.streams.get(echo.address)
        if stream is None or stream.slot.port != port:
            return "foreign"
        received = arrived - echo.held * NS_PER_US
        if sent is not None and sent <= received:
            stream.clock.push_echo(echo.device_time, sent, received)
        return "echo"

    def restart_stream(self, slot: AddressSlot) -> None:
        """Restart the stream of an address that has another module."""
        given_up = self.streams[slot.patch.address].restart()
        self.outcomes.settle("incomplete", given_up)

    def handle_data(self, data: Data, arrived: int, port: str) -> PacketOutcome:
        """Process a data packet; return its outcome so far."""
        stream = self.streams.get(data.address)
        if stream is None:
            self.registry.report_unknown_address(data.address, arrived, port)
            return "foreign"
        slot = stream.slot
        if port != slot.port:
            slot.note_rejected_data(arrived, port)
            return "foreign"
        size = len(data.counts)
        if size == 0 or data.first + size > slot.taxels:
            patch = slot.patch.id
            text = f"with taxels that patch '{patch}' does not have; check its address "
            self.log.count("damaged", "packet", f"{text}and firmware", patch=patch)
            return "damaged"
        clock = stream.clock
        known = clock.epoch is not None
        content = zlib.crc32(data.counts.tobytes(), data.first)
        scan_time = clock.find_scan_time(data.device_time, data.scan, arrived, content)
        if clock.problem != stream.problem:
            self.report_problem(stream, arrived)
        if scan_time is None:
            return "late" if known else "held"
        slot.note_data(arrived)
        if clock.reboots != stream.reboots:
            slot.report(arrived, "rebooted", "its clock started over")
        if clock.doubt is not None:
            return "held" if clock.doubt == "untimed" else "late"
        is_held = not stream.clock_matches() or arrived < slot.hold_until
        if is_held or self.timeline is None:
            return "held"
        slot.note_used(arrived)
        return self.add_data(stream, data, scan_time, arrived)

    def add_data(
        self, stream: PatchStream, data: Data, scan_time: ScanTime, arrived: int
    ) -> PacketOutcome:
        """Add accepted data to its scan; return its outcome so far."""
        number = scan_time.number
        novelty = stream.numbers.add_scan_number(number)
        if novelty == "old":
            return "late"
        if len(data.counts) == stream.slot.taxels:
            if novelty == "again":
                return "duplicate"
            return self.place_scan(stream, scan_time, data.counts, 1, arrived)
        if novelty == "again" and number not in stream.partial:
            return "duplicate" if number in stream.complete else "incomplete"
        scan = stream.add_part(number, scan_time.stamp, data)
        if scan is None:
            return "duplicate"
        if not scan.received.all():
            self.outcomes.settle("incomplete", stream.drop_partial(0))
            return "waiting"
        del stream.partial[number]
        stream.complete.add_scan_number(number)
        outcome = self.place_scan(stream, scan_time, scan.counts, scan.packets, arrived)
        self.outcomes.settle(outcome, scan.packets - 1)
        return outcome

    def place_scan(
        self,
        stream: PatchStream,
        scan_time: ScanTime,
        counts: Integer[np.ndarray, "part"],
        packets: int,
        arrived: int,
    ) -> PacketOutcome:
        """Place a complete scan in its period; return its packets' outcome so far."""
        if self.timeline is None:
            return "held"
        change = stream.rate_meter.count_scan(scan_time.stamp)
        if change is not None:
            self.report_rate(stream, change, arrived)
        return self.timeline.place(stream, scan_time, counts, packets, arrived)

    def report_problem(self, stream: PatchStream, arrived: int) -> None:
        """Report that the age of a patch's data is not believed, or is again."""
        problem = stream.problem = stream.clock.problem
        if problem is None:
            stream.slot.report(arrived, "in_time", "its packets arrive in time again")
            return
        text = DOUBTS[problem].format(stream.clock.lag / 1e6)
        text += "; none is used before they come in time; "
        text += "check line and clock, or start anew"
        stream.slot.report(arrived, "late", text)

    def report_rate(
        self, stream: PatchStream, change: RateChange, arrived: int
    ) -> None:
        """Report that a patch has become slow, or is no longer slow."""
        meter = stream.rate_meter
        text = f"{meter.measured:.1f} of {meter.nominal} scans a second arrive"
        if change == "slow":
            text += "; check its power and how much its line can carry"
        stream.slot.report(arrived, change, text)

    def poll(self, now: int) -> list[Scan]:
        """Return scans that are complete or due at a time [ns].

        All packets that arrived before that time must have been pushed.
        """
        if now - self.checked_at >= CHECK_INTERVAL:
            self.checked_at = now
            for slot in self.registry.poll(now):
                self.restart_stream(slot)
            self.report_lost(now)
        periods = [] if self.timeline is None else self.timeline.poll(now)
        return [self.build_scan(stamp, period) for stamp, period in periods]

    def build_scan(self, stamp: int, period: PeriodScans) -> Scan:
        """Build the scan of a period and drop packets that are too late for it."""
        self.emitted += 1
        for stream in self.streams.values():
            if stream.partial:
                self.drop_partial(stream, stamp)
        q, received = self.pose.read(stamp, period.received)
        return Scan(stamp, period.counts, received, q)

    def drop_partial(self, stream: PatchStream, before: int) -> None:
        """Drop scans that are still incomplete, and report them."""
        packets = stream.drop_partial(before)
        self.outcomes.settle("incomplete", packets)
        text = "did not count, as a scan arrived only in part; check its line"
        self.count_lost(stream, packets, "packet", text)

    def report_lost(self, now: int) -> None:
        """Report scans that are lost for good, and flush the log's counts."""
        for stream in self.streams.values():
            lost = stream.numbers.gone - stream.lost_reported
            stream.lost_reported += lost
            self.count_lost(stream, lost, "scan", "did not arrive; check its line")
        self.log.flush_counts(now)

    def count_lost(self, stream: PatchStream, count: int, what: str, text: str) -> None:
        """Count lost scans or packets of a patch in the log, unless there are none."""
        if count:
            patch = stream.slot.patch.id
            self.log.count("lost", what, f"of patch '{patch}' {text}", count, patch)

    def next_deadline(self) -> int | None:
        """Return by when the next scan is emitted [ns]; None before `start`."""
        return None if self.timeline is None else self.timeline.next_deadline()

    def skews(self) -> dict[str, float]:
        """Return how long after its reading's stamp each newest scan began [s]."""
        grid = None if self.timeline is None else self.timeline.grid
        return {
            stream.slot.patch.id: (stream.newest - grid.start(stream.period)) / NS_PER_S
            for stream in self.streams.values()
            if grid and stream.newest is not None and stream.period is not None
        }

    def counters(self) -> dict[str, int]:
        """Return readings, packets by outcome, lost scans and skipped periods."""
        lost = sum(stream.numbers.lost for stream in self.streams.values())
        skipped = 0 if self.timeline is None else self.timeline.skipped
        own = {"readings": self.emitted, "lost": lost, "skipped": skipped}
        return {**own, **self.outcomes.counts}
