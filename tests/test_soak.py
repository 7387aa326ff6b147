"""The short forms of what `make soak` and `make fuzz` run for long."""

import random
import zlib

import numpy as np
from benchmarks.fuzz.mutation import mutate
from benchmarks.soak.stream import stream_simulated

from eskin.drivers import (
    DeviceSource,
    FixedJoints,
    ManualClock,
    ReceivedPacket,
    Transport,
)
from eskin.drivers.packet import CRC
from eskin.drivers.virtual import VirtualSkin
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import Calibration
from helpers.devices import RATE, Listener, scans_of, small_skin

FATES = (
    "used duplicate late superseded incomplete damaged unknown foreign held hello "
    "status waiting"
).split()


def test_five_seconds_of_the_whole_skin_lose_nothing_and_leave_nothing():
    soaked = stream_simulated(5.0)
    assert soaked.lost == {}
    assert soaked.readings >= 240
    assert soaked.detections > 0
    assert soaked.threads[0] == soaked.threads[1]


class Mutating(Transport):
    """Brings packets of a skin of which one in two is mutated, some with a true CRC."""

    def __init__(self, clock, packets):
        self.clock, self.packets = clock, packets
        self.rng = random.Random(0)
        self.brought = 0

    def read(self, timeout):
        self.clock.sleep(min(timeout, 0.005))
        return [self.delivery() for _ in range(20)]

    def delivery(self):
        packet = self.packets[self.brought // 2 % len(self.packets)]
        kind = self.rng.choice(("whole", "mutated", "sealed"))
        if kind == "mutated":
            packet = mutate(packet, self.rng)
        elif kind == "sealed":
            body = mutate(packet[: -CRC.size], self.rng)
            packet = body + CRC.pack(zlib.crc32(body))
        self.brought += 1
        port = self.rng.choice(("a", "a", "a", "b"))
        return ReceivedPacket(port, self.clock.now(), packet)

    def take_events(self, now):
        return []

    def counters(self):
        return {}

    def close(self):
        pass


def test_fifty_thousand_mutated_packets_each_have_one_fate_and_break_nothing():
    skin, line, clock = small_skin(), Listener(), ManualClock(10**18)
    VirtualSkin(skin, [line], RATE).play(scans_of(skin, 2000), ManualClock())
    transport = Mutating(clock, line.heard)
    mounted = MountedSkin(skin, load_robot("table"))
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    joints = FixedJoints(np.zeros(0))
    source = DeviceSource(transport, mounted, calibration, joints, clock, "a", RATE)
    stamps = []
    while transport.brought < 50_000:
        scan = source.read(0.1)
        stamps += [] if scan is None else [scan.stamp]
        source.take_events()
    assert (np.diff(stamps) > 0).all() and len(stamps) > 100
    counted = source.counters()
    assert sum(counted[fate] for fate in FATES) == transport.brought
    assert counted["damaged"] > 10_000 < counted["foreign"] + counted["held"]
    assert all(len(stream.partial) <= 5 for stream in source.assembler.streams.values())
