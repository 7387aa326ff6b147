"""A skin on a cable as a source of scans."""

from collections import deque
from typing import final

from eskin.drivers.assembler import Assembler
from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.module_registry import MOST_RATE, PacketOutcome
from eskin.drivers.packet import decode_packet
from eskin.drivers.source import JointSource, Source, SourceInfo
from eskin.drivers.transport import ReceivedPacket, Transport
from eskin.errors import DeviceError, PacketError, SkinMismatchError
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

USUAL_RATE = 50.0
"""Of a skin whose patches do not say theirs [1/s]."""
LISTEN = 1.2
"""How long hellos are awaited, which come once a second [s]."""
LONGEST_WAIT = 0.1
"""Between two looks at who is gone [s]."""


@final
class DeviceSource(Source):
    """Hears the patches of a skin over a transport, and never ends by itself.

    Attributes:
        info: what is known before the first scan.
        clock: that its scans are stamped by.
        assembler: ages, skews and the state of every patch.
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
    ) -> None:
        """Listen to a transport, which is closed with the source.

        Args:
            transport: that the patches are heard over; stamps by the same clock.
            mounted: the skin on its robot.
            calibration: of the skin's electronics.
            joints: where the robot's joints are.
            clock: of everything.
            uri: how it was asked for.
            rate: of scans [1/s]; where None, hellos are awaited for 1.2 s and the
                highest promised rate is taken, 50 without.
            grace: how long a period waits after its end for what is under way [s]; half
                a period but at least 20 ms where None.

        Raises:
            SkinError: two patches have the same address.
            SkinMismatchError: the calibration is not of this skin.
            DeviceError: the transport is lost.
        """
        skin = mounted.skin
        if len(calibration.gain) != skin.count:
            raise SkinMismatchError(
                f"calibration has {len(calibration.gain)} taxels, skin '{skin.name}' "
                f"has {skin.count}; allowed is one gain a taxel; use the skin's own"
            )
        if rate is not None and not 0.1 <= rate <= MOST_RATE:
            raise DeviceError(
                f"rate is {rate}; allowed is 0.1 to {MOST_RATE} scans a second; "
                "correct it, or leave it out to take what the patches promise"
            )
        self.clock = clock
        self.transport = transport
        self.log = EventLog()
        self.assembler = Assembler(skin, joints, self.log)
        self.ready: deque[Scan] = deque()
        self.closed, self.left = False, 0
        rate = self.listen() if rate is None else rate
        self.assembler.start(clock.now(), rate, grace)
        self.info = SourceInfo(
            uri=uri,
            robot_name=mounted.robot.name,
            joint_names=mounted.robot.joint_names,
            skin=skin,
            calibration=calibration,
            rate=rate,
        )

    def listen(self) -> float:
        """The rate that patches promise, as soon as all of them were heard [1/s]."""
        roster = self.assembler.registry
        end = self.clock.now() + round(LISTEN * NS_PER_S)
        while (now := self.clock.now()) < end:
            self.take(self.transport.read(min(LONGEST_WAIT, (end - now) / NS_PER_S)))
            if all(seat.module for seat in roster.slots.values()):
                break
        return float(roster.promised or USUAL_RATE)

    def read(self, timeout: float | None = None) -> Scan | None:
        """The next scan of the whole skin; None where none was due in time."""
        end = None if timeout is None else self.clock.now() + round(timeout * NS_PER_S)
        while not self.ready and not self.closed:
            before = self.clock.now()
            self.hear(before, end)
            if end is not None and before >= end:
                break
        return self.ready.popleft() if self.ready else None

    def hear(self, now: int, end: int | None) -> None:
        """Read the transport until a scan is due at the latest, and take what comes.

        What the system holds was all read before a period is given up: the time that is
        asked for is that of the first packet of a read, or of the end of a wait.
        """
        times = [
            now + round(LONGEST_WAIT * NS_PER_S),
            self.assembler.next_deadline(),
            end,
        ]
        until = max(now, min(time for time in times if time is not None))
        deliveries = self.transport.read((until - now) / NS_PER_S)
        self.take(deliveries)
        heard = deliveries[0].arrived if deliveries else until
        self.ready += self.assembler.poll(min(heard, self.clock.now()))

    def take(self, deliveries: list[ReceivedPacket]) -> None:
        """Decode packets and hand them over; what is none is only counted."""
        for port, arrived, data in deliveries:
            try:
                packet = decode_packet(data)
            except PacketError as error:
                self.refuse(error, port)
            else:
                self.assembler.push(packet, arrived, port)

    def refuse(self, error: PacketError, port: str) -> None:
        """Count bytes that are no packet of this version."""
        fate: PacketOutcome = (
            "unknown" if error.reason in ("version", "kind") else "damaged"
        )
        self.assembler.outcomes.add(fate)
        text = f"packets at {port} have a wrong {error.reason}; check cable and baud"
        if fate == "unknown":
            text = f"packets at {port} are of another {error.reason}; update eskin"
        self.log.count("damaged", text)

    @property
    def ended(self) -> bool:
        """Whether it was closed and all was read; devices never end."""
        return self.closed and not self.ready

    def take_events(self) -> list[Event]:
        """What has happened since it was last asked."""
        self.log.poll(self.clock.now())
        events = self.log.take() + self.transport.take_events(self.clock.now())
        return sorted(events, key=lambda event: event.stamp)

    def counters(self) -> dict[str, int]:
        """Readings, packets by their fate, lost scans, skipped periods, transport.

        `unread`: readings that were ready but were not read, or not yet.
        """
        counts = {**self.assembler.counters(), "unread": self.unread}
        counts["readings"] -= self.unread
        return {**counts, **self.transport.counters()}

    @property
    def unread(self) -> int:
        """Scans that are ready, or were when it was closed."""
        return self.left or len(self.ready)

    def close(self) -> None:
        """Close the transport; may be called twice."""
        if not self.closed:
            self.closed = True
            self.left = len(self.ready)
            self.ready.clear()
            self.transport.close()
