"""Tests of every fault, from a virtual device over a real transport to the recogniser.

Device and host share a simulated clock (`Cable`). The counts of each patch tell the
number of their scan, so nothing can be used twice, too late or broken unnoticed.
"""

import random
import time
import zlib
from contextlib import closing
from functools import cache

import numpy as np
import pytest

from eskin.drivers import (
    DeviceSource,
    Event,
    FixedJoints,
    HostClock,
    ManualClock,
    SerialTransport,
    UdpTransport,
)
from eskin.live import Detection, Recognizer, load_model, warm_up
from eskin.sim.virtual import (
    PtyPort,
    UdpPort,
    VirtualSkin,
    parse_fault,
)
from eskin.stream import Recognition, Stream
from eskin.touch import Scan
from helpers.devices import (
    PATIENCE,
    PERIOD,
    RATE,
    calibration_of,
    mounted_small,
    playing,
    send_scans,
    small_skin,
)
from helpers.modules import ScriptedTransport
from helpers.streams import Ear
from lab.fuzz.mutation import mutate
from lab.soak.cable import Cable
from lab.soak.stream import stream_simulated

pytestmark = pytest.mark.slow

SKIN = small_skin()
TAXELS = {patch.id: SKIN.find_taxels(patch.id) for patch in SKIN.patches}
REST = 200
DIGITS = 4 ** np.arange(6)
MIXER = 1637
"""Odd, so that every number below 4096 is mixed to another one."""

over_both = pytest.mark.parametrize("over", ["udp", "serial"])


def encode_number(number, size):
    """Return counts of taxels at rest that tell the number of their scan."""
    digits = number * MIXER % 4096 // DIGITS % 4
    return REST + np.resize(digits, size).astype(np.int32)


def decode_number(counts):
    """Return the number that the counts of a patch tell; None where they tell none."""
    digits = counts[:6] - REST
    if (counts != np.resize(counts[:6], len(counts))).any() or not (
        (digits >= 0) & (digits < 4)
    ).all():
        return None
    return int(digits @ DIGITS) * pow(MIXER, -1, 4096) % 4096


def make_scans(count, touch=None):
    """Yield scans of an untouched skin, or one touched from one time to another."""
    received = np.ones(SKIN.count, bool)
    for number in range(count):
        counts = np.empty(SKIN.count, np.int32)
        for taxels in TAXELS.values():
            counts[taxels] = encode_number(number, len(taxels))
        if touch is not None and touch[0] <= number / RATE < touch[1]:
            counts[TAXELS["left"][[5, 6, 9, 10]]] += 1200
        yield Scan(PERIOD * (number + 1), counts, received, np.zeros(0))


@cache
def compile_recognizer():
    """Compile all code first: who stops a stream does not wait for the compiler."""
    warm_up(build_recognizer())


def build_recognizer():
    return Recognizer(load_model("ur5"), mounted_small(), calibration_of(SKIN))


def open_device(transport, clock, **options):
    return DeviceSource(
        transport,
        mounted_small(),
        calibration_of(SKIN),
        FixedJoints(np.zeros(0)),
        clock,
        "test:",
        **options,
    )


def open_transport(over, clock, count, folder=None):
    """Return a transport, and the ports at the other end of it."""
    if over == "udp":
        transport = UdpTransport(clock)
        return transport, [UdpPort("127.0.0.1", transport.port) for _ in range(count)]
    ports = [PtyPort(folder and folder / f"port{number}") for number in range(count)]
    paths = [port.uri.removeprefix("serial:") for port in ports]
    return SerialTransport(clock, paths), ports


class FaultRun:
    """What a recogniser gets of a skin with faults."""

    def __init__(self, over, faults, seconds, touch=None, ports=3, folder=None):
        clock = ManualClock(10**18)
        self.faults = [
            parse_fault(text, SKIN, seed) for seed, text in enumerate(faults)
        ]
        inner, lines = open_transport(over, clock, ports, folder)
        self.device = VirtualSkin(SKIN, lines, RATE, self.faults)
        scans = make_scans(round(seconds * RATE), touch)
        cable = Cable(inner, self.device, scans, clock)
        source = open_device(cable, clock)
        compile_recognizer()
        recognition = Recognition(build_recognizer(), drop="never")
        listener = Ear(message_types=(Scan, Event, Detection), size=10_000)
        with closing(inner), Stream(source, [recognition, listener]) as stream:
            until = time.monotonic() + 6 * PATIENCE
            while not cable.over.is_set() and time.monotonic() < until:
                stream.wait(0.01)
        assert cable.over.is_set()
        self.start = cable.start
        self.end = self.start + self.device.elapsed
        self.outcomes = source.assembler.outcomes.counts
        self.counters = source.counters()
        self.queue = stream.queue_counts()["recognition"]
        self.messages = listener.received
        self.detections = self.select(Detection)
        assert recognition.detections == len(self.detections)
        last = self.end - PERIOD
        self.scans = [scan for scan in self.select(Scan) if scan.stamp < last]
        self.kinds = {event.kind for event in self.select(Event)}

    def select(self, kind):
        return [message for message in self.messages if isinstance(message, kind)]

    def received(self, patch, begin, end=np.inf):
        """Return in which share of the scans between two times [s] a patch is."""
        return np.mean(
            [
                scan.received[TAXELS[patch]].all()
                for scan in self.scans
                if begin <= (scan.stamp - self.start) / 1e9 < end
            ]
        )

    def check(self):
        """Check the laws of every stream of an untouched skin."""
        # Scans go on at the rate of the skin.
        assert (np.diff([scan.stamp for scan in self.scans]) == PERIOD).all()
        assert len(self.scans) >= (self.end - self.start) / PERIOD - 70
        # Nothing is broken, twice or old.
        for taxels in TAXELS.values():
            last = -1
            for scan in self.scans:
                received = scan.received[taxels]
                assert received.all() == received.any()
                if received.any():
                    number = decode_number(scan.counts[taxels])
                    assert number is not None and number > last
                    taken = self.start + number * PERIOD
                    assert abs(taken - scan.stamp) <= 2 * PERIOD
                    last = number
        # Every packet has one outcome.
        packets = self.counters.get("frames", self.counters.get("datagrams"))
        packets -= self.counters.get("refused", 0)
        assert sum(self.outcomes.values()) == packets
        assert (self.queue.dropped, self.queue.waiting) == (0, 0)
        assert self.detections == []


def run_faults(over, faults, seconds, **options):
    """Return a run with faults, each of which has struck, and whose laws hold."""
    run = FaultRun(over, faults, seconds, **options)
    run.check()
    assert all(fault.count > 0 for fault in run.faults)
    return run


@over_both
def test_every_scan_is_used_without_faults(over):
    run = run_faults(over, [], 3)
    assert run.received("left", 1) == run.received("middle", 1) == 1
    assert run.counters["lost"] == run.counters["damaged"] == 0
    assert run.counters["foreign"] == 0
    assert sum(run.outcomes.values()) == run.device.packets


@pytest.mark.parametrize("fault", [[], ["corrupt@1=0.05"], ["flip@1=0.0005"]])
def test_touch_is_detected_through_faults(fault):
    run = FaultRun("udp", fault, 4.5, touch=(3.0, 3.4))
    [detection] = run.detections
    assert 2.9 < (detection.onset - run.start) / 1e9 < 3.1
    assert detection.patch == "left"


@over_both
def test_faults_of_packets_are_counted_one_by_one(over):
    kinds = "corrupt truncate lose duplicate wrong_patch reorder".split()
    faults = [f"{k}@{1.5 + n / 2}-{2 + n / 2}=0.1" for n, k in enumerate(kinds)]
    run = run_faults(over, faults, 5)
    corrupt, truncate, lose, duplicate, wrong, _ = run.faults
    assert run.counters["damaged"] == corrupt.count + truncate.count
    assert run.counters["lost"] == corrupt.data + truncate.data + lose.data
    assert run.counters["duplicate"] == duplicate.data
    assert run.counters["foreign"] == wrong.count


@over_both
def test_flipped_bits_cost_what_they_strike(over):
    run = run_faults(over, ["flip@1.5-2.5=0.01"], 4)
    assert run.faults[0].count > 400
    assert run.received("left", 1, 1.4) == run.received("left", 3.5) == 1
    assert run.received("left", 1.7, 2.5) < 0.3
    assert "damaged" in run.kinds


@over_both
def test_flood_of_garbage_is_thrown_away(over):
    run = run_faults(over, ["garbage@1.5-2.5=100000"], 3.5)
    assert run.faults[0].count > 90_000
    assert run.received("right", 1, 1.4) == run.received("middle", 2.7) == 1


@over_both
def test_two_patches_at_one_address_on_one_line_are_not_used(over):
    run = run_faults(over, ["same_address:left,right@1.5"], 4.5, ports=1)
    assert run.received("left", 2.7) == run.received("right", 1.6) == 0
    assert run.received("middle", 1) == 1
    assert "conflict" in run.kinds


@pytest.mark.parametrize(
    ("over", "times", "cycle"), [("udp", 8, 0.6), ("serial", 2, 2)]
)
def test_patch_that_is_unplugged_comes_back_each_time(over, times, cycle, tmp_path):
    # A serial port is opened anew, and its patch known at its next hello.
    begins = [2 + cycle * n for n in range(times)]
    faults = [f"unplug:left@{begin:.1f}-{begin + 0.1:.1f}" for begin in begins]
    run = run_faults(over, faults, 2.1 + cycle * times, folder=tmp_path)
    assert [fault.count for fault in run.faults] == [1] * times
    for begin in begins:
        assert run.received("left", begin - 0.1, begin - 0.03) == 1
        assert run.received("left", begin + 0.03, begin + 0.1) == 0
    assert run.received("middle", 1) == 1


@pytest.mark.parametrize(
    ("fault", "kind", "back"),
    [
        ("reboot:left@1.5", "rebooted", 1),
        # A module that replaces another waits to be tared.
        ("replace:left@1.5=1", "replaced", 0),
        ("clock_jump:left@1.5=10", "rebooted", 1),
        ("delay:left@1.5-2.5=0.3", "late", 1),
    ],
)
def test_module_that_begins_anew_or_is_late_is_never_old(fault, kind, back):
    run = run_faults("udp", [fault], 4)
    assert run.received("middle", 1) == 1
    assert run.received("left", 1.5, 3) < 1
    assert run.received("left", 3.2) == back
    assert kind in run.kinds


@over_both
def test_wrap_and_stall_lose_nothing_else(over):
    run = run_faults(over, ["wrap@1=1", "stall@3-5"], 6)
    assert {"silent", "returned"} <= run.kinds
    for patch in TAXELS:
        assert run.received(patch, 1.5, 2.9) == run.received(patch, 5.1) == 1
        assert run.received(patch, 3.1, 4.95) == 0


def test_date_of_the_host_may_be_set(monkeypatch):
    clock = HostClock()
    transport, ports = open_transport("udp", clock, 1)
    with playing(VirtualSkin(SKIN, ports, RATE), make_scans(400), clock):
        with open_device(transport, clock, rate=RATE, grace=0.5) as source:
            scans = [source.read(PATIENCE) for _ in range(20)]
            date = time.time_ns()
            monkeypatch.setattr(time, "time_ns", lambda: date - 3600 * 10**9)
            scans += [source.read(PATIENCE) for _ in range(20)]
    assert (np.diff([scan.stamp for scan in scans]) == PERIOD).all()
    assert all(scan.received.all() for scan in scans[25:])


def make_mutated_packets(count):
    """Yield packets of which one in two is mutated, some with a right CRC."""
    rng = random.Random(0)
    packets, _ = send_scans(count=count // 6)
    for number in range(count):
        packet = packets[number // 2 % len(packets)]
        kind = rng.choice(("intact", "mutated", "sealed"))
        if kind == "mutated":
            packet = mutate(packet, rng)
        elif kind == "sealed":
            body = mutate(packet[:-4], rng)
            packet = body + zlib.crc32(body).to_bytes(4, "little")
        yield 10**18 + number * 250_000, rng.choice("aaab"), packet


def test_mutated_packets_have_one_outcome_each_and_break_nothing():
    clock = ManualClock(10**18)
    count = 10_000
    stamps = []
    transport = ScriptedTransport(clock, make_mutated_packets(count))
    with open_device(transport, clock, rate=RATE) as source:
        while transport.coming:
            scan = source.read(0.1)
            stamps += [] if scan is None else [scan.stamp]
    assert (np.diff(stamps) > 0).all() and len(stamps) > 100
    outcomes = source.assembler.outcomes.counts
    assert sum(outcomes.values()) == count
    assert outcomes["damaged"] > 2000 < outcomes["foreign"] + outcomes["held"]
    assert all(len(stream.partial) <= 5 for stream in source.assembler.streams.values())


def test_simulated_person_on_the_whole_skin_loses_nothing():
    soak = stream_simulated(3.0)
    assert soak.lost == {}
    assert soak.readings >= 140
    assert soak.detections > 0
    assert soak.threads[0] == soak.threads[1]
