"""Tests of sources: `DeviceSource` on any bytes, and `PlayedSource` at any pace."""

import math
import zlib

import numpy as np
import pytest

from eskin.drivers import (
    STEPPED,
    DeviceSource,
    FixedJoints,
    HostClock,
    ManualClock,
    encode_packet,
    replay_source,
)
from eskin.errors import DeviceError
from eskin.recording import RecordingWriter, write_all
from eskin.skin import MountedSkin
from helpers.modules import (
    MS,
    SKIN,
    Module,
    ScriptedTransport,
    check_scans,
    encode_arrivals,
    stream_all,
)
from helpers.streams import INFO, JOINTS, METADATA, make_scans, played, same_scans
from helpers.touch import SECOND, START, calibration_of, one_link_robot

SCANS = make_scans(20)
MOUNTED = MountedSkin(SKIN, one_link_robot())
PERIOD = 20 * MS


def open_device(transport, calibration=None, **options):
    return DeviceSource(
        transport,
        MOUNTED,
        calibration or calibration_of(SKIN),
        FixedJoints(np.zeros(0)),
        transport.clock,
        "test:",
        **options,
    )


def open_scripted(arrivals, **options):
    """Return a source to which bytes come at given times, by a manual clock."""
    return open_device(ScriptedTransport(ManualClock(START), arrivals), **options)


def read_until(source, until):
    scans = []
    while source.clock.now() < START + until * SECOND:
        scan = source.read(0.1)
        scans += [] if scan is None else [scan]
    return scans


def count_packets(source):
    return sum(source.assembler.outcomes.counts.values())


def test_skin_is_read_at_the_nominal_rate_of_its_patches():
    source = open_scripted(encode_arrivals(stream_all(0, 3, rate=100)))
    with source:
        assert (source.info.rate, source.info.uri) == (100.0, "test:")
        scans = read_until(source, 2.9)
        check_scans(scans, PERIOD / 2)
        assert sum(scan.received.all() for scan in scans) > 260
        assert source.counters()["readings"] == len(scans)
        assert not source.ended
    source.close()
    assert source.ended and source.transport.closed == 1
    assert source.read(1.0) is None and list(source) == []


@pytest.mark.parametrize(("rates", "rate"), [((65_535, 100), 100), ((), 50)])
def test_rate_is_that_of_a_plausible_hello_or_the_default(rates, rate):
    hellos = [
        (START, "a", Module(n, rate=rate).hello(START)) for n, rate in enumerate(rates)
    ]
    with open_scripted(encode_arrivals(hellos)) as source:
        assert source.info.rate == rate
        told = source.info.describe_rate()
        assert ("50 scans a second are assumed" in told) == (not rates)
        scans = read_until(source, 3.0)
    assert len(scans) == pytest.approx(1.8 * rate, abs=3)
    assert not any(scan.received.any() for scan in scans)


def test_unread_scans_are_not_counted_as_readings():
    source = open_scripted(encode_arrivals(stream_all(0, 3)), rate=50.0)
    given = len(read_until(source, 2.0))
    source.clock.sleep(0.3)
    given += source.read(0.1) is not None
    for _ in range(2):
        counters = source.counters()
        assert counters["readings"] == given and counters["unread"] > 5
        source.close()


def test_read_that_times_out_returns_none():
    with open_scripted([], rate=1.0) as source:
        before = source.clock.now()
        assert source.read(0.25) is None
        assert source.clock.now() - before == 250 * MS


def test_scans_of_a_stalled_transport_are_empty_and_never_old():
    late = START + 5 * SECOND
    arrivals = [
        (late if START + 2 * SECOND < when < late else when, *rest)
        for when, *rest in encode_arrivals(stream_all(0, 7))
    ]
    with open_scripted(arrivals) as source:
        scans = read_until(source, 6.9)
        check_scans(scans, PERIOD)
        empty = [scan for scan in scans if not scan.received.any()]
        assert len(empty) >= 3 * 50 - 2 and scans[-2].received.all()
        sent = sum(when <= source.clock.now() for when, *_ in arrivals)
        assert count_packets(source) == sent


def test_packets_of_another_version_are_counted_and_reported():
    body = b"\x03" + encode_packet(Module(0).hello(START))[1:-4]
    data = body + zlib.crc32(body).to_bytes(4, "little")
    with open_scripted([(START + n * MS, "a", data) for n in range(50)]) as source:
        read_until(source, 2.0)
        assert source.counters()["unknown"] == 50
        assert "version" in source.take_events()[0].text


def test_device_that_sends_no_byte_is_waited_for_no_longer_than_said():
    class Silent(ScriptedTransport):
        def counters(self):
            return {"bytes": 5 * (self.clock.now() >= START + 2 * SECOND)}

    with pytest.raises(DeviceError, match=r"test: sent no byte within 1\.5 s; allowed"):
        open_device(Silent(ManualClock(START), []), patience=1.5)
    open_device(Silent(ManualClock(START), []), patience=2.5).close()


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "a.mcap"
    header = (INFO.robot_name, INFO.skin, INFO.calibration, METADATA, JOINTS)
    with RecordingWriter(path, *header, INFO.mounted.robot.urdf) as writer:
        write_all(writer, SCANS, ())
    return path


@pytest.mark.parametrize("restamp", [False, True])
@pytest.mark.parametrize("pace", [0.5, 1.0, 8.0, STEPPED])
def test_scans_come_once_in_order_and_when_they_are_due(pace, restamp):
    clock = ManualClock(7 * SECOND)
    with played(SCANS, pace, clock, restamp) as source:
        clock.sleep(3.0)
        scans = []
        for scan in source:
            scans.append(scan)
            tolerance = 0 if math.isinf(pace) else pace + 1
            assert abs(source.clock.now() - scan.stamp) <= tolerance
            if not math.isinf(pace):
                due = 10 * SECOND + (SCANS[len(scans) - 1].stamp - START) / pace
                assert clock.now() == pytest.approx(due, abs=2)
        assert source.ended and source.read() is None
        assert source.counters() == {"readings": 20}
    if not restamp:
        assert same_scans(scans, SCANS)
    elif pace == 1.0:
        shift = 10 * SECOND - START
        assert [s.stamp for s in scans] == [s.stamp + shift for s in SCANS]
    if math.isinf(pace):
        assert clock.now() == 10 * SECOND


def test_scan_that_is_not_due_in_time_comes_later():
    with played(SCANS, 1.0) as source:
        assert source.read(0.0).stamp == START
        assert source.read(0.015) is None
        assert not source.ended
        assert source.read(0.015).stamp == SCANS[1].stamp


def test_late_scans_come_at_once():
    clock = ManualClock()
    with played(SCANS, 1.0, clock) as source:
        source.read()
        clock.sleep(10.0)
        now = clock.now()
        assert len(list(source)) == 19
        assert clock.now() == now


@pytest.mark.parametrize("restamp", [False, True])
@pytest.mark.parametrize("pace", [2.0, STEPPED])
def test_clock_of_the_source_never_goes_back(pace, restamp):
    clock = ManualClock(START + SECOND if restamp else SECOND)
    with played(SCANS, pace, clock, restamp) as source:
        times = [source.clock.now()]
        while not source.ended:
            source.read(0.007)
            times.append(source.clock.now())
        source.clock.sleep(1.0)
        times.append(source.clock.now())
    assert times == sorted(times)


def test_clock_of_the_source_starts_with_the_first_scan():
    clock = ManualClock(SECOND)
    with played(SCANS, 4.0, clock) as source:
        clock.sleep(100.0)
        assert source.clock.now() == START
        assert source.read().stamp == START
        clock.sleep(0.5)
        assert source.clock.now() == START + 2 * SECOND
        source.clock.sleep(2.0)
        assert source.clock.now() == START + 4 * SECOND


def test_closing_ends_the_source_and_what_it_plays():
    closed = []

    def play():
        try:
            yield from make_scans(100)
        finally:
            closed.append(1)

    source = played(play())
    source.read()
    source.close()
    source.close()
    assert closed == [1]
    assert source.ended and source.read() is None


def test_source_of_no_scans_has_ended():
    with played([]) as source:
        assert source.ended
        assert list(source) == []


def test_recording_is_replayed_with_its_own_skin_and_joints(recording):
    with replay_source(recording, STEPPED, HostClock()) as source:
        info = source.info
        assert (info.robot_name, info.joint_names) == ("elbow", JOINTS)
        assert info.skin.count == INFO.skin.count
        assert info.calibration.to_bytes() == INFO.calibration.to_bytes()
        assert info.rate == pytest.approx(50.0)
        assert same_scans(list(source), SCANS)
        assert source.take_events() == []
