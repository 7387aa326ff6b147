"""This module reads a skin on a cable as a source of scans."""

from collections import deque
from typing import final

from eskin.drivers.assembler import Assembler
from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.joints import JointSource
from eskin.drivers.module_registry import MAX_SCAN_RATE
from eskin.drivers.packet import decode_packet
from eskin.drivers.sessions import HostSessions
from eskin.drivers.source import (
    ReceivedPacket,
    Source,
    SourceInfo,
    Transport,
    await_first_byte,
)
from eskin.errors import DeviceError, PacketError
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

DEFAULT_RATE = 50.0
"""Scan rate of a skin whose patches do not specify theirs [1/s]."""
HELLO_TIMEOUT = 1.2
"""Longest wait for hellos, which modules send once a second [s]."""
MAX_SESSION_WAIT = 2.0
"""Longest time until a patch gives up the session of a previous host [s]."""
MAX_WAIT = 0.1
"""Longest time between two checks for silent patches [s]."""


@final
class DeviceSource(Source):
    """Receives the patches of a skin over a transport and never ends by itself.

    Attributes:
        assembler: state of every patch, with ages and skews.
    """

    def __init__(
        self,
        transport: Transport,
        mounted: MountedSkin,
        calibration: Calibration,
        joints: JointSource,
        clock: Clock,
        uri: str,
        rate: float | None = None,
        grace: float | None = None,
        key: bytes | None = None,
        patience: float = 0.0,
    ) -> None:
        """Listen to a transport, which is closed with the source.

        Args:
            transport: transport of the patches; stamps by the same clock.
            mounted: the skin on its robot.
            calibration: calibration of the skin's electronics.
            joints: source of the robot's joint positions.
            clock: clock that stamps everything.
            uri: URI that the source was opened with.
            rate: scan rate [1/s]; None waits 1.2 s for hellos and takes the highest
                nominal rate, or 50 without any.
            grace: wait for late packets after the end of a period [s]; None waits half
                a period, at least 20 ms.
            key: key of 32 bytes that packets must be sealed with; None accepts packets
                that are not authenticated.
            patience: longest wait for the first byte [s]; 0 waits for none.

        Raises:
            SkinError: two patches have the same address.
            SkinMismatchError: the calibration is not of this skin.
            DeviceError: the transport is lost, or no byte came in time.
        """
        skin = mounted.skin
        calibration.check_skin(skin)
        if rate is not None and not 0.1 <= rate <= MAX_SCAN_RATE:
            raise DeviceError(
                f"rate is {rate}; allowed is 0.1 to {MAX_SCAN_RATE} scans a second; "
                "correct it, or leave it out to take the nominal rate of the patches"
            )
        self.clock = clock
        self.transport = transport
        self.log = EventLog()
        self.assembler = Assembler(skin, joints, self.log)
        self.sessions = HostSessions(self.assembler.streams, clock, key)
        self.ready: deque[Scan] = deque()
        self.closed = False
        self.left_unread = 0
        await_first_byte(
            uri,
            clock,
            patience,
            lambda: transport.counters()["bytes"],
            self.receive_packets,
        )
        rate = self.receive_hellos() if rate is None else rate
        is_assumed = rate is None
        if rate is None:
            rate = DEFAULT_RATE
        self.assembler.start(clock.now(), rate, grace)
        self.info = SourceInfo(uri, mounted, calibration, rate, is_assumed)

    def receive_packets(self, timeout: float) -> None:
        """Take the packets that arrive within a time [s], before scans are due."""
        self.push_packets(self.transport.read(timeout))
        self.send_requests()

    def receive_hellos(self) -> float | None:
        """Wait for the hellos of all patches; return their nominal rate [1/s].

        It is None where none of them tells it.
        """
        registry = self.assembler.registry
        timeout = HELLO_TIMEOUT
        if self.sessions.key is not None:
            timeout += MAX_SESSION_WAIT
        end = self.clock.now() + round(timeout * NS_PER_S)
        while (now := self.clock.now()) < end:
            wait = min(MAX_WAIT, (end - now) / NS_PER_S)
            self.receive_packets(wait)
            if all(slot.module for slot in registry.slots.values()):
                break
        highest = registry.highest_rate
        return float(highest) if highest else None

    def read(self, timeout: float | None = None) -> Scan | None:
        """Return the next scan of the whole skin; None where none was due in time."""
        end = None if timeout is None else self.clock.now() + round(timeout * NS_PER_S)
        while not self.ready and not self.closed:
            previous = self.clock.now()
            self.receive(previous, end)
            if end is not None and previous >= end:
                break
        return self.ready.popleft() if self.ready else None

    def receive(self, now: int, end: int | None) -> None:
        """Read the transport, no longer than until a scan is due, and assemble scans.

        All that the system buffers is read before a period is emitted: the assembler is
        polled with the time of the first packet of a read, or of the end of a wait.
        """
        longest = now + round(MAX_WAIT * NS_PER_S)
        times = [longest, self.assembler.next_deadline(), end]
        until = max(now, min(time for time in times if time is not None))
        packets = self.transport.read((until - now) / NS_PER_S)
        self.push_packets(packets)
        self.send_requests()
        arrived = packets[0].arrived if packets else until
        self.ready += self.assembler.poll(min(arrived, self.clock.now()))

    def push_packets(self, packets: list[ReceivedPacket]) -> None:
        """Decode packets and assemble them; others are only counted.

        These are invalid, or not authentic where there is a key.
        """
        for port, arrived, data in packets:
            try:
                packet = decode_packet(data)
            except PacketError as error:
                self.count_invalid(error, port)
                continue
            result = self.sessions.authenticate(packet, data, arrived, port)
            if result.refused is None:
                self.assembler.push_packet(packet, arrived, result.port, result.sent)
                continue
            self.assembler.outcomes.count_outcome(result.refused)
            if result.reason:
                self.log.count("unauthenticated", "packet", result.reason)

    def send_requests(self) -> None:
        """Send the requests that are due to patches of protocol version 2."""
        for port, packet in self.sessions.take_requests(self.clock.now()):
            self.transport.send(port, packet)

    def count_invalid(self, error: PacketError, port: str) -> None:
        """Count bytes that are not a packet of this version."""
        unknown = error.reason in ("version", "kind")
        self.assembler.outcomes.count_outcome("unknown" if unknown else "damaged")
        text = f"at {port} with a wrong {error.reason}; check cable and baud"
        if unknown:
            text = f"at {port} of another {error.reason}; update eskin"
        self.log.count("damaged", "packet", text)

    @property
    def ended(self) -> bool:
        """Return whether it was closed and all scans were read; a device never ends."""
        return self.closed and not self.ready

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        self.log.flush_counts(self.clock.now())
        events = self.log.take() + self.transport.take_events(self.clock.now())
        return sorted(events, key=lambda event: event.stamp)

    def take_last_events(self) -> list[Event]:
        """Return the events since the last call, and of what was only counted yet."""
        self.log.flush_counts(self.clock.now(), at_end=True)
        return self.take_events()

    def counters(self) -> dict[str, int]:
        """Return readings, packets by outcome, lost scans, skipped periods, transport.

        `unread`: readings that were ready but were not read, or not yet.
        """
        counts = {**self.assembler.counters(), "unread": self.unread}
        counts["readings"] -= self.unread
        return {**counts, **self.transport.counters()}

    @property
    def unread(self) -> int:
        """Number of scans that are ready, or were when the source was closed."""
        return self.left_unread or len(self.ready)

    def close(self) -> None:
        """Close the transport; may be called twice."""
        if not self.closed:
            self.closed = True
            self.left_unread = len(self.ready)
            self.ready.clear()
            self.transport.close()
