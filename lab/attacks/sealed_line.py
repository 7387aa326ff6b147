"""Connect patches with a key to a host, in memory and on one clock."""

from typing import final

import numpy as np

from eskin.drivers import (
    DeviceSource,
    Event,
    FixedJoints,
    ManualClock,
    Packet,
    ReceivedPacket,
    Request,
    Transport,
    decode_packet,
)
from eskin.errors import PacketError
from eskin.robot import load_robot
from eskin.sim.virtual import VirtualPatch
from eskin.skin import MountedSkin, load_skin
from eskin.touch import Calibration

RATE = 50.0
"""Rate of the scans [1/s]."""
PORT = "udp://10.0.0.2:9750"
"""Network address of the true patches, which attackers use too."""
OPENING_STEPS = 20
"""Number of scans in which sessions are opened and clocks are accepted."""


@final
class MemoryLine(Transport):
    """Carries packets between host and patches in memory.

    Attributes:
        arriving: packets for the host.
        requests: packets of the host for the patches.
    """

    def __init__(self, clock: ManualClock) -> None:
        """Start without packets, on a clock that reads advance."""
        self.clock = clock
        self.arriving: list[ReceivedPacket] = []
        self.requests: list[bytes] = []

    def read(self, timeout: float) -> list[ReceivedPacket]:
        """Return what arrives; the clock advances where nothing does."""
        arriving = self.arriving
        self.arriving = []
        if not arriving:
            self.clock.sleep(timeout)
        return arriving

    def put(self, packets: list[bytes]) -> None:
        """Let packets arrive now."""
        now = self.clock.now()
        self.arriving += [ReceivedPacket(PORT, now, data) for data in packets]

    def send(self, port: str, packet: bytes) -> None:
        """Keep a request for the patches."""
        self.requests.append(packet)

    def take_events(self, now: int) -> list[Event]:
        """Return no events."""
        return []

    def counters(self) -> dict[str, int]:
        """Return no counters."""
        return {}

    def close(self) -> None:
        """Do nothing; there is nothing to close."""


@final
class SealedLine:
    """Lets the patches of the ur5 skin send to a host, with a key or without.

    Attributes:
        source: the host's source of scans.
        assembled: number of packets that were accepted, that is, assembled.
    """

    def __init__(
        self, patches: int, version: int, key: bytes | None, seed: int
    ) -> None:
        """Power up that many patches of the skin and open their sessions."""
        self.clock = ManualClock(10**18)
        self.line = MemoryLine(self.clock)
        mounted = MountedSkin(load_skin("ur5"), load_robot("ur5"))
        skin = mounted.skin
        self.size = skin.count
        self.rng = np.random.default_rng(seed)
        self.patches = [
            VirtualPatch(
                patch,
                skin.find_taxels(patch.id),
                RATE,
                serial_number=1 + number,
                version=version,
                key=key,
            )
            for number, patch in enumerate(skin.patches[:patches])
        ]
        calibration = Calibration.uniform(skin.count, 4095, 100.0)
        joints = FixedJoints(np.zeros(len(mounted.robot.joint_names)))
        self.source = DeviceSource(
            self.line, mounted, calibration, joints, self.clock, "", RATE, key=key
        )
        self.assembled = 0
        self.count_assembled()
        self.deliver(self.build_hellos())
        for _ in range(OPENING_STEPS):
            self.step()

    def count_assembled(self) -> None:
        """Count the packets that reach the assembler."""
        push = self.source.assembler.push_packet

        def push_and_count(
            packet: Packet, arrived: int, port: str, sent: int | None = None
        ) -> None:
            self.assembled += 1
            push(packet, arrived, port, sent)

        self.source.assembler.push_packet = push_and_count

    @property
    def now(self) -> int:
        """The time of all clocks [ns]."""
        return self.clock.now()

    def build_hellos(self) -> list[bytes]:
        """Return a hello of each patch."""
        return [patch.build_hello(self.now) for patch in self.patches]

    def build_scan(self) -> list[bytes]:
        """Return the packets of the next scan of every patch."""
        counts = self.rng.integers(0, 4096, self.size).astype(np.int32)
        received = np.ones(self.size, bool)
        packets = []
        for patch in self.patches:
            packets += patch.measure(counts, received, self.now)
        return packets

    def build_answers(self, requests: list[bytes]) -> list[bytes]:
        """Return what the patches answer to some requests."""
        answers = []
        for data in requests:
            try:
                request = decode_packet(data)
            except PacketError:
                continue
            if not isinstance(request, Request):
                continue
            for patch in self.patches:
                if patch.address == request.address:
                    answers += patch.answer(request, data, self.now)
        return answers

    def wait_period(self) -> list[bytes]:
        """Wait for one period; return the answers to the host's requests."""
        self.clock.sleep(1.0 / RATE)
        requests = self.line.requests
        self.line.requests = []
        return self.build_answers(requests)

    def step(self) -> None:
        """Wait for one period and deliver answers and a scan."""
        self.deliver(self.wait_period() + self.build_scan())

    def deliver(self, packets: list[bytes]) -> int:
        """Let packets arrive; return how many of them were accepted."""
        before = self.assembled
        self.line.put(packets)
        self.source.read(0.0)
        return self.assembled - before
