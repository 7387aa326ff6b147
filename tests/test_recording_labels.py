"""Tests of labels, and of automatic labelling against the truth."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import ModelError, RecordingError
from eskin.labelling import (
    AutoLabelConfig,
    LabelAgreement,
    label_automatically,
    label_recording,
)
from eskin.live.model_config import ModelCard
from eskin.live.model_file import CARD_ADAPTER, read_card
from eskin.recording import (
    Label,
    LabelSet,
    Metadata,
    RecordingWriter,
    build_labels,
    build_rough_ranges,
    check_gesture_names,
    check_labels,
    label_instants,
    load_ranges,
    read_recording,
    select_labels,
    sort_labels,
    write_all,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan
from helpers import live

SECOND = 1_000_000_000
PERIOD = SECOND // 50
GESTURES = ["none", "poke", "double_pat", "stroke"]


def make_label(start, end, gesture="poke", source="true"):
    """Return a label by seconds."""
    return Label(round(start * SECOND), round(end * SECOND), gesture, source)


def make_range(start, end, gesture="poke"):
    return make_label(start, end, gesture, "range")


def make_stamps(duration):
    """Return the stamps of readings at 50 Hz [ns]."""
    return np.arange(round(duration * 50)) * PERIOD


def list_spans(labels):
    """Return start [s], end [s] and gesture of each label."""
    return [
        (round(x.start / SECOND, 3), round(x.end / SECOND, 3), x.gesture)
        for x in labels
    ]


def test_labels_of_one_source_follow_each_other_and_others_may_overlap():
    labels = (make_label(1, 2), make_label(2, 3), make_range(1, 3))
    check_labels([LabelSet(Path("a.mcap"), labels, 0, 3 * SECOND)])


def test_labels_are_sorted_and_selected_by_source():
    true = make_label(3, 4)
    auto = make_label(1, 2, source="auto")
    rough = make_range(1, 2)
    first = make_label(0, 1)
    assert sort_labels([true, auto, first]) == (first, auto, true)
    assert sort_labels([true, auto, first], "auto") == (auto,)
    assert select_labels([rough, auto, true, first]) == (first, true)
    assert select_labels([rough, auto]) == (auto,)
    assert select_labels([rough]) == (rough,)
    assert select_labels([]) == ()


def test_label_holds_from_its_start_until_just_before_its_end():
    stamps = make_stamps(0.2)
    found = label_instants([make_label(0.04, 0.1)], stamps, GESTURES)
    np.testing.assert_array_equal(found, [0, 0, 1, 1, 1, 0, 0, 0, 0, 0])
    unknown = label_instants([make_label(0.04, 0.1, "hug")], stamps, ["poke"])
    assert (unknown == -1).all()


@settings(deadline=None)
@given(st.lists(st.sampled_from(range(4)), min_size=1, max_size=40))
def test_labels_made_from_instants_give_the_instants_back(indices):
    stamps = 10**18 + np.arange(len(indices)) * PERIOD
    labels = build_labels(stamps, [GESTURES[i] for i in indices], PERIOD)
    np.testing.assert_array_equal(label_instants(labels, stamps, GESTURES), indices)
    assert all(x.end <= y.start for x, y in pairwise(labels))


def test_ranges_are_labels_widened_and_joined_by_gesture():
    """Those of different gestures meet half way; only true gestures count."""
    truth = [
        make_label(5, 6),
        make_label(7.5, 8),
        make_label(9, 10, "stroke"),
        make_label(20, 21, "none"),
        make_label(30, 31, "stroke", "auto"),
    ]
    ranges = build_rough_ranges(truth, margin=1.0)
    assert list_spans(ranges) == [(4, 8.5, "poke"), (8.5, 11, "stroke")]
    assert {label.source for label in ranges} == {"range"}
    assert all(x.end <= y.start for x, y in pairwise(ranges))


POKE = make_range(0.5, 6)
STROKE = make_range(6, 9, "stroke")
FIRST = (2, 2.2)
LATER = (2.7, 2.9)
LAST = (7, 7.4)
FLICKER = (3.8, 3.84)
AFTER = (4, 4.2)


@pytest.mark.parametrize(
    ("pulses", "ranges", "options", "expected"),
    [
        ([FIRST, LAST], [POKE, STROKE], {}, [(*FIRST, "poke"), (*LAST, "stroke")]),
        ([FIRST, LAST], [STROKE], {}, [(*LAST, "stroke")]),
        ([FIRST, (2.3, 2.5)], [POKE], {}, [(2, 2.5, "poke")]),
        ([FIRST, (2.68, 2.9)], [POKE], {}, [(2, 2.9, "poke")]),
        ([FIRST, LATER], [POKE], {}, [(*FIRST, "poke"), (*LATER, "poke")]),
        ([FIRST, LATER], [POKE], {"min_window": 0.52}, [(2, 2.9, "poke")]),
        ([FIRST, FLICKER], [POKE], {}, [(*FIRST, "poke")]),
        ([FLICKER, AFTER], [POKE], {}, [(3.8, 4.2, "poke")]),
        ([FIRST], [POKE], {"threshold": 10.0}, [(*FIRST, "poke")]),
        ([FIRST], [POKE], {"threshold": 30.0}, []),
        ([], [POKE], {}, []),
        ([FIRST], [], {}, []),
    ],
)
def test_touches_are_labelled_within_their_ranges(pulses, ranges, options, expected):
    """Shorter pauses than the window join touches; flickers alone are noise."""
    stamps = make_stamps(10)
    peaks = np.random.default_rng(3).uniform(0.1, 0.3, len(stamps))
    for start, end in pulses:
        peaks[(stamps >= start * SECOND) & (stamps < end * SECOND)] += 20.0
    found = label_automatically(stamps, peaks, ranges, AutoLabelConfig(**options))
    assert list_spans(found) == expected
    assert {label.source for label in found} <= {"auto"}


@given(st.floats(2, 50), st.floats(0.05, 0.95), st.integers(0, 2**16))
@settings(max_examples=40, deadline=None)
def test_threshold_separates_two_groups_of_any_size_and_distance(ratio, share, seed):
    rng = np.random.default_rng(seed)
    high = rng.uniform(1.0, 1.2, max(2, int(400 * share))) * 3 * ratio
    low = rng.uniform(1.0, 1.2, (2, 200))
    stamps = np.arange(400 + len(high)) * PERIOD
    peaks = np.concatenate([low[0], high, low[1]])
    config = AutoLabelConfig(min_threshold=0.0, min_touch=0.0)
    [found] = label_automatically(stamps, peaks, [make_range(0, 99)], config)
    assert (found.start, found.end) == (stamps[200], stamps[200 + len(high)])


def score_agreement(truth, found):
    agreement = LabelAgreement()
    agreement.add_recording(truth, found, make_stamps(5))
    return agreement.summary()


def test_agreement_is_perfect_with_the_truth_and_zero_without_labels():
    truth = [make_label(1, 2), make_label(3, 4, "stroke")]
    perfect = score_agreement(truth, truth)
    nothing = score_agreement(truth, [])
    ones = ("accuracy", "balanced_accuracy", "event_iou")
    assert [perfect[name] for name in ones] == [1, 1, 1]
    assert (perfect["event_recall"], perfect["event_precision"]) == (1, 1)
    assert (perfect["onset_error_s"], perfect["events_found"]) == (0, 2)
    assert [nothing[name] for name in ones] == [pytest.approx(0.6), 0.5, 0.0]
    assert (nothing["event_precision"], nothing["onset_error_s"]) == (None, None)


def test_agreement_counts_overlap_and_delay_of_matched_labels():
    """A label that is found matches one event at most."""
    truth = [make_label(1, 2)]
    found = [make_label(1.25, 2.25), make_label(1, 2, "stroke"), make_label(3, 3.1)]
    scores = score_agreement(truth, found)
    assert scores["event_iou"] == pytest.approx(0.6)
    assert scores["onset_bias_s"] == pytest.approx(0.25)
    assert scores["event_precision"] == pytest.approx(1 / 3)
    scores = score_agreement([*truth, make_label(3, 4)], [make_label(1, 4)])
    assert scores["event_iou"] == pytest.approx(1 / 6)
    assert (scores["event_recall"], scores["onset_bias_s"]) == (0, 0)


def record(path, labels):
    """Write a recording of two touches, from 4 to 4.5 s and from 8 to 8.6 s."""
    skin = build_grid_skin(2, 2, name="square")
    calibration = Calibration.uniform(4, 1000, 100.0)
    scans = []
    for stamp in make_stamps(10).tolist():
        counts = np.full(4, 50, np.int32)
        seconds = stamp / SECOND
        counts += 200 * (4 <= seconds < 4.5 or 8 <= seconds < 8.6)
        scans.append(Scan(stamp, counts, np.ones(4, bool), np.empty(0)))
    with RecordingWriter(path, "table", skin, calibration, Metadata(), ()) as writer:
        write_all(writer, scans, labels)
    return read_recording(path)


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        (
            [make_label(4, 4.5), make_label(8, 8.6, "stroke")],
            [(4, 4.5, "poke"), (8, 8.6, "stroke")],
        ),
        ([make_label(4, 4.5), make_range(7, 9.5, "stroke")], [(8, 8.6, "stroke")]),
    ],
    ids=["truth", "ranges before truth"],
)
def test_recording_is_labelled_by_its_labels_and_its_pressure(
    tmp_path, labels, expected
):
    found = label_recording(record(tmp_path / "a.mcap", labels)).found
    assert list_spans(found) == expected


def test_labels_follow_the_pressures_that_a_live_recogniser_sees(tmp_path):
    """Without those of taxels that it finds faulty, as one that is stuck."""
    labels = [live.label(0.5, 5.5, "poke")]
    path = tmp_path / "a.mcap"
    live.record(path, live.mounted(), live.list_faulty_scans(), labels)
    recording = read_recording(path)
    config = AutoLabelConfig()
    pairs = [(r.stamp, r.pressure[r.valid].max()) for r in live.replay(recording)]
    stamps, peaks = map(np.array, zip(*pairs, strict=True))
    found = label_recording(recording, labels, config).found
    assert found and found == label_automatically(stamps, peaks, labels, config)


def test_ranges_are_loaded_in_seconds_since_the_first_reading(tmp_path):
    path = tmp_path / "ranges.yaml"
    path.write_text(
        "- {start_s: 6, end_s: 9.5, gesture: Стук 👩🏽‍🔧}\n"
        "- start_s: 1\n  end_s: 2\n  gesture: poke\n"
    )
    ranges = load_ranges(path, 10 * SECOND)
    assert list_spans(ranges) == [(11, 12, "poke"), (16, 19.5, "Стук 👩🏽‍🔧")]
    assert {label.source for label in ranges} == {"range"}


def is_allowed(*names):
    try:
        check_gesture_names(names)
    except RecordingError as error:
        assert "\n" not in str(error) and "allowed" in str(error)
        return False
    return True


@pytest.mark.parametrize(
    "name",
    [
        "轻拍",
        "нажать",
        "👋🏽",
        "👩🏽‍🔧",
        "swipe+",
        "drücken",
        "Tap",
        "a, b/c",
        "نیم‌فاصله",
        "x" * 200,
    ],
)
def test_names_in_any_letters_are_allowed(name):
    assert is_allowed(name, "none", f"{name[:9]}2")


@pytest.mark.parametrize(
    "name",
    ["", " ", "\u200d", "none ", "\ttap", "a\nb", "a\u202eb", "\ud800", "x" * 201]
    + ["拍" * 67, "unknown", "Unknown", "None"],
)
def test_names_that_a_person_cannot_tell_apart_or_read_are_refused(name):
    assert not is_allowed(name)


@pytest.mark.parametrize(
    "pair",
    [
        ("Tap", "tap"),
        ("a_b", "A  b"),
        ("dru\u0308cken", "drücken"),
        ("Straße", "STRASSE"),
    ],
)
def test_names_that_look_alike_are_refused_in_one_set(pair):
    assert all(is_allowed(name, name) for name in pair)
    assert not is_allowed(*pair)


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=70))
def test_allowed_names_pass_through_recordings_and_models(tmp_path_factory, name):
    path = tmp_path_factory.getbasetemp() / "named.mcap"
    path.unlink(missing_ok=True)
    if is_allowed(name, "none"):
        card = ModelCard(("none", name))
        assert read_card(CARD_ADAPTER.dump_json(card).decode(), path) == card
        recording = record(path, [make_label(1, 2, name)])
        assert [label.gesture for label in recording.labels] == [name]
    else:
        with pytest.raises(ModelError, match="vocabulary"):
            read_card(json.dumps({"vocabulary": ["none", name]}), path)
