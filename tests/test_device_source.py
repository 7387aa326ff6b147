import os
import pty
import socket
import threading
import time
import tty
import zlib
from contextlib import ExitStack

import numpy as np
import pytest

from eskin.drivers import (
    Deframer,
    DeviceSource,
    FixedJoints,
    HostClock,
    ManualClock,
    SerialTransport,
    UdpTransport,
    encode_frame,
    encode_packet,
)
from eskin.errors import DeviceError, SkinMismatchError
from eskin.skin import MountedSkin
from helpers.modules import MS, PATCHES, SKIN, Module, Script, true_times
from helpers.touch import SECOND, START, build_grid_skin, calibration_of, one_link_robot

MOUNTED = MountedSkin(SKIN, one_link_robot())
PERIOD = 20 * MS
FATES = (
    "used duplicate late superseded incomplete damaged unknown foreign held hello "
    "status waiting"
).split()


def source_of(transport, clock, **more):
    return DeviceSource(
        transport,
        MOUNTED,
        calibration_of(SKIN),
        FixedJoints(np.zeros(0)),
        clock,
        "test:",
        **more,
    )


def scripted(arrivals, **more):
    """A source on a manual clock, and what it will hear."""
    clock = ManualClock(START)
    transport = Script(clock, arrivals)
    return source_of(transport, clock, **more), transport


def streams(begin, end, **more):
    """Bytes of all patches, as they arrive."""
    return [
        (arrived, port, encode_packet(packet))
        for n in range(PATCHES)
        for arrived, port, packet in Module(
            n, serial=n, boot=START - 7 * SECOND * n, **more
        ).stream(begin, end, phase=0.3 * n)
    ]


def play(source, until):
    scans = []
    while source.clock.now() < START + until * SECOND:
        scan = source.read(0.1)
        scans += [] if scan is None else [scan]
    return scans


def came(source):
    counted = source.counters()
    return sum(counted[fate] for fate in FATES)


def test_a_skin_is_read_at_the_rate_that_its_patches_promise():
    source, transport = scripted(streams(0, 3, rate=100))
    with source:
        assert source.info.rate == 100.0 and source.info.uri == "test:"
        scans = play(source, 2.9)
        true_times(scans, PERIOD / 2)
        assert sum(scan.received.all() for scan in scans) > 260
        assert source.counters()["readings"] == len(scans)
        assert not source.ended
    source.close()
    assert source.ended and transport.closed == 1
    assert source.read(1.0) is None and list(source) == []


def test_a_promised_rate_that_no_skin_has_is_not_believed():
    wild, usual = Module(0, rate=65_535), Module(1, rate=100)
    hellos = [
        (START, "a", encode_packet(module.hello(START))) for module in (wild, usual)
    ]
    source, _ = scripted(hellos)
    with source:
        assert source.info.rate == 100.0


def test_without_hellos_the_rate_is_fifty_and_readings_come_empty():
    source, _ = scripted([])
    with source:
        assert source.info.rate == 50.0
        scans = play(source, 5.0)
        assert len(scans) == pytest.approx(3.8 * 50, abs=3)
        assert not any(scan.received.any() for scan in scans)


def test_readings_that_nobody_took_are_not_counted_as_given():
    source, _ = scripted(streams(0, 5), rate=50.0)
    given = len(play(source, 2.0))
    source.clock.sleep(0.3)
    given += source.read(0.1) is not None
    for _ in range(2):
        counted = source.counters()
        assert counted["readings"] == given and counted["unread"] > 5
        source.close()


def test_a_read_that_times_out_gives_none():
    source, _ = scripted([], rate=1.0)
    with source:
        before = source.clock.now()
        assert source.read(0.25) is None
        assert source.clock.now() - before == 250 * MS


def test_a_source_that_stalls_goes_on_with_empty_readings_and_never_with_old_ones():
    late = START + 8 * SECOND
    arrivals = [
        (late if START + 3 * SECOND < when < late else when, port, data)
        for when, port, data in streams(0, 11)
    ]
    source, _ = scripted(arrivals)
    with source:
        scans = play(source, 10.9)
        true_times(scans, PERIOD)
        empty = [scan for scan in scans if not scan.received.any()]
        assert len(empty) >= 5 * 50 - 2 and scans[-2].received.all()
        assert came(source) == sum(when <= source.clock.now() for when, *_ in arrivals)


def damaged(data, rng):
    """A packet after a bad line: bits flipped, cut, or replaced by garbage."""
    fate = rng.random()
    if fate < 0.05:
        bits = np.unpackbits(np.frombuffer(data, np.uint8))
        bits ^= rng.random(len(bits)) < 0.01
        return np.packbits(bits).tobytes()
    if fate < 0.08:
        return data[: rng.integers(len(data))]
    return rng.bytes(rng.integers(1, 1500)) if fate < 0.12 else data


@pytest.mark.parametrize("seed", range(2))
def test_no_corrupt_packet_is_used_and_counters_add_up_to_what_was_sent(seed):
    rng = np.random.default_rng(seed)
    arrivals = []
    for when, port, data in streams(0, 10):
        if rng.random() > 0.1:
            when += round(rng.exponential(0.003) * SECOND)
            arrivals.append((when, port, damaged(data, rng)))
            if rng.random() < 0.05:
                arrivals.append(
                    (when + round(rng.uniform(0, 0.2) * SECOND), port, data)
                )
    source, transport = scripted(arrivals)
    with source:
        scans = play(source, 11)
        times = true_times(scans, PERIOD, slack=0.05)
        assert min(len(known) for known in times.values()) > 250
        assert not transport.coming and came(source) == len(arrivals)
        assert source.counters()["damaged"] > 60
        events = source.take_events()
    assert sum(event.kind == "damaged" for event in events) <= 6
    assert source.counters()["lost"] > 0


def test_packets_of_another_version_are_counted_and_said():
    hello = bytearray(encode_packet(Module(0).hello(START)))
    hello[0] = 2
    body = bytes(hello[:-4])
    data = body + zlib.crc32(body).to_bytes(4, "little")
    source, _ = scripted([(START + n * MS, "a", data) for n in range(50)])
    with source:
        play(source, 2.0)
        assert source.counters()["unknown"] == 50
        assert "update eskin" in source.take_events()[0].text


def test_a_calibration_of_another_skin_is_refused():
    clock = ManualClock()
    wrong = calibration_of(build_grid_skin(2, 2))
    joints = FixedJoints(np.zeros(0))
    with pytest.raises(SkinMismatchError, match="one gain a taxel"):
        DeviceSource(Script(clock, []), MOUNTED, wrong, joints, clock, "test:")


@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan"), 1e6])
def test_a_rate_that_no_skin_has_is_refused(rate):
    clock = ManualClock()
    with pytest.raises(DeviceError, match="scans a second"):
        source_of(Script(clock, []), clock, rate=rate)


def real_clock():
    """Real time, dated so that the counts can be tagged with it."""
    clock = HostClock()
    clock.offset += START - clock.now()
    return clock


def live(clock, send, seconds):
    """A thread that sends all patches' packets in real time; what it sent."""
    sent = []
    patches = [Module(n, serial=n) for n in range(PATCHES)]

    def run():
        begin = clock.now()
        for n in range(round(seconds * 50)):
            clock.sleep((begin + n * PERIOD - clock.now()) / SECOND)
            for module in patches:
                packets = module.data(clock.now())
                if n % 50 == 0:
                    packets.insert(0, module.hello(clock.now()))
                for packet in packets:
                    sent.append(encode_packet(packet))
                    send(module.address, sent[-1])

    thread = threading.Thread(target=run)
    thread.start()
    return thread, sent


def drain(source, thread):
    """All scans until the sender is done and its last packets were heard."""
    scans, end = [], None
    while end is None or time.monotonic() < end:
        scan = source.read(0.1)
        scans += [] if scan is None else [scan]
        if end is None and not thread.is_alive():
            end = time.monotonic() + 0.5
    thread.join()
    return scans


def test_a_skin_is_read_over_udp():
    clock = real_clock()
    transport = UdpTransport(clock)
    there = ("127.0.0.1", transport.port)
    with ExitStack() as stack:
        outs = [
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            for _ in range(PATCHES)
        ]
        source = stack.enter_context(source_of(transport, clock, rate=50.0))
        thread, sent = live(clock, lambda n, data: outs[n].sendto(data, there), 2.0)
        scans = drain(source, thread)
        assert came(source) == source.counters()["datagrams"] == len(sent)
        true_times(scans, PERIOD, slack=1.0)
        assert sum(scan.received.any() for scan in scans) > 50


def test_a_skin_is_read_over_serial_ports_with_several_patches_a_port():
    pairs = [pty.openpty() for _ in range(2)]
    for _, theirs in pairs:
        tty.setraw(theirs)
    clock = real_clock()
    paths = [os.ttyname(theirs) for _, theirs in pairs]
    transport = SerialTransport(clock, paths)
    lines = [pairs[n % 2][0] for n in range(PATCHES)]
    rng = np.random.default_rng(0)
    oracle = [Deframer(), Deframer()]

    def send(n, data):
        line = encode_frame(damaged(data, rng) or b"x")
        os.write(lines[n], line)
        oracle[n % 2].push(line)

    with source_of(transport, clock, rate=50.0) as source:
        thread, _ = live(clock, send, 2.0)
        scans = drain(source, thread)
        frames = sum(deframer.frames for deframer in oracle)
        assert came(source) == source.counters()["frames"] == frames
        true_times(scans, PERIOD, slack=1.0)
        assert sum(scan.received.any() for scan in scans) > 30
    for pair in pairs:
        for file in pair:
            os.close(file)
