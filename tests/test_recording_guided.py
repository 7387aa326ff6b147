"""Tests of guided recording: each gesture is labelled from its first contact on."""

import queue
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.cli.guided import WaitReporter
from eskin.cli.record import (
    LabelWriter,
    describe_event,
    find_awaited,
    record_attempts,
)
from eskin.cli.terminal import SkinPrinter
from eskin.drivers import STEPPED, ManualClock, PlayedSource, SourceInfo
from eskin.learn.dataset import prepare
from eskin.recording import Metadata, RecordingWriter, read_recording, write_all
from eskin.recording.guided import (
    MAX_SECONDS,
    RecordingAttempt,
    RecordingGuide,
    review_attempts,
)
from eskin.robot import load_robot
from eskin.skin import MountedSkin, mount_skin
from eskin.touch import Calibration, Scan
from eskin.touch.records import TouchConfig
from helpers.cli import assert_refused, call_json
from helpers.touch import SECOND, START, build_grid_skin, press_pad

SKIN = build_grid_skin()
MOUNTED = MountedSkin(SKIN, load_robot("table"))
CALIBRATION = Calibration.uniform(SKIN.count, 4095, 400.0)
PAD = press_pad(SKIN, (0.02, 0.02), kpa=1.0, radius=0.015)
RATE = 50
PAUSE = TouchConfig.pause_seconds


def make_guide(gestures=("knock", "none"), times=2):
    return RecordingGuide(MOUNTED, CALIBRATION, gestures, times)


def make_scans(touches, seconds, counts=200):
    """Yield noisy scans with touches from one time to another [s]."""
    rng = np.random.default_rng(3)
    for t in np.arange(round(seconds * RATE)) / RATE:
        pressed = any(start <= t < end for start, end in touches)
        noise = rng.normal(100, 1, SKIN.count)
        total = np.minimum(np.round(noise + counts * pressed * PAD), 4095)
        stamp = START + round(t * SECOND)
        received = np.ones(SKIN.count, bool)
        yield Scan(stamp, total.astype(np.int32), received, np.zeros(0))


def push_touches(guide, touches, seconds, counts=200):
    """Push such scans, and return the events."""
    scans = make_scans(touches, seconds, counts)
    return [event for scan in scans if (event := guide.push(scan))]


def test_gestures_are_asked_for_in_turns_and_labelled_where_they_are_made():
    guide = make_guide()
    touches = [(4.0, 4.3), (6.0, 6.1), (6.3, 6.4), (8.0, 9.0), (11.0, 11.5)]
    events = push_touches(guide, touches, 14.0)
    kinds = ["ready", *["began", "taken"] * 3, "began", "done"]
    assert [event.kind for event in events] == kinds
    assert guide.request is None
    assert [attempt.gesture for attempt in guide.attempts] == ["knock", "none"] * 2
    spans = [(4.0, 4.3), (6.0, 6.4), (8.0, 9.0), (11.0, 11.5)]
    for attempt, span in zip(guide.attempts, spans, strict=True):
        found = (np.array([attempt.label.start, attempt.label.end]) - START) / SECOND
        np.testing.assert_allclose(found, span, atol=0.05)


def test_touch_before_the_skin_is_tared_is_no_attempt():
    guide = make_guide()
    events = push_touches(guide, [(1.0, 1.5), (6.0, 6.5)], 8.0)
    assert [event.kind for event in events] == ["touched", "ready", "began", "taken"]
    assert "'p0' is touched" in events[0].text


def drop_scans(scans, start, end):
    """Yield the scans that are not within some seconds."""
    for scan in scans:
        if not start <= (scan.stamp - START) / SECOND < end:
            yield scan


@given(
    start=st.floats(3.4, 6.2),
    pause=st.sampled_from([0.1, 0.2, 0.5, 1.0, 2.0, 3.0]),
    length=st.floats(0.2, 1.6),
)
@settings(max_examples=40, deadline=None)
def test_touch_is_labelled_as_a_whole_or_refused_however_late_readings_are(
    start, pause, length
):
    guide = make_guide(("rub",), times=1)
    events = []
    for scan in drop_scans(
        make_scans([(4.0, 4.0 + length)], 11.0), start, start + pause
    ):
        event = guide.push(scan)
        events += [] if event is None else [event]
    refused = [event.text for event in events if event.kind == "refused"]
    for attempt in guide.attempts:
        found = (np.array([attempt.label.start, attempt.label.end]) - START) / SECOND
        np.testing.assert_allclose(found, (4.0, 4.0 + length), atol=PAUSE + 1 / RATE)
    seen = max(0.0, start - 4.0) + max(0.0, 4.0 + length - start - pause)
    assert guide.attempts or refused or seen < 3 / RATE
    if refused:
        assert all("no scan came for" in text for text in refused)


@pytest.mark.parametrize(("late", "goes_on"), [(0.0, True), (0.05, True), (0.2, False)])
def test_touch_before_anybody_can_react_is_of_the_gesture_before(late, goes_on):
    guide = make_guide(("knock", "none"))
    again = 4.3 + PAUSE + 0.02 + late
    touches = [(3.9, 4.3), (again, again + 0.3), (7.0, 7.5)]
    events = push_touches(guide, touches, 9.0)
    taken = [event for event in events if event.kind == "taken"]
    assert [event.goes_on for event in taken] == [False, goes_on, False]
    ends = [again + 0.3, 7.5] if goes_on else [4.3, again + 0.3, 7.5]
    found = [(attempt.end - START) / SECOND for attempt in guide.attempts]
    np.testing.assert_allclose(found, ends, atol=0.05)
    named = [attempt.gesture for attempt in guide.attempts]
    assert named == ["knock", "none", "knock"][: len(ends)]


def test_last_gesture_may_go_on():
    guide = make_guide(("knock",), times=1)
    again = 4.3 + PAUSE + 0.06
    for scan in make_scans([(3.9, 4.3), (again, again + 0.3)], 8.0):
        guide.push(scan)
        if guide.is_over:
            break
    [attempt] = guide.attempts
    assert (attempt.end - START) / SECOND == pytest.approx(again + 0.3, abs=0.05)


def test_touch_while_the_request_is_changed_is_refused():
    guide = make_guide(("knock", "none"))
    events = []
    for scan in make_scans([(4.0, 5.0)], 8.0):
        if scan.stamp == START + round(3.98 * SECOND):
            guide.skip()
        event = guide.push(scan)
        events += [] if event is None else [event]
    assert [event.kind for event in events] == ["ready", "began", "refused"]
    assert "before it was asked for" in events[-1].text


def test_touch_on_a_patch_that_is_lost_meanwhile_is_refused_by_its_name():
    guide = make_guide(("knock",))
    events = []
    for scan in make_scans([(4.0, 5.0)], 8.0):
        if scan.stamp >= START + 4.5 * SECOND:
            scan = replace(scan, received=np.zeros(SKIN.count, bool))
        event = guide.push(scan)
        events += [] if event is None else [event]
    assert [event.kind for event in events] == ["ready", "began", "refused"]
    assert "'p0' had no valid data" in events[-1].text


def wait_for_touch(touches, seconds, counts):
    """Return what a person who is waited for is told."""
    guide = make_guide()
    waiting = WaitReporter(SKIN, "a touch has 0.7 kPa or more")
    told = []
    for scan in make_scans(touches, seconds, counts):
        guide.push(scan)
        told.append(waiting.describe_wait(guide.state, find_awaited(guide)))
    return [text for text in told if text]


def test_after_ten_seconds_it_is_told_that_nothing_was_felt():
    first, second = wait_for_touch([], 23.5, 0)
    assert first.startswith("nothing was felt for 10 s; the highest pressure was ")
    assert "nothing was felt for 20 s" in second and "0.7 kPa" in second


def test_what_was_too_weak_for_a_touch_is_told():
    [text] = wait_for_touch([(5.0, 5.02)], 13.5, 14)
    assert "no touch was long or firm enough for 10 s; last felt: 0." in text
    assert "of patch 'p0', " in text and "s ago" in text


def test_nothing_is_told_while_gestures_are_made():
    touches = [(4.0 + 5 * n, 4.5 + 5 * n) for n in range(4)]
    assert wait_for_touch(touches, 25.0, 200) == []


def test_hand_that_stays_on_the_skin_before_it_is_tared_is_told():
    # Rest is taken with the first scans, so the hand comes after them.
    texts = wait_for_touch([(1.0, 30.0)], 25.0, 200)
    assert texts and all("hands off: not at rest yet" in text for text in texts)
    assert "of patch 'p0'" in texts[0]


def test_last_attempt_is_dropped_once_and_asked_for_again():
    guide = make_guide()
    push_touches(guide, [(4.0, 4.3), (6.0, 6.3)], 8.0)
    [*_, last] = guide.attempts
    assert last.gesture == "none" and guide.again() is last and guide.again() is None
    assert (guide.request, len(guide.attempts)) == ("none", 1)


def test_gesture_that_is_left_out_is_asked_for_no_more():
    guide = make_guide()
    guide.skip()
    assert guide.request == "none"


@pytest.mark.parametrize("gestures", [("knock", "none"), ("knock",)])
def test_touch_during_which_its_gesture_is_left_out_is_no_attempt(gestures):
    guide = make_guide(gestures)
    for scan in make_scans([(4.0, 5.0)], 8.0):
        event = guide.push(scan)
        if event is not None and event.kind == "began":
            guide.skip()
        if event is not None and event.kind == "refused":
            assert "meanwhile" in event.text
            break
    else:
        pytest.fail("no touch was refused")
    assert not guide.attempts


def test_touch_that_lasts_too_long_is_refused():
    guide = make_guide()
    end = 4.5 + MAX_SECONDS
    events = push_touches(guide, [(4.0, end)], end + 2.0)
    assert [event.kind for event in events] == ["ready", "began", "refused"]
    assert "lasted" in events[-1].text and not guide.attempts


@pytest.mark.parametrize("counts", [200, 5000])
def test_touch_at_full_scale_is_taken_and_told(counts):
    guide = make_guide()
    events = push_touches(guide, [(4.0, 4.5)], 6.0, counts)
    assert [event.kind for event in events] == ["ready", "began", "taken"]
    is_told = "at full scale" in describe_event(events[-1])
    assert is_told == (counts == 5000) == (guide.attempts[0].saturated > 0)


def make_attempt(gesture, *features):
    end = START + SECOND
    return RecordingAttempt(gesture, START, end, 1.0, 4, 0, np.array(features))


def test_review_names_what_is_few_and_what_is_alike():
    apart = [make_attempt("a", 0.0, n / 9) for n in range(6)]
    apart += [make_attempt("b", 3.0, n / 9) for n in range(6)]
    review = review_attempts(apart, ("a", "b", "c"))
    assert (review.nearest_right, review.confused, review.few) == (12, None, ("c",))
    alike = [make_attempt("ab"[n % 2], 0.0, n) for n in range(8)]
    assert review_attempts(alike, ("a", "b")).confused == ("a", "b", 4)


@pytest.fixture
def played(tmp_path):
    """Return a recording of long and short touches in turns."""
    spans = [(4.0 + 2 * n, 4.2 + 2 * n + 0.6 * (n % 2)) for n in range(6)]
    path = tmp_path / "played.mcap"
    with RecordingWriter(path, "table", SKIN, CALIBRATION, Metadata()) as writer:
        write_all(writer, make_scans(spans, 17.0), [])
    return path


def test_recorded_gestures_are_labelled_and_learned_from(played, tmp_path, capsys):
    out = tmp_path / "mine.mcap"
    words = ["--out", out, "--gestures", "tap", "hold", "--times", 3, "--person", "ann"]
    found, printed = call_json(capsys, "record", f"replay:{played}", *words)
    assert found["takes"] == {"tap": 3, "hold": 3} and found["few"] == ["tap", "hold"]
    assert found["nearest_right"] == 6
    # Nobody can type where stdin is no terminal.
    assert "Ctrl-C finishes" in printed and "a: again" not in printed
    assert "hold (3 of 3): touch now" in printed
    mine = read_recording(out)
    assert [label.gesture for label in mine.labels] == ["tap", "hold"] * 3
    assert mine.metadata.subject == "ann"
    assert len(prepare([out]).segments) == 6


def test_attempt_is_written_once_where_the_next_one_is_dropped(monkeypatch, tmp_path):
    typed = queue.SimpleQueue()
    monkeypatch.setattr("eskin.cli.record.listen_to_keys", lambda: typed)
    guide = make_guide()
    path = tmp_path / "mine.mcap"
    spans = [(4.0, 4.5), (6.0, 6.5), (8.0, 8.5)]

    def type_again():
        for scan in make_scans(spans, 10.0):
            if scan.stamp == START + 7 * SECOND:
                typed.put("a")
            yield scan

    source = PlayedSource(
        SourceInfo("test:", mount_skin(SKIN, "table"), CALIBRATION, float(RATE)),
        type_again(),
        STEPPED,
        ManualClock(),
    )
    with RecordingWriter(path, "table", SKIN, CALIBRATION, Metadata()) as writer:
        labels = LabelWriter(writer)
        record_attempts(source, guide, writer, SkinPrinter(SKIN), labels)
        labels.write(guide.attempts)
    names = [label.gesture for label in read_recording(path).labels]
    assert names == ["knock", "none"]


def test_gesture_that_went_on_is_written_once_and_as_a_whole(tmp_path, capsys):
    path = tmp_path / "played.mcap"
    again = 6.3 + PAUSE + 0.04
    spans = [(4.0, 4.3), (6.0, 6.3), (again, again + 0.3), (9.0, 9.5), (11.0, 11.5)]
    with RecordingWriter(path, "table", SKIN, CALIBRATION, Metadata()) as writer:
        write_all(writer, make_scans(spans, 13.0), [])
    out = tmp_path / "mine.mcap"
    words = ["--out", out, "--gestures", "knock", "hold", "--times", 2]
    _, printed = call_json(capsys, "record", f"replay:{path}", *words)
    assert printed.count("it went on: ") == 1
    labels = read_recording(out).labels
    assert [label.gesture for label in labels] == ["knock", "hold"] * 2
    found = [(label.end - label.start) / SECOND for label in labels]
    np.testing.assert_allclose(found, [0.3, again - 5.7, 0.5, 0.5], atol=0.05)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--gestures a", ["--gestures are a", "2 to 50", "none"]),
        ("--gestures a a", ["--gestures are a, a", "different"]),
        ("--gestures Tap tap", ["'Tap' and 'tap'", "one spelling"]),
        ("--gestures unknown tap", ["'unknown'", "own word"]),
        ("--gestures a b --times 0", ["--times is 0", "1 to 1000"]),
    ],
)
def test_bad_options_are_refused(words, parts, played, tmp_path, capsys):
    options = ["--out", tmp_path / "mine.mcap", *words.split()]
    for part in parts:
        assert_refused(capsys, "record", f"replay:{played}", *options, part=part)
    assert not list(tmp_path.glob("mine*"))
