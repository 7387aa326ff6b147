"""Tests of gaps in recordings, and of stamps that are no nanoseconds."""

from dataclasses import replace

import pyarrow.parquet as parquet
import pytest

from eskin.drivers import STEPPED, ManualClock, replay_source
from eskin.errors import RecordingError
from eskin.exports.lerobot import write_lerobot
from eskin.recording import Label, read_recording
from eskin.sim.virtual import resample_scans
from eskin.units import format_duration
from helpers.cli import call
from helpers.live import SECOND, START, Press, mounted, record, scans

RATE = 50
SCANS = scans(mounted(), [Press(2.3, 2.7, 65, 65)], RATE, 4.0)
PERIOD = SECOND // RATE
HOUR = 3600
DAY = 24 * HOUR
YEAR = 365.25 * DAY
GAPS = [{100: 2.0}, {100: HOUR}, {60: 30 * DAY, 150: 10.0}, {1: 50 * YEAR}]
"""Durations of gaps [s] before scans of some numbers."""


LONGEST = 10.0
"""Longest silence that is played [s]."""


def find_played(gaps):
    """Return the stamps at which scans are played: no silence is longer than that."""
    return [
        scan.stamp for scan in separate({n: min(s, LONGEST) for n, s in gaps.items()})
    ]


def separate(gaps):
    """Return the scans with gaps before some of them, the last of which end now."""
    moved = []
    later = 0
    for number, scan in enumerate(reversed(SCANS), 1):
        moved.insert(0, replace(scan, stamp=scan.stamp - later))
        if seconds := gaps.get(len(SCANS) - number):
            later += round(seconds * SECOND) - PERIOD
    return moved


@pytest.fixture(params=GAPS, ids=str)
def gaps(request):
    return request.param


@pytest.fixture
def path(gaps, tmp_path):
    """Return a recording with gaps, and with a label after them."""
    label = Label(START + round(3.2 * SECOND), START + round(3.5 * SECOND), "poke")
    return record(tmp_path / "gaps.mcap", mounted(), separate(gaps), [label])


def test_recording_knows_its_gaps_whatever_their_length(path, gaps):
    recording = read_recording(path)
    assert recording.period == PERIOD
    assert [gap.seconds for gap in recording.gaps] == pytest.approx(
        [gaps[number] for number in sorted(gaps)]
    )
    silent = sum(gap.seconds for gap in recording.gaps)
    whole = (recording.end - recording.start) / SECOND
    assert recording.seconds == pytest.approx(whole - silent)
    assert recording.seconds < 4.0
    assert len(recording.runs) == len(gaps) + 1


def test_no_gap_is_where_a_few_scans_are_missing(tmp_path):
    some = [scan for n, scan in enumerate(SCANS) if n not in range(60, 75)]
    recording = read_recording(record(tmp_path / "lost.mcap", mounted(), some, []))
    assert recording.gaps == () and recording.describe_gaps() == ""
    slow = [replace(scan, stamp=n * 2 * SECOND) for n, scan in enumerate(SCANS[:30])]
    recording = read_recording(record(tmp_path / "slow.mcap", mounted(), slow, []))
    assert recording.gaps == () and recording.period == 2 * SECOND


def test_episode_ends_at_a_gap_and_holds_no_frame_of_it(path, gaps, tmp_path, caplog):
    counts = write_lerobot([read_recording(path)], tmp_path / "set")
    runs = [end - start for start, end in read_recording(path).runs if start < end]
    assert counts["episodes"] == len(runs)
    assert counts["frames"] == sum(run // PERIOD + 1 for run in runs)
    assert f"gaps.mcap: {len(gaps)} gap" in caplog.text
    rows = parquet.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet")
    tasks = [row["tasks"] for row in rows.to_pylist()]
    assert tasks[-1] == ["touch the skin: poke"]
    assert all(task == ["touch the skin"] for task in tasks[:-1])


def test_replay_prints_the_time_with_readings_and_the_gaps(path, capsys):
    code, out, _ = call(capsys, "replay", path)
    seconds = read_recording(path).seconds
    assert code == 0 and f"200 readings in {seconds:.1f} s" in out
    assert "besides" in out and "without readings" in out


@pytest.mark.parametrize("restamp", [False, True])
@pytest.mark.parametrize("pace", [1.0, STEPPED])
def test_played_source_shortens_gaps_and_tells_it(path, gaps, pace, restamp):
    """Stamps that are shifted to now have short gaps; others are those of the file."""
    expected = find_played(gaps)
    clock = ManualClock(START)
    source = replay_source(path, pace, clock, restamp)
    played = []
    events = []
    with source:
        while not source.ended:
            scan = source.read()
            assert source.clock.now() == scan.stamp
            played.append(scan.stamp)
            events += source.take_events()
    if pace == 1.0:
        passed = expected[-1] - expected[0]
        assert clock.now() - START == pytest.approx(passed, abs=9)
    skipped = [seconds for seconds in gaps.values() if seconds > LONGEST]
    assert [event.kind for event in events] == ["lost"] * len(skipped)
    assert all(event.text.startswith("skipped ") for event in events)
    assert {event.stamp for event in events} <= set(played)
    if restamp:
        assert played == [START + stamp - expected[0] for stamp in expected]
    else:
        assert played == [scan.stamp for scan in separate(gaps)]


def test_gap_is_skipped_once_though_it_is_waited_for_in_parts(path, gaps):
    source = replay_source(path, 1.0, ManualClock(START))
    found = []
    with source:
        while not source.ended:
            scan = source.read(timeout=0.003)
            found += [] if scan is None else [scan.stamp]
            assert len(source.take_events()) <= 1
    assert found == [scan.stamp for scan in separate(gaps)]


@pytest.mark.parametrize("rate", [RATE, 2 * RATE])
def test_device_plays_no_long_gap(gaps, rate):
    ticks = list(resample_scans(separate(gaps), rate))
    seconds = (find_played(gaps)[-1] - find_played(gaps)[0]) / SECOND
    assert len(ticks) == pytest.approx(seconds * rate, abs=len(gaps) + 1)


@pytest.mark.parametrize(("unit", "told"), [(1000, True), (10**6, True), (1, False)])
def test_stamps_that_are_no_nanoseconds_are_told(unit, told, tmp_path, caplog):
    shifted = [replace(s, stamp=(s.stamp - START + PERIOD) // unit) for s in SCANS]
    path = record(tmp_path / "us.mcap", mounted(), shifted, [])
    for _ in range(2):
        assert ("stamps are nanoseconds" in caplog.text) is told
        assert ("us.mcap: " in caplog.text) is told
        caplog.clear()
        read_recording(path)


@pytest.mark.parametrize("apart", [1, 1000, SECOND // 1000])
def test_readings_that_come_in_groups_have_the_rate_at_which_they_come(
    apart, tmp_path, caplog
):
    grouped = [
        replace(scan, stamp=START + 3 * PERIOD * (n // 3) + apart * (n % 3))
        for n, scan in enumerate(SCANS)
    ]
    path = record(tmp_path / "groups.mcap", mounted(), grouped, [])
    recording = read_recording(path)
    assert recording.period == pytest.approx(PERIOD, rel=0.02)
    assert not recording.gaps and not caplog.text


def test_lost_readings_do_not_change_the_rate(tmp_path):
    kept = [scan for n, scan in enumerate(SCANS) if n % 5]
    path = record(tmp_path / "lossy.mcap", mounted(), kept, [])
    assert read_recording(path).period == PERIOD


def test_impossible_rate_has_no_frames(tmp_path):
    fast = [replace(scan, stamp=20_000 * n) for n, scan in enumerate(SCANS[:50])]
    recording = read_recording(record(tmp_path / "a.mcap", mounted(), fast, []))
    with pytest.raises(
        RecordingError, match=r"a\.mcap: 50,000 scans a second; allowed"
    ):
        write_lerobot([recording], tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.04, "0.04 s"), (59.5, "59.50 s"), (60, "60 s")]
)
def test_duration_has_the_digits_that_matter(seconds, text):
    assert format_duration(seconds) == text


def test_rate_is_told_in_scans_a_second(tmp_path, caplog):
    fast = [replace(scan, stamp=20_000 * n) for n, scan in enumerate(SCANS[:50])]
    record(tmp_path / "fast.mcap", mounted(), fast, [])
    assert "50,000 scans a second" in caplog.text
