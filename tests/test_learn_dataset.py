"""Recordings made ready for learning."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import RecordingError
from eskin.graph import GraphConfig
from eskin.learn.dataset import hash_recordings, prepare
from eskin.learn.ground_truth import (
    extend_labels,
    find_label_indices,
    find_runs,
    look_up_gestures,
)
from eskin.recording import read_recording
from eskin.touch import ContactConfig, PipelineConfig
from helpers.clips import Elsewhere, Placed, generated
from helpers.learning import (
    LASTS,
    SECOND,
    START,
    label,
    labels_for,
    onset,
    record,
    record_people,
)


@pytest.fixture(scope="module")
def nominal(tmp_path_factory):
    """Two recordings of an uncalibrated skin."""
    folder = tmp_path_factory.mktemp("nominal")
    return prepare(record_people(folder, ("ann", "bob")))


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """One recording of a calibrated skin, then one that nobody touches twice."""
    folder = tmp_path_factory.mktemp("calibrated")
    return prepare(
        [
            record(folder / "a.mcap", calibrated=True),
            record(folder / "b.mcap", ("tap",), calibrated=True),
        ]
    )


def gesture_at(recording, stamp):
    """The gesture at a stamp, by the labels as they were written."""
    found = [x.gesture for x in recording.labels if x.start <= stamp < x.end]
    return found[0] if found else "none"


def test_an_uncalibrated_skin_has_one_row_a_scan(nominal):
    for index, recording in enumerate(nominal.recordings):
        mine = nominal.recording == index
        stamps = [scan.stamp for scan in recording.scans()]
        assert nominal.stamps[mine].tolist() == stamps
        assert len(set(nominal.sequence[mine].tolist())) == 1


def test_a_row_has_the_gesture_that_was_labelled_at_its_stamp(nominal):
    for row, stamp in enumerate(nominal.stamps.tolist()):
        recording = nominal.recordings[nominal.recording[row]]
        assert nominal.gestures[row] == gesture_at(recording, stamp)


@pytest.mark.parametrize("name", ["nominal", "calibrated"])
def test_segments_share_out_all_rows_and_each_is_of_one_gesture(name, request):
    dataset = request.getfixturevalue(name)
    rows = [row for s in dataset.segments for row in range(s.first, s.end)]
    assert rows == list(range(len(dataset.stamps)))
    for segment in dataset.segments:
        span = slice(segment.first, segment.end)
        assert set(dataset.gestures[span]) == {segment.gesture}
        assert set(dataset.recording[span].tolist()) == {segment.recording}
        assert len(set(dataset.sequence[span].tolist())) == 1


def test_the_labelled_segments_are_the_labels(nominal):
    found = [(s.recording, s.gesture) for s in nominal.labelled]
    assert found == [(0, "hold"), (0, "tap"), (1, "hold"), (1, "tap")]
    for segment in nominal.labelled:
        stamps = nominal.stamps[segment.first : segment.end]
        written = nominal.recordings[segment.recording].labels
        [truth] = [x for x in written if x.gesture == segment.gesture]
        assert truth.start <= stamps[0] < truth.start + SECOND // 20
        assert truth.end - SECOND // 20 <= stamps[-1] < truth.end


def test_silence_is_none_but_only_a_label_makes_it_scored(tmp_path):
    labels = [label(0.5, 1.5, "none"), *labels_for(["hold"])]
    dataset = prepare([record(tmp_path / "a.mcap", ["hold"], labels=labels)])
    assert dataset.vocabulary == ("none", "hold")
    assert {s.gesture for s in dataset.segments if not s.labelled} <= {"none"}
    assert ("hold", True) in {(s.gesture, s.labelled) for s in dataset.segments}


def spans_of(dataset):
    """Gesture and seconds of the labelled segments."""
    return [
        (
            segment.gesture,
            round((dataset.stamps[segment.first] - START) / SECOND, 1),
            round((dataset.stamps[segment.end - 1] - START) / SECOND + 0.05, 1),
        )
        for segment in dataset.labelled
    ]


def test_a_label_is_an_example_of_its_own_whatever_it_touches(tmp_path):
    labels = [
        label(0.5, 1.5, "none"),
        label(2.5, 3.0, "hold"),
        label(3.0, 3.5, "hold"),
        label(3.5, 4.0, "tap"),
    ]
    written = [("none", 0.5, 1.5), ("hold", 2.5, 3.0), ("hold", 3.0, 3.5)]
    dataset = prepare([record(tmp_path / "a.mcap", labels=labels)])
    assert spans_of(dataset) == [*written, ("tap", 3.5, 4.0)]


def test_a_gesture_that_nothing_was_felt_of_is_missed_on_a_calibrated_skin(tmp_path):
    labels = [
        *labels_for(["hold", "tap"]),
        label(0.5, 1.5, "soft"),
        label(1.6, 1.9, "none"),
        label(60, 61, "late"),
    ]
    for calibrated, missed in ((True, [("soft", 0)]), (False, [])):
        path = tmp_path / f"{calibrated}.mcap"
        dataset = prepare([record(path, labels=labels, calibrated=calibrated)])
        assert [(m.gesture, m.recording) for m in dataset.missed] == missed


def test_the_vocabulary_begins_with_none_and_is_sorted(nominal):
    assert nominal.vocabulary == ("none", "hold", "tap")


def test_starts_are_the_first_rows_of_the_sequences(calibrated):
    for row, start in enumerate(calibrated.starts.tolist()):
        same = np.flatnonzero(calibrated.sequence == calibrated.sequence[row])
        assert start == same[0]


def test_a_calibrated_skin_has_one_sequence_a_touch(calibrated):
    _, firsts, counts = np.unique(
        calibrated.sequence, return_index=True, return_counts=True
    )
    assert calibrated.recording[firsts].tolist() == [0, 0, 1]
    begins = (calibrated.stamps[firsts] - START) / SECOND
    np.testing.assert_allclose(begins, [onset(0), onset(1), onset(0)], atol=0.06)
    # A touch closes half a second after its last contact.
    lengths = counts / 20
    assert (lengths >= LASTS).all() and (lengths < LASTS + 0.7).all()


def test_a_touch_keeps_its_gesture_until_it_closes(calibrated):
    for segment in calibrated.segments:
        assert (
            segment.gesture
            == ("hold", "tap", "tap")[calibrated.sequence[segment.first]]
        )
    assert len(calibrated.segments) == 3


def test_on_a_calibrated_skin_a_label_lingers_but_not_into_the_next(tmp_path):
    path = record(tmp_path / "a.mcap", ["hold"], calibrated=True)
    labels = (label(3.0, 3.5, "hold"), label(3.7, 4.0, "tap"), label(6.0, 6.5, "tap"))
    recording = replace(read_recording(path), labels=labels)
    times = [3.49, 3.55, 3.69, 3.71, 4.55, 4.65, 7.05, 7.15]
    stamps = np.array([START + round(t * SECOND) for t in times])
    lasting = extend_labels(recording)
    gestures = look_up_gestures(lasting, find_label_indices(lasting, stamps))
    expected = ["hold", "hold", "hold", "tap", "tap", "none", "tap", "none"]
    assert gestures == expected
    ends = [(x.end - START) / SECOND for x in extend_labels(recording)]
    assert ends == pytest.approx([3.7, 4.6, 7.1])
    nominal = replace(recording, skin=replace(recording.skin, calibrated=False))
    assert extend_labels(nominal) == list(labels)


def test_true_labels_go_before_automatic_ones_and_these_before_rough_ones(tmp_path):
    true = label(3.0, 3.5, "hold")
    auto = label(3.1, 3.3, "hold", "auto")
    rough = label(2.0, 5.0, "hold", "range")
    recording = read_recording(record(tmp_path / "a.mcap", ["hold"]))
    for labels, used in (
        ((rough, true, auto), [true]),
        ((rough, auto), [auto]),
        ((rough,), [rough]),
        ((), []),
    ):
        assert extend_labels(replace(recording, labels=labels)) == used


def test_preparing_twice_gives_the_same(nominal):
    again = prepare([recording.path for recording in nominal.recordings])
    np.testing.assert_array_equal(again.graphs.pressure, nominal.graphs.pressure)
    np.testing.assert_array_equal(again.graphs.neighbours, nominal.graphs.neighbours)
    assert again.segments == nominal.segments


def test_a_cut_recording_gives_its_rows_up_to_the_cut(nominal, tmp_path):
    path = nominal.recordings[0].path
    data = path.read_bytes()
    half = tmp_path / "half.mcap"
    half.write_bytes(data[: len(data) // 2])
    dataset = prepare([half])
    count = len(dataset.stamps)
    assert 0 < count < sum(nominal.recording == 0)
    np.testing.assert_array_equal(dataset.stamps, nominal.stamps[:count])


def test_recordings_without_touches_teach_nothing(tmp_path):
    path = record(tmp_path / "a.mcap", (), calibrated=True)
    with pytest.raises(RecordingError, match="no touch in 1 recordings"):
        prepare([path])
    with pytest.raises(RecordingError, match="no recording given"):
        prepare([])


def test_a_recording_without_touches_changes_nothing_of_the_others(tmp_path):
    """Nor does it matter that nothing is labelled in it."""
    quiet = record(tmp_path / "quiet.mcap", (), calibrated=True)
    touched = record(tmp_path / "a.mcap", calibrated=True)
    alone = prepare([touched, touched])
    for paths, places in (
        ([quiet, touched, touched], [1, 2]),
        ([touched, quiet, touched], [0, 2]),
        ([touched, touched, quiet], [0, 1]),
    ):
        dataset = prepare(paths)
        assert dataset.sequence.tolist() == alone.sequence.tolist()
        assert [places[n] for n in alone.recording] == dataset.recording.tolist()
        spans = [[(s.first, s.end) for s in d.segments] for d in (dataset, alone)]
        assert spans[0] == spans[1]
        assert np.array_equal(dataset.graphs.pressure, alone.graphs.pressure)


def test_what_simulated_touches_are_is_known_without_labels(tmp_path):
    """Each whole sequence is of one touch; what is of none is `none`, and scored."""
    for maker, ghosts in ((Placed, False), (Elsewhere, True)):
        dataset = prepare(generated(tmp_path / maker.__name__, maker))
        made = [clip.gesture for clips in dataset.clips for clip in clips]
        assert len(set(made)) > 1
        found = [segment.gesture for segment in dataset.segments]
        assert found == (["none"] * len(made) if ghosts else made)
        assert dataset.labelled == dataset.segments
        assert dataset.missed == ()
        for segment in dataset.segments:
            assert dataset.starts[segment.end - 1] == segment.first


@pytest.mark.parametrize(
    ("values", "runs"),
    [
        ([], []),
        ([4], [(0, 1)]),
        ([4, 4, 2, 2, 2, 4], [(0, 2), (2, 5), (5, 6)]),
    ],
)
def test_runs_are_rows_of_equal_values(values, runs):
    assert find_runs(np.array(values, np.int64)[:, None]) == runs


def test_runs_end_where_any_of_several_values_changes():
    values = np.array([[1, 1, 1, 2, 2], [0, 0, 5, 5, 0]]).T
    assert find_runs(values) == [(0, 2), (2, 3), (3, 4), (4, 5)]


def test_shear_that_not_every_skin_has_adds_no_taxels(tmp_path):
    felt = record(tmp_path / "felt.mcap", kind="shear")
    flat = record(tmp_path / "flat.mcap")
    firm = PipelineConfig(contacts=ContactConfig(on=100.0, off=90.0))
    alone, mixed = prepare([felt], firm), prepare([felt, flat], firm)
    plain = prepare([felt], firm, GraphConfig().without_shear())
    rows = np.arange(len(plain.stamps))
    found = mixed.graphs.select(rows).taxels
    np.testing.assert_array_equal(found, plain.graphs.taxels)
    assert len(alone.graphs.taxels) > len(plain.graphs.taxels)


def test_recordings_of_skins_of_different_size_learn_together(nominal, tmp_path):
    other = record(tmp_path / "small.mcap", ["hold"], size=(2, 3))
    dataset = prepare([nominal.recordings[0].path, other])
    assert dataset.graphs.count == len(dataset.stamps)


def test_the_digest_tells_recordings_but_not_their_order(nominal, tmp_path):
    a, b = (recording.path for recording in nominal.recordings)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(a.read_bytes())
    assert (
        hash_recordings([a, b]) == hash_recordings([b, a]) == hash_recordings([b, copy])
    )
    assert (
        len(
            {
                hash_recordings([a, b]),
                hash_recordings([a]),
                hash_recordings([b]),
                hash_recordings([a, a]),
            }
        )
        == 4
    )
