import numpy as np
import pytest

from eskin.cli.main import run
from eskin.errors import RecordingError
from eskin.recording import Label, read_recording
from eskin.viewer.editing import LabelEditor, compare, envelope, load_replayed
from eskin.viewer.timeline import PlaybackClock
from helpers.timelines import said, stamp, write_recording

PRESSES = (("poke", 1.0, 1.4), ("grab", 3.0, 4.0))


@pytest.fixture
def recording(tmp_path):
    heard = (said("poke", 1.0, 1.6), said("stroke", 3.0, 4.2), said("poke", 5.0, 5.2))
    return read_recording(write_recording(tmp_path / "a.mcap", PRESSES, heard))


def test_a_take_holds_every_reading_with_its_pressure(recording):
    take = load_replayed(recording)
    assert len(take.seconds) == recording.count == 300
    pressed, free = take.at(1.2), take.at(2.5)
    assert take.pressure[pressed, :10].min() > 10 and take.pressure[free].max() < 1
    areas = 1e3 * recording.skin.areas
    assert take.force[pressed] == pytest.approx(
        take.pressure[pressed].astype(float) @ areas, rel=1e-3
    )
    assert take.peak[free] < 1 < take.peak[pressed]


def test_the_reading_at_a_time_is_the_latest_one_by_then(recording):
    take = load_replayed(recording)
    assert take.at(-1.0) == 0
    assert take.at(1.0) == 50 and take.at(1.019) == 50 and take.at(1.021) == 51
    assert take.at(1e9) == 299


def test_no_peak_is_lost_in_the_overview():
    values = np.zeros(1000)
    values[777] = 5.0
    for bins in (1, 3, 500, 1000, 5000):
        assert envelope(values, bins).max() == 5.0
        assert len(envelope(values, bins)) == min(bins, 1000)


def test_playing_passes_time_at_its_speed_and_stops_at_the_end():
    playing = PlaybackClock(10.0)
    assert not playing.advance(1.0) and playing.seconds == 0.0
    playing.toggle()
    playing.speed = 2.0
    assert playing.advance(1.5) and playing.seconds == 3.0
    playing.advance(100.0)
    assert playing.seconds == 10.0 and not playing.is_on
    playing.toggle()
    assert playing.seconds == 0.0 and playing.is_on
    playing.seek(-5.0)
    assert playing.seconds == 0.0


def test_a_label_is_set_mended_and_removed(recording):
    editing = LabelEditor(recording)
    added = editing.add("stroke", 4.5, 5.0)
    assert added in editing.labels and editing.changed
    mended = editing.change(added, "double_pat", 4.6, 5.1)
    assert added not in editing.labels
    assert (mended.start, mended.end) == (stamp(4.6), stamp(5.1))
    editing.remove(mended)
    assert [label.gesture for label in editing.labels] == ["poke", "grab"]


@pytest.mark.parametrize(("start", "end"), [(1.2, 2.0), (5.0, 5.0), (0.5, 3.5)])
def test_a_label_that_cannot_be_changes_nothing(recording, start, end):
    editing = LabelEditor(recording)
    before = editing.labels
    with pytest.raises(RecordingError):
        editing.add("stroke", start, end)
    assert editing.labels == before and not editing.changed


def test_saving_writes_the_labels_and_keeps_the_recording_as_it_was(recording):
    original = recording.path.read_bytes()
    editing = LabelEditor(recording)
    editing.change(editing.labels[0], "double_pat", 1.0, 1.5)
    kept = editing.save()
    assert kept.read_bytes() == original
    again = read_recording(recording.path)
    assert [x.gesture for x in again.labels] == ["double_pat", "grab"]
    assert again.count == recording.count
    assert again.detections == recording.detections
    assert not editing.changed
    editing.remove(editing.labels[0])
    assert editing.save() == kept
    assert kept.read_bytes() == original
    assert [x.gesture for x in read_recording(recording.path).labels] == ["grab"]


def test_what_a_person_saves_is_true_and_other_labels_stay(tmp_path):
    auto = Label(stamp(1.0), stamp(1.4), "poke", "auto")
    path = write_recording(tmp_path / "a.mcap", PRESSES, labels=[auto])
    editing = LabelEditor(read_recording(path))
    editing.change(editing.labels[0], "poke", 1.0, 1.5)
    editing.save()
    labels = read_recording(path).labels
    assert auto in labels
    assert Label(stamp(1.0), stamp(1.5), "poke", "true") in labels


def test_each_label_has_its_own_detection_and_what_is_left_is_shown(recording):
    pairs = compare(recording.labels, recording.detections)
    told = [
        (
            pair.label and pair.label.gesture,
            pair.detection and pair.detection.gesture,
            pair.is_right,
        )
        for pair in pairs
    ]
    assert told == [
        ("poke", "poke", True),
        ("grab", "stroke", False),
        (None, "poke", False),
    ]


def test_a_label_nobody_spoke_of_is_a_miss():
    label = Label(stamp(1.0), stamp(1.2), "poke")
    (pair,) = compare([label], [said("none", 1.0, 1.3)])
    assert pair.detection is None and not pair.is_right


def test_view_serves_a_recording_and_leaves_it_alone(recording, capsys):
    before = recording.path.read_bytes()
    words = ["view", str(recording.path), "--port", "0", "--seconds", "0.3", "--json"]
    assert run(words) == 0
    assert "http://127.0.0.1:" in capsys.readouterr().out
    assert recording.path.read_bytes() == before
    assert list(recording.path.parent.iterdir()) == [recording.path]


def test_view_of_what_is_no_recording_is_one_line(tmp_path, capsys):
    assert run(["view", str(tmp_path / "none.mcap")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
