"""What is played comes as from a device: in order, at its pace, and then it ends."""

import math

import pytest

from eskin.drivers import STEPPED, HostClock, ManualClock, replay_source
from eskin.errors import RecordingError
from eskin.recording import RecordingWriter, write_all
from helpers.streams import (
    INFO,
    JOINTS,
    METADATA,
    SECOND,
    START,
    make_scans,
    played,
    same_scans,
)

SCANS = make_scans(20)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "a.mcap"
    arguments = INFO.robot_name, INFO.skin, INFO.calibration, METADATA, JOINTS
    with RecordingWriter(path, *arguments) as writer:
        write_all(writer, SCANS, ())
    return path


@pytest.mark.parametrize("pace", [0.5, 1.0, 8.0, STEPPED])
def test_every_scan_comes_once_and_in_order_at_any_pace(pace):
    with played(SCANS, pace) as source:
        assert same_scans(list(source), SCANS)
        assert source.ended
        assert source.read() is None
        assert source.counters() == {"readings": 20}


@pytest.mark.parametrize("pace", [0.5, 1.0, 8.0])
def test_a_scan_comes_when_its_stamp_is_due_by_the_clock(pace):
    clock = ManualClock(5 * SECOND)
    with played(SCANS, pace, clock) as source:
        for scan in source:
            passed = (clock.now() - 5 * SECOND) * pace
            assert passed == pytest.approx(scan.stamp - START, abs=pace + 1)


def test_stepped_needs_no_time():
    clock = ManualClock()
    with played(SCANS, STEPPED, clock) as source:
        before = clock.now()
        assert len(list(source)) == 20
        assert clock.now() == before


def test_a_scan_that_is_not_due_in_time_comes_later():
    clock = ManualClock()
    with played(SCANS, 1.0, clock) as source:
        assert source.read(0.0).stamp == START
        assert source.read(0.015) is None
        assert not source.ended
        assert source.read(0.015).stamp == SCANS[1].stamp


def test_scans_that_are_late_come_at_once_and_none_is_left_out():
    clock = ManualClock()
    with played(SCANS, 1.0, clock) as source:
        source.read()
        clock.sleep(10.0)
        now = clock.now()
        assert len(list(source)) == 19
        assert clock.now() == now


def test_anew_means_from_now_on():
    clock = ManualClock(7 * SECOND)
    with played(SCANS, 1.0, clock, restamp=True) as source:
        clock.sleep(3.0)
        stamps = [scan.stamp for scan in source]
    assert stamps == [10 * SECOND + scan.stamp - START for scan in SCANS]


@pytest.mark.parametrize("restamp", [False, True])
@pytest.mark.parametrize("pace", [0.5, 1.0, 8.0, STEPPED])
def test_by_the_sources_clock_a_scan_just_given_is_fresh(pace, restamp):
    with played(SCANS, pace, restamp=restamp) as source:
        for scan in source:
            age = source.clock.now() - scan.stamp
            assert abs(age) <= (0 if math.isinf(pace) else pace + 1)


@pytest.mark.parametrize("restamp", [False, True])
@pytest.mark.parametrize("pace", [2.0, STEPPED])
def test_the_sources_clock_never_goes_back(pace, restamp):
    clock = ManualClock(START + SECOND if restamp else SECOND)
    with played(SCANS, pace, clock, restamp) as source:
        times = [source.clock.now()]
        while not source.ended:
            source.read(0.007)
            times.append(source.clock.now())
        source.clock.sleep(1.0)
        times.append(source.clock.now())
    assert times == sorted(times)


def test_until_it_plays_the_clock_stands_at_the_first_stamp():
    clock = ManualClock(SECOND)
    with played(SCANS, 1.0, clock) as source:
        assert source.clock.now() == START
        clock.sleep(100.0)
        assert source.clock.now() == START
        assert source.read().stamp == START
        clock.sleep(0.5)
        assert source.clock.now() == START + SECOND // 2


def test_sleeping_by_the_sources_clock_lets_what_is_played_pass():
    with played(SCANS, 4.0) as source:
        source.read()
        before = source.clock.now()
        source.clock.sleep(2.0)
        assert source.clock.now() - before == 2 * SECOND


def test_closing_closes_what_is_played():
    closed = []

    def endless():
        try:
            yield from make_scans(100)
        finally:
            closed.append(1)

    scans = endless()
    source = played(scans)
    source.read()
    source.close()
    assert closed == [1]


def test_nothing_to_play_ends_at_once():
    with played([]) as source:
        assert source.ended
        assert list(source) == []


def test_closing_ends_it_twice_over(recording):
    source = replay_source(recording, STEPPED)
    source.read()
    source.close()
    source.close()
    assert source.ended
    assert source.read() is None


def test_a_recording_is_played_with_its_own_skin_and_joints(recording):
    with replay_source(recording, STEPPED, HostClock()) as source:
        info = source.info
        assert (info.robot_name, info.joint_names) == ("ur5", JOINTS)
        assert info.skin.count == INFO.skin.count
        assert info.calibration.to_bytes() == INFO.calibration.to_bytes()
        assert info.rate == pytest.approx(50.0)
        assert same_scans(list(source), SCANS)
        assert source.take_events() == []


def test_a_recording_in_real_time_takes_its_time(recording):
    clock = HostClock()
    with replay_source(recording, 1.0, clock, restamp=True) as source:
        began = clock.now()
        scans = list(source)
        assert clock.now() - began >= SCANS[-1].stamp - START
    assert scans[0].stamp >= began


@pytest.mark.parametrize("pace", [0.0, -1.0, math.nan])
def test_a_pace_that_leads_nowhere_is_refused(pace):
    with pytest.raises(ValueError, match="allowed are positive numbers; give 1"):
        played(SCANS, pace)


def test_a_recording_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RecordingError, match="no recording at"):
        replay_source(tmp_path / "gone.mcap")
