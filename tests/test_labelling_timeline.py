"""Tests of `eskin view`: the timeline of a recording, and its labels."""

import re

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.errors import RecordingError
from eskin.labelling.editing import (
    LabelEditor,
    compute_envelope,
    load_replayed,
    match_detections,
)
from eskin.labelling.timeline import PlaybackClock, Timeline
from eskin.page.server import open_server
from eskin.recording import read_recording
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from helpers import live
from helpers.timelines import make_detection, make_label, to_stamp, write_recording

LABELS = (make_label("poke", 1.0, 1.4), make_label("grab", 3.0, 4.0))
DETECTIONS = (
    make_detection("poke", 1.0, 1.6),
    make_detection("stroke", 3.0, 4.2),
    make_detection("poke", 5.0, 5.2),
)


@pytest.fixture
def path(tmp_path):
    return write_recording(tmp_path / "a.mcap", LABELS, DETECTIONS)


@pytest.fixture
def editor(path):
    return LabelEditor(read_recording(path))


def gestures(path):
    return [label.gesture for label in read_recording(path).labels]


def test_loaded_recording_has_pressure_of_every_reading(path):
    recording = read_recording(path)
    loaded = load_replayed(recording)
    assert len(loaded.seconds) == recording.count == 300
    pressed = loaded.at(1.2)
    free = loaded.at(2.5)
    assert loaded.pressure[pressed, :10].min() > 10 and loaded.pressure[free].max() < 1
    force = loaded.pressure[pressed].astype(float) @ (1e3 * recording.skin.areas)
    assert loaded.force[pressed] == pytest.approx(force, rel=1e-3)
    assert loaded.peak[free] < 1 < loaded.peak[pressed]
    times = -1.0, 1.0, 1.019, 1.021, 1e9
    assert [loaded.at(seconds) for seconds in times] == [0, 50, 50, 51, 299]


def test_view_shows_the_pressures_that_a_live_recogniser_sees(tmp_path):
    """Also those of taxels that it finds faulty, as one that is stuck."""
    path = live.record(tmp_path / "a.mcap", live.mounted(), live.list_faulty_scans())
    recording = read_recording(path)
    loaded = load_replayed(recording)
    states = list(live.replay(recording))
    assert loaded.group == 1 and not loaded.valid.all()
    for row, reading in enumerate(states):
        shown = np.where(reading.valid, np.maximum(reading.pressure, 0.0), 0.0)
        np.testing.assert_array_equal(loaded.pressure[row], shown.astype(np.float16))
        np.testing.assert_array_equal(loaded.valid[row], reading.valid)


@pytest.mark.parametrize("bins", [1, 3, 500, 1000, 5000])
def test_envelope_keeps_peaks(bins):
    values = np.zeros(1000)
    values[777] = 5.0
    assert compute_envelope(values, bins).max() == 5.0
    assert len(compute_envelope(values, bins)) == min(bins, 1000)


def test_playback_advances_at_its_speed_and_stops_at_end():
    clock = PlaybackClock(10.0)
    assert not clock.advance(1.0) and clock.seconds == 0.0
    clock.toggle()
    clock.speed = 2.0
    assert clock.advance(1.5) and clock.seconds == 3.0
    clock.advance(100.0)
    assert clock.seconds == 10.0 and not clock.is_on
    clock.toggle()
    assert clock.seconds == 0.0 and clock.is_on
    clock.seek(-5.0)
    assert clock.seconds == 0.0


def test_editor_adds_changes_and_removes_label(editor):
    added = editor.set_range("stroke", 4.5, 5.0)
    assert added in editor.labels and editor.changed
    changed = editor.set_range("double_pat", 4.6, 5.1)
    assert added not in editor.labels
    assert (changed.start, changed.end) == (to_stamp(4.6), to_stamp(5.1))
    editor.remove(changed)
    assert tuple(editor.labels) == LABELS


@pytest.mark.parametrize(("start", "end"), [(5.0, 5.0), (0.5, 3.5), (2.0, 1.2)])
def test_invalid_label_changes_nothing(editor, start, end):
    with pytest.raises(RecordingError):
        editor.set_range("stroke", start, end)
    assert tuple(editor.labels) == LABELS and not editor.changed


@pytest.mark.parametrize("name", ["Grab", "double pat", "Wave"])
def test_label_is_spelled_as_the_others_and_the_vocabulary_are(path, name):
    editor = LabelEditor(read_recording(path), ["wave", "GRAB", "double_pat"])
    with pytest.raises(RecordingError, match="differ only in case"):
        editor.set_range(name, 4.5, 5.0)
    assert tuple(editor.labels) == LABELS
    for right in ("grab", "double_pat", "wave", "Мой взмах"):
        editor.set_range(right, 4.5, 5.0)


def test_only_label_of_a_gesture_is_renamed(editor):
    editor.set_range("wave", 4.5, 5.0)
    assert editor.set_range("Wave", 4.5, 5.0) in editor.labels


def test_saving_writes_labels_and_keeps_original(path, editor):
    original = path.read_bytes()
    editor.set_range("double_pat", 1.0, 1.5)
    kept = editor.save()
    assert gestures(path) == ["double_pat", "grab"] and not editor.changed
    saved = read_recording(path)
    before = read_recording(kept)
    assert (saved.count, saved.detections) == (before.count, before.detections)
    editor.remove(editor.labels[0])
    assert editor.save() == kept and kept.read_bytes() == original
    assert gestures(path) == ["grab"]


def test_saved_label_becomes_true_beside_automatic_one(tmp_path):
    automatic = make_label("poke", 1.0, 1.4, "auto")
    path = write_recording(tmp_path / "a.mcap", [automatic], seconds=2.0)
    editor = LabelEditor(read_recording(path))
    editor.set_range("poke", 1.0, 1.5)
    editor.save()
    labels = read_recording(path).labels
    assert automatic in labels and make_label("poke", 1.0, 1.5) in labels


def test_labels_are_compared_with_their_detections():
    missed = make_label("grab", 8.0, 8.2)
    said_none = make_detection("none", 8.0, 8.3)
    pairs = match_detections((*LABELS, missed), (*DETECTIONS, said_none))
    assert [(pair.label, pair.detection, pair.is_right) for pair in pairs] == [
        (LABELS[0], DETECTIONS[0], True),
        (LABELS[1], DETECTIONS[1], False),
        (None, DETECTIONS[2], False),
        (missed, None, False),
    ]


@pytest.mark.slow
def test_view_command_serves_recording_and_leaves_it_alone(path, capsys):
    words = ["--port", "0", "--seconds", "0.3", "--json"]
    before = path.read_bytes()
    assert run(["view", str(path), "--model", "ur5", *words]) == 0
    lines = capsys.readouterr().out.splitlines()
    # It stands alone, so that a click or a copy takes it all.
    assert any(re.fullmatch(r"http://127\.0\.0\.1:\d+/\S+/", line) for line in lines)
    assert path.read_bytes() == before and list(path.parent.iterdir()) == [path]


def pair_slowly(labels, detections):
    """Pair labels with detections by looking at all of them for each label."""
    left = list(detections)
    pairs = []
    for label in sorted(labels):
        near = [x for x in left if label.start <= x.stamp < label.end + 1_000_000_000]
        best = min(
            near, key=lambda x: (x.gesture != label.gesture, x.stamp), default=None
        )
        if best is not None:
            left.remove(best)
        pairs.append((label, best))
    return pairs


@pytest.mark.parametrize("seed", range(8))
def test_each_label_gets_first_detection_left_of_its_gesture_else_of_any(seed):
    rng = np.random.default_rng(seed)
    names = ("poke", "grab", "stroke")
    labels = [
        make_label(rng.choice(names), start, start + rng.uniform(0.01, 4.0))
        for start in rng.uniform(0.0, 20.0, 30)
    ]
    detections = [
        make_detection(rng.choice(names), 0.0, time)
        for time in rng.uniform(0.0, 24.0, 40)
    ]
    found = [x for x in match_detections(labels, detections) if x.label]
    expected = dict(pair_slowly(labels, detections))
    assert {pair.label: pair.detection for pair in found} == expected


def test_long_recording_is_held_in_groups_that_keep_their_peaks(path, monkeypatch):
    whole = load_replayed(read_recording(path))
    monkeypatch.setattr("eskin.labelling.editing.MAX_LOADED_BYTES", 20_000)
    loaded = load_replayed(read_recording(path))
    size = loaded.pressure.nbytes + loaded.valid.nbytes + loaded.q.nbytes
    assert loaded.group > 1 and size <= 20_000
    peaks = np.maximum.reduceat(whole.peak, np.arange(0, 300, loaded.group))
    np.testing.assert_array_equal(loaded.peak, peaks)
    np.testing.assert_array_equal(loaded.pressure.max(axis=1), peaks.astype(np.float16))
    np.testing.assert_array_equal(loaded.seconds, whole.seconds[:: loaded.group])


@pytest.fixture
def timeline(editor):
    """The timeline of the recording on a server of its own."""
    server = open_server(0, "token")
    try:
        mounted = MountedSkin(editor.recording.skin, load_robot("table"))
        loaded = load_replayed(editor.recording)
        yield Timeline(server, mounted, loaded, editor, editor.recording.detections)
    finally:
        server.stop()


def spans(editor):
    return [
        (x.gesture, editor.seconds(x.start), editor.seconds(x.end))
        for x in editor.labels
    ]


@pytest.mark.slow
def test_range_is_labelled_with_any_name_by_keys_and_changes_are_undone(
    timeline, editor
):
    before = spans(editor)
    timeline.clock.seek(4.5)
    timeline.press("I")
    timeline.clock.seek(5.0)
    timeline.press("O")
    assert timeline.span() == (4.5, 5.0)
    timeline.attempt(lambda: timeline.label(" мой взмах"))
    assert spans(editor) == [*before, ("мой взмах", 4.5, 5.0)]
    assert timeline.names[:3] == ("grab", "poke", "мой взмах")
    timeline.press("2")
    assert spans(editor) == [*before, ("poke", 4.5, 5.0)]
    timeline.press("delete")
    assert spans(editor) == before
    for expected in ("poke", "мой взмах", "grab", "grab"):
        timeline.press("Z")
        assert editor.labels[-1].gesture == expected
    assert spans(editor) == before and "nothing to undo" in timeline.note.content


@pytest.mark.slow
def test_arrow_keys_move_and_choose_labels_whose_range_can_be_changed(timeline, editor):
    timeline.press("arrowright")
    assert timeline.clock.seconds == pytest.approx(0.1)
    timeline.press("arrowdown")
    assert timeline.span() == (1.0, 1.4) and timeline.gesture.value == "poke"
    timeline.press("arrowdown")
    timeline.press("arrowdown")
    assert timeline.span() == (3.0, 4.0)
    timeline.press("arrowup")
    timeline.clock.seek(1.5)
    timeline.press("O")
    timeline.press("2")
    assert spans(editor)[0] == ("poke", 1.0, 1.5)
    timeline.range.value = (0.5, 3.5)
    timeline.press("1")
    assert spans(editor)[0] == ("poke", 1.0, 1.5)
    assert "overlap" in timeline.note.content
    timeline.press("space")
    assert timeline.clock.is_on


@pytest.mark.slow
def test_label_and_detection_of_the_instant_are_shown_while_playing(timeline):
    for seconds, parts in (
        (0.5, ("no label", "<b>-</b>")),
        (1.2, ("<b>poke</b>", "<b>poke 90%</b>")),
        (3.5, ("<b>grab</b>", "<b>stroke 90%</b>")),
    ):
        timeline.clock.seek(seconds)
        timeline.tick(0.0)
        for part in parts:
            assert part in timeline.status.content
    assert "1 of 3 match" in timeline.table.content


@pytest.mark.slow
def test_every_gesture_has_its_place_and_colour_in_the_plot(timeline, editor):
    editor.set_range("wave", 4.507, 4.508)
    timeline.list_labels()
    plot = timeline.overview.plot
    series = [entry["label"] for entry in plot.series]
    data = plot.data
    assert len(series) == len(data) and "wave" in series
    times = data[0]
    shown = data[series.index("wave")] > 0
    assert shown.any() and np.abs(times[shown] - 4.5).max() < 0.05
    fills = [
        entry["fill"] for entry in timeline.overview.plot.series if "fill" in entry
    ]
    assert len(set(fills)) == len(fills)
