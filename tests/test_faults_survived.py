"""Every fault, from a virtual device over a real transport to the recogniser.

Device and host share a simulated clock (`Cable`). Each scan of each patch is told by
its counts: nothing can be used twice, too late or broken without being noticed.
"""

import time
from contextlib import ExitStack
from functools import cache

import numpy as np
import pytest
from benchmarks.soak.cable import Cable

from eskin.drivers import (
    DeviceSource,
    Event,
    FixedJoints,
    HostClock,
    ManualClock,
    SerialTransport,
    UdpTransport,
)
from eskin.drivers.virtual import PtyPort, UdpPort, VirtualSkin, parse_fault
from eskin.live import Detection, Recognizer, warm_up
from eskin.model import load_model
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.stream import Recognition, Stream
from eskin.touch import Calibration, Scan
from helpers.devices import PATIENCE, PERIOD, RATE, playing, small_skin
from helpers.streams import Ear

SKIN = small_skin()
MOUNTED = MountedSkin(SKIN, load_robot("table"))
CALIBRATION = Calibration.uniform(SKIN.count, 4095, 100.0)
PARTS = {patch.id: SKIN.find_taxels(patch.id) for patch in SKIN.patches}
REST = 200
DIGITS = 4 ** np.arange(6)
MIXED = 1637
"""Odd, so that every number below 4096 is mixed to another one."""
FATES = (
    "used duplicate late superseded incomplete damaged unknown foreign held hello "
    "status waiting"
).split()


def fingerprint(number, count):
    """Counts of taxels at rest that tell the number of their scan."""
    digits = number * MIXED % 4096 // DIGITS % 4
    return REST + np.resize(digits, count).astype(np.int32)


def number_of(counts):
    """The number that the counts of a patch tell; None where they tell none."""
    digits = counts[:6] - REST
    if (counts != np.resize(counts[:6], len(counts))).any() or not (
        (digits >= 0) & (digits < 4)
    ).all():
        return None
    return int(digits @ DIGITS) * pow(MIXED, -1, 4096) % 4096


def resting(count, touch=None):
    """Scans of an untouched skin, or one that is touched from one time to another."""
    received = np.ones(SKIN.count, bool)
    for number in range(count):
        counts = np.empty(SKIN.count, np.int32)
        for taxels in PARTS.values():
            counts[taxels] = fingerprint(number, len(taxels))
        if touch is not None and touch[0] <= number / RATE < touch[1]:
            counts[PARTS["left"][[5, 6, 9, 10]]] += 1200
        yield Scan(PERIOD * (number + 1), counts, received, np.zeros(0))


@cache
def compile_first():
    """Who stops a stream does not wait until what it needs is compiled."""
    warm_up(Recognizer(load_model("ur5"), MOUNTED, CALIBRATION))


class Message:
    """What came of a skin with faults."""

    def __init__(self, over, faults, seconds, touch=None, ports=3, folder=None):
        clock = ManualClock(10**18)
        made = [parse_fault(text, SKIN, seed) for seed, text in enumerate(faults)]
        with ExitStack() as stack:
            inner, lines = plugged(over, clock, ports, folder)
            stack.callback(inner.close)
            self.device = VirtualSkin(SKIN, lines, RATE, made)
            scans = resting(round(seconds * RATE), touch)
            cable = Cable(inner, self.device, scans, clock)
            source = DeviceSource(
                cable, MOUNTED, CALIBRATION, FixedJoints(np.zeros(0)), clock, over
            )
            compile_first()
            recognizer = Recognizer(load_model("ur5"), MOUNTED, CALIBRATION)
            recognition = Recognition(recognizer, drop="never")
            self.ear = Ear(message_types=(Scan, Event, Detection), size=10_000)
            with Stream(source, [recognition, self.ear]) as stream:
                until = time.monotonic() + 6 * PATIENCE
                while not cable.over.is_set() and time.monotonic() < until:
                    stream.wait(0.01)
            assert cable.over.is_set()
        self.start, self.end = cable.start, cable.start + self.device.elapsed
        self.counted = source.counters()
        self.detections = recognition.detections
        self.queues = stream.queue_counts()

    def of(self, kind):
        return [item for item in self.ear.heard if isinstance(item, kind)]

    @property
    def scans(self):
        return [scan for scan in self.of(Scan) if scan.stamp < self.end - PERIOD]

    @property
    def kinds(self):
        return {event.kind for event in self.of(Event)}

    def received(self, patch, begin, end):
        """Of the readings between two times [s], the share in which a patch is."""
        inside = [
            scan.received[PARTS[patch]].all()
            for scan in self.scans
            if begin <= (scan.stamp - self.start) / 1e9 < end
        ]
        return np.mean(inside)


def plugged(over, clock, ports, folder):
    """A transport, and the ports at the other end of it."""
    if over == "udp":
        inner = UdpTransport(clock)
        return inner, [UdpPort("127.0.0.1", inner.port) for _ in range(ports)]
    lines = [
        PtyPort(folder / f"port{number}" if folder else None) for number in range(ports)
    ]
    paths = [line.uri.removeprefix("serial:") for line in lines]
    return SerialTransport(clock, paths), lines


def check(heard, skipped=0):
    """Laws of every stream, whatever befalls it."""
    scans, counted = heard.scans, heard.counted
    # Readings go on at the rate of the skin.
    steps = np.diff([scan.stamp for scan in scans])
    assert (steps == PERIOD).sum() >= len(steps) - skipped
    assert len(scans) >= (heard.end - heard.start) / PERIOD - 70 - 30 * skipped
    for taxels in PARTS.values():
        last = -1
        for scan in scans:
            part = scan.received[taxels]
            assert part.all() or not part.any()
            if part.any():
                number = number_of(scan.counts[taxels])
                # Nothing broken, nothing twice, nothing old.
                assert number is not None and number > last
                taken = heard.start + number * PERIOD
                assert abs(taken - scan.stamp) <= 2 * PERIOD
                last = number
    # Every packet has one fate.
    packets = counted.get("frames", counted.get("datagrams"))
    assert sum(counted[fate] for fate in FATES) == packets - counted.get("refused", 0)
    queue = heard.queues["recognition"]
    assert (queue.dropped, queue.waiting) == (0, 0)
    # Counts that nobody pressed are never a touch.
    assert heard.detections == 0 and heard.of(Detection) == []


def struck(heard):
    [fault] = heard.device.faults
    assert fault.count > 0
    return fault


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_without_faults_every_scan_is_used(over):
    heard = Message(over, [], 4)
    check(heard)
    assert heard.received("left", 1, 4) == heard.received("middle", 1, 4) == 1.0
    counted = heard.counted
    assert counted["lost"] == counted["damaged"] == counted["foreign"] == 0
    assert sum(counted[fate] for fate in FATES) == heard.device.packets


@pytest.mark.parametrize("faults", [[], ["corrupt@1=0.05"], ["flip@1=0.0005"]])
def test_a_touch_is_detected_whatever_else_is_broken(faults):
    heard = Message("udp", faults, 4.5, touch=(3.0, 3.4))
    assert heard.detections == len(heard.of(Detection)) == 1
    [found] = heard.of(Detection)
    assert 2.9 < (found.onset - heard.start) / 1e9 < 3.1
    assert found.patch == "left"


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_one_bit_in_a_hundred_flipped_costs_what_it_strikes_and_no_more(over):
    heard = Message(over, ["flip@2.5-4=0.01"], 5.5)
    check(heard)
    assert struck(heard).count > 600
    assert heard.received("left", 1, 2.4) == 1.0 == heard.received("left", 5, 5.5)
    assert heard.received("left", 2.7, 4) < 0.3
    assert "damaged" in heard.kinds


@pytest.mark.parametrize("over", ["udp", "serial"])
@pytest.mark.parametrize(
    ("fault", "counter", "of"),
    [
        ("corrupt@2.5-4.5=0.01", "damaged", "count"),
        ("truncate@2.5-4.5=0.1", "damaged", "count"),
        ("lose@2.5-4.5=0.1", "lost", "data"),
        ("duplicate@2.5-4.5=0.1", "duplicate", "data"),
        ("wrong_patch@2.5-4.5=0.1", "foreign", "count"),
    ],
)
def test_broken_lost_doubled_and_strange_packets_are_counted_one_by_one(
    over, fault, counter, of
):
    heard = Message(over, [fault], 5)
    check(heard)
    assert heard.counted[counter] == getattr(struck(heard), of) > 0


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_packets_in_the_wrong_order_are_not_lost_and_none_is_used_late(over):
    heard = Message(over, ["reorder@2.5-4.5=0.1"], 5)
    check(heard)
    assert struck(heard).count > 10
    assert heard.counted["lost"] == heard.counted["damaged"] == 0


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_a_flood_of_garbage_is_thrown_away(over):
    heard = Message(over, ["garbage@2.5-4=100000"], 5)
    check(heard)
    assert struck(heard).count > 100_000
    assert heard.received("right", 1, 2.4) == 1.0 == heard.received("middle", 4.2, 5)


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_of_two_patches_with_one_address_on_one_line_neither_is_used(over):
    heard = Message(over, ["same_address:left,right@2.5"], 5.5, ports=1)
    check(heard)
    assert heard.received("left", 3.7, 5.5) == 0.0 == heard.received("right", 2.6, 5.5)
    assert heard.received("middle", 1, 5.5) == 1.0
    assert "conflict" in heard.kinds


def test_a_second_sender_of_an_address_is_not_heard_over_udp():
    heard = Message("udp", ["same_address:left,right@2.5"], 5)
    check(heard)
    assert heard.received("left", 1, 5) == heard.received("middle", 1, 5) == 1.0
    assert heard.received("right", 2.6, 5) == 0.0
    assert heard.counted["refused"] > 100 and "conflict" in heard.kinds


@pytest.mark.parametrize(
    ("over", "times", "cycle"), [("udp", 50, 0.6), ("serial", 5, 2)]
)
def test_a_patch_unplugged_and_replugged_is_there_each_time(
    over, times, cycle, tmp_path
):
    # A serial port is opened anew, and its patch heard at its next hello.
    begins = [2 + cycle * n for n in range(times)]
    faults = [f"unplug:left@{begin:.1f}-{begin + 0.1:.1f}" for begin in begins]
    end = 2.1 + cycle * times
    heard = Message(over, faults, end, folder=tmp_path)
    check(heard)
    assert [fault.count for fault in heard.device.faults] == [1] * times
    for begin in begins:
        assert heard.received("left", begin - 0.1, begin - 0.03) == 1.0
        assert heard.received("left", begin + 0.03, begin + 0.1) == 0.0
    assert heard.received("middle", 1, end) == 1.0


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ("reboot:left@2.5", "rebooted"),
        ("replace:left@2.5=1", "replaced"),
        ("clock_jump:left@2.5=10", "rebooted"),
        ("delay:left@2.5-3.5=0.3", None),
    ],
)
def test_a_module_that_begins_anew_or_is_late_is_never_old_data(fault, kind):
    heard = Message("udp", [fault], 5)
    check(heard)
    assert heard.received("middle", 1, 5) == 1.0
    assert heard.received("left", 2.5, 4) < 1.0
    if kind is not None:
        assert kind in heard.kinds
    # A module that replaces another waits to be tared.
    back = 0.0 if kind == "replaced" else 1.0
    assert heard.received("left", 4.2, 5) == back


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_a_device_clock_that_wraps_loses_nothing(over):
    heard = Message(over, ["wrap@2=1"], 4.5)
    check(heard)
    assert heard.received("left", 3, 4.5) == 1.0


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_a_stall_of_five_seconds_is_readings_without_data(over):
    heard = Message(over, ["stall@2.5-7.5"], 8.5)
    check(heard)
    for patch in PARTS:
        assert heard.received(patch, 2.6, 7.45) == 0.0
        assert heard.received(patch, 7.6, 8.5) == 1.0
    assert {"silent", "returned"} <= heard.kinds


def test_a_host_whose_date_is_set_notices_nothing(monkeypatch):
    clock = HostClock()
    transport = UdpTransport(clock)
    device = VirtualSkin(SKIN, [UdpPort("127.0.0.1", transport.port)], RATE)
    with playing(device, resting(400), clock):
        joints = FixedJoints(np.zeros(0))
        with DeviceSource(
            transport, MOUNTED, CALIBRATION, joints, clock, "udp:", grace=1.0
        ) as source:
            scans = [source.read(PATIENCE) for _ in range(25)]
            date = time.time_ns()
            monkeypatch.setattr(time, "time_ns", lambda: date - 3600 * 10**9)
            scans += [source.read(PATIENCE) for _ in range(25)]
    assert (np.diff([scan.stamp for scan in scans]) == PERIOD).all()
    assert all(scan.received.all() for scan in scans[30:])
