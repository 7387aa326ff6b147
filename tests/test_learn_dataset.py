"""Tests of data sets for learning: rows, segments, labels, and what is held out."""

import numpy as np
import pytest

from eskin.learn.dataset import hold_out, map_graphs, prepare
from eskin.learn.plan import hash_recordings
from eskin.live import GraphConfig, create_empty_batch, join_graphs
from eskin.recording import PARTLY_LABELLED
from eskin.touch import ContactConfig, PipelineConfig
from helpers.clips import Elsewhere, Placed, generated
from helpers.graphs import assert_same, random_graph, random_graphs
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
    """Prepare two recordings of an uncalibrated skin."""
    folder = tmp_path_factory.mktemp("nominal")
    return prepare(record_people(folder, ("ann", "bob")))


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """Prepare a recording of two touches on a calibrated skin, and one of one touch."""
    folder = tmp_path_factory.mktemp("calibrated")
    two = record(folder / "a.mcap", calibrated=True)
    return prepare([two, record(folder / "b.mcap", ("tap",), calibrated=True)])


def test_uncalibrated_skin_has_a_row_a_scan_with_the_gesture_of_its_label(nominal):
    assert nominal.vocabulary == ("none", "hold", "tap")
    for index, recording in enumerate(nominal.recordings):
        rows = np.flatnonzero(nominal.recording == index)
        stamps = [scan.stamp for scan in recording.scans()]
        assert nominal.stamps[rows].tolist() == stamps
        assert len(set(nominal.sequence[rows].tolist())) == 1
        for row, stamp in zip(rows, stamps, strict=True):
            made = [x.gesture for x in recording.labels if x.start <= stamp < x.end]
            assert [nominal.gestures[row]] == (made or ["none"])


@pytest.mark.parametrize("name", ["nominal", "calibrated"])
def test_segments_divide_all_rows_and_each_has_one_gesture(name, request):
    dataset = request.getfixturevalue(name)
    rows = [row for s in dataset.segments for row in range(s.first, s.end)]
    assert rows == list(range(len(dataset.stamps)))
    for segment in dataset.segments:
        span = slice(segment.first, segment.end)
        assert set(dataset.gestures[span]) == {segment.gesture}
        assert set(dataset.recording[span].tolist()) == {segment.recording}
        assert len(set(dataset.sequence[span].tolist())) == 1


def test_labelled_segments_are_the_labels(tmp_path):
    """Each label is an example of its own, `none` among them; silence is none."""
    spans = [(0.5, 1.5, "none"), (2.5, 3.0, "hold"), (3.0, 3.5, "hold")]
    spans += [(3.5, 4.0, "tap")]
    labels = [label(*span) for span in spans]
    dataset = prepare([record(tmp_path / "a.mcap", labels=labels)])
    seconds = (dataset.stamps - START) / SECOND
    assert [
        (round(seconds[s.first], 1), round(seconds[s.end - 1] + 0.05, 1), s.gesture)
        for s in dataset.labelled
    ] == spans
    assert {s.gesture for s in dataset.segments if not s.labelled} == {"none"}


def test_touch_without_a_label_is_no_example_where_only_some_were_corrected(tmp_path):
    some = labels_for(["hold", "tap"])[:1]
    options = {"labels": some, "calibrated": True}
    whole = prepare([record(tmp_path / "a.mcap", **options)])
    partly = prepare([record(tmp_path / "b.mcap", notes=PARTLY_LABELLED, **options)])
    assert [segment.gesture for segment in whole.segments] == ["hold", "none"]
    assert [segment.gesture for segment in partly.segments] == ["hold"]
    assert len(partly.gestures) == len(whole.gestures) == len(whole.stamps)


@pytest.mark.parametrize(("on", "missed"), [(True, [("soft", 0)]), (False, [])])
def test_label_without_contact_is_missed_on_a_calibrated_skin(tmp_path, on, missed):
    labels = labels_for(["hold", "tap"])
    labels += [label(0.5, 1.5, "soft"), label(1.6, 1.9, "none"), label(60, 61, "late")]
    dataset = prepare([record(tmp_path / "a.mcap", labels=labels, calibrated=on)])
    assert [(m.gesture, m.recording) for m in dataset.missed] == missed


def test_calibrated_skin_has_a_sequence_a_touch_with_its_gesture(calibrated):
    _, firsts, counts = np.unique(
        calibrated.sequence, return_index=True, return_counts=True
    )
    assert calibrated.starts.tolist() == np.repeat(firsts, counts).tolist()
    assert calibrated.recording[firsts].tolist() == [0, 0, 1]
    begins = (calibrated.stamps[firsts] - START) / SECOND
    np.testing.assert_allclose(begins, [onset(0), onset(1), onset(0)], atol=0.06)
    # A touch closes half a second after its last contact.
    lengths = counts / 20
    assert (lengths >= LASTS).all() and (lengths < LASTS + 0.7).all()
    assert [s.gesture for s in calibrated.segments] == ["hold", "tap", "tap"]


def test_cut_recording_gives_its_rows_up_to_the_cut(nominal, tmp_path):
    data = nominal.recordings[0].path.read_bytes()
    half = tmp_path / "half.mcap"
    half.write_bytes(data[: len(data) // 2])
    labelled = nominal.recordings[1].path
    dataset = prepare([half, labelled])
    count = sum(dataset.recording == 0)
    assert 0 < count < sum(nominal.recording == 0)
    np.testing.assert_array_equal(dataset.stamps[:count], nominal.stamps[:count])


@pytest.mark.parametrize("place", [0, 1, 2])
def test_recording_without_touches_changes_nothing_of_the_others(
    calibrated, tmp_path, place
):
    paths = [recording.path for recording in calibrated.recordings]
    paths.insert(place, record(tmp_path / "quiet.mcap", (), calibrated=True))
    dataset = prepare(paths)
    assert dataset.sequence.tolist() == calibrated.sequence.tolist()
    others = [n for n in range(3) if n != place]
    assert dataset.recording.tolist() == [others[n] for n in calibrated.recording]
    spans = [[(s.first, s.end) for s in d.segments] for d in (dataset, calibrated)]
    assert spans[0] == spans[1]
    assert np.array_equal(dataset.graphs.pressure, calibrated.graphs.pressure)


@pytest.mark.parametrize("generator", [Placed, Elsewhere])
def test_simulated_sequences_have_the_gesture_of_their_true_touch(tmp_path, generator):
    """Without labels; sequences of no true touch are `none`, and scored."""
    dataset = prepare(generated(tmp_path, generator, clips=4))
    made = [clip.gesture for clips in dataset.clips for clip in clips]
    assert len(set(made)) > 1
    expected = made if generator is Placed else ["none"] * len(made)
    assert [segment.gesture for segment in dataset.segments] == expected
    assert dataset.labelled == dataset.segments
    assert dataset.missed == ()
    for segment in dataset.segments:
        assert dataset.starts[segment.end - 1] == segment.first


def test_shear_that_some_skins_lack_is_not_used(tmp_path):
    """Taxels that only shear makes active are left out."""
    with_shear = record(tmp_path / "a.mcap", ["hold"], kind="shear")
    firm = PipelineConfig(contacts=ContactConfig(on=100.0, off=90.0))
    mixed = prepare([with_shear, record(tmp_path / "b.mcap", ["hold"])], firm)
    plain = prepare([with_shear], firm, GraphConfig().without_shear())
    found = mixed.graphs.select(np.arange(len(plain.stamps))).taxels
    np.testing.assert_array_equal(found, plain.graphs.taxels)
    assert len(prepare([with_shear], firm).graphs.taxels) > len(found)


def test_skins_of_different_size_make_one_data_set(nominal, tmp_path):
    other = record(tmp_path / "small.mcap", ["hold"], size=(2, 3))
    dataset = prepare([nominal.recordings[0].path, other])
    assert dataset.graphs.size == len(dataset.stamps)


def test_digest_depends_on_the_recordings_but_not_on_their_order(nominal, tmp_path):
    a, b = (recording.path for recording in nominal.recordings)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(a.read_bytes())
    same = {hash_recordings(paths) for paths in ([a, b], [b, a], [b, copy])}
    others = {hash_recordings(paths) for paths in ([a], [b], [a, a])}
    assert len(same) == 1 and len(same | others) == 4


CLASSES = ("none", "hold", "tap")
SESSIONS = [("ann", "1"), ("ann", "2"), ("bob", "1"), ("bob", "3")] * 3


def hold_out_sessions(sessions, share, seed=0, gestures=()):
    """Hold out some of recordings with a person, a session and gestures."""
    made = dict(enumerate(gestures or [set(CLASSES)] * len(sessions)))
    rng = np.random.default_rng(seed)
    return hold_out(dict(enumerate(sessions)), made, share, rng)


@pytest.mark.parametrize(
    ("count", "share"), [(1, 0.5), (4, 0.15), (20, 0.15), (7, 0.0)]
)
@pytest.mark.parametrize("session", ["", "{}"])
def test_each_recording_is_either_trained_on_or_held_out(count, share, session):
    found = hold_out_sessions([("ann", session.format(i)) for i in range(count)], share)
    assert found.train | found.held == set(range(count))
    assert not found.train & found.held
    assert len(found.held) == found.wanted * (count > 1)
    if not share:
        assert str(found) == f"0 of {count} recordings held out for validation"


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_session_of_a_person_is_held_out_as_a_whole(share):
    for seed in range(20):
        found = hold_out_sessions(SESSIONS, share, seed)
        train, held = (
            {SESSIONS[i] for i in part} for part in (found.train, found.held)
        )
        assert held and not train & held
        assert len(found.held) == max(3, round(found.wanted / 3) * 3)


def test_every_class_keeps_recordings_to_train_on():
    sessions = [("ann", "1"), *[("bob", "1")] * 4]
    gestures = [set(CLASSES), *[{"none", "hold"}] * 4]
    for seed in range(20):
        found = hold_out_sessions(sessions, 0.4, seed, gestures)
        assert 0 in found.train
        assert not found.held
        assert "0 of 5 recordings" in str(found) and "2 asked for" in str(found)


def test_graphs_on_disk_are_those_in_memory(tmp_path):
    rng = np.random.default_rng(0)
    empty = create_empty_batch(6)
    sizes = ((3, 0, 8), (5, 1))
    some, others = (random_graphs(rng, each) for each in sizes)
    batches = [empty, some, empty, others]
    assert_same(map_graphs(batches, tmp_path), join_graphs(batches))


def test_what_is_zero_until_late_is_kept(tmp_path):
    rng = np.random.default_rng(0)
    touched = random_graph(rng, 7)
    nothing = np.zeros_like(touched.shear)
    still = touched._replace(shear=nothing, shear_before=nothing)
    for batches in ([still, still], [still, touched], [touched, still]):
        assert_same(map_graphs(batches, tmp_path), join_graphs(batches))


def test_graphs_on_disk_leave_no_file_and_cannot_be_changed(tmp_path):
    rng = np.random.default_rng(0)
    mapped = map_graphs([random_graph(rng, 4)], tmp_path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="read-only"):
        mapped.pressure[0] = 1.0
