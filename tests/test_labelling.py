"""Labels, and the paper's automatic labelling against the truth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import RecordingError
from eskin.recording import (
    AutoLabelConfig,
    Label,
    LabelAgreement,
    Metadata,
    RecordingWriter,
    build_labels,
    build_rough_ranges,
    check_no_overlap,
    label_automatically,
    label_instants,
    label_recording,
    load_ranges,
    read_recording,
    rewrite_recording,
    select_labels,
    sort_labels,
    write_all,
)
from eskin.recording.autolabel import compute_otsu_threshold
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
PERIOD = SECOND // 50
GESTURES = ["none", "poke", "double_pat", "stroke"]


def seconds(start, end, gesture="poke", source="true"):
    return Label(round(start * SECOND), round(end * SECOND), gesture, source)


def instants(duration):
    return np.arange(round(duration * 50)) * PERIOD


def spans(labels):
    return [
        (round(x.start / SECOND, 3), round(x.end / SECOND, 3), x.gesture)
        for x in labels
    ]


def test_a_label_must_end_after_it_starts_and_name_a_gesture():
    with pytest.raises(RecordingError, match="not after its start"):
        seconds(1, 1)
    with pytest.raises(RecordingError, match="has no gesture"):
        seconds(1, 2, "")


def test_labels_of_one_source_may_not_overlap_but_of_two_may():
    check_no_overlap([seconds(1, 2), seconds(2, 3), seconds(1, 3, source="auto")])
    with pytest.raises(RecordingError, match="'stroke' from 1500000000 ns overlap"):
        check_no_overlap([seconds(1.5, 3, "stroke"), seconds(1, 2)])


def test_labels_are_sorted_and_chosen_by_source():
    labels = [seconds(3, 4), seconds(1, 2, source="auto"), seconds(0, 1)]
    assert sort_labels(labels) == (labels[2], labels[1], labels[0])
    assert sort_labels(labels, "auto") == (labels[1],)


def test_the_best_labels_are_all_of_one_source():
    true, auto, rough = (seconds(1, 2, source=s) for s in ("true", "auto", "range"))
    assert select_labels([rough, auto, true]) == (true,)
    assert select_labels([rough, auto]) == (auto,)
    assert select_labels([rough]) == (rough,)
    assert select_labels([]) == ()


def test_a_label_holds_from_its_start_until_just_before_its_end():
    stamps = instants(0.2)
    got = label_instants([seconds(0.04, 0.1)], stamps, GESTURES)
    np.testing.assert_array_equal(got, [0, 0, 1, 1, 1, 0, 0, 0, 0, 0])
    strangers = label_instants([seconds(0.04, 0.1, "hug")], stamps, ["poke"])
    assert (strangers == -1).all()


@settings(deadline=None)
@given(st.lists(st.sampled_from(range(4)), min_size=1, max_size=40))
def test_labels_made_from_instants_give_the_instants_back(indices):
    stamps = 10**18 + np.arange(len(indices)) * PERIOD
    labels = build_labels(stamps, [GESTURES[i] for i in indices], PERIOD)
    np.testing.assert_array_equal(label_instants(labels, stamps, GESTURES), indices)
    check_no_overlap(labels)


def pulses(stamps, *times, height=20.0):
    """Rest at about 0.2 kPa, and touches of `height` kPa."""
    rng = np.random.default_rng(3)
    peaks = rng.uniform(0.1, 0.3, len(stamps))
    for start, end in times:
        peaks[(stamps >= start * SECOND) & (stamps < end * SECOND)] += height
    return peaks


def test_a_touch_is_found_where_it_is_and_nowhere_else():
    stamps = instants(10)
    peaks = pulses(stamps, (2, 2.6), (7, 7.4))
    ranges = [seconds(1, 4, "poke", "range"), seconds(6, 9, "stroke", "range")]
    found = label_automatically(stamps, peaks, ranges)
    assert spans(found) == [(2, 2.6, "poke"), (7, 7.4, "stroke")]
    assert {label.source for label in found} == {"auto"}


def test_touches_outside_every_range_are_left_out():
    stamps = instants(10)
    peaks = pulses(stamps, (2, 2.6), (7, 7.4))
    found = label_automatically(stamps, peaks, [seconds(6, 9, "stroke", "range")])
    assert spans(found) == [(7, 7.4, "stroke")]


@pytest.mark.parametrize("gap", [0.1, 0.3, 0.48])
def test_a_double_pat_is_not_split(gap):
    stamps = instants(6)
    peaks = pulses(stamps, (2, 2.2), (2.2 + gap, 2.4 + gap))
    found = label_automatically(stamps, peaks, [seconds(1, 5, "double_pat", "range")])
    assert spans(found) == [(2, round(2.4 + gap, 3), "double_pat")]


def test_touches_further_apart_than_the_window_are_two():
    stamps = instants(6)
    peaks = pulses(stamps, (2, 2.2), (2.7, 2.9))
    marked = [seconds(1, 5, "poke", "range")]
    assert len(label_automatically(stamps, peaks, marked)) == 2
    wider = AutoLabelConfig(min_window=0.52)
    assert len(label_automatically(stamps, peaks, marked, wider)) == 1


def test_a_flicker_is_no_touch_but_may_belong_to_one():
    stamps = instants(6)
    marked = [seconds(1, 5, "poke", "range")]
    flicker = pulses(stamps, (2, 2.04), (4, 4.2))
    assert spans(label_automatically(stamps, flicker, marked)) == [(4, 4.2, "poke")]
    near = pulses(stamps, (3.8, 3.84), (4, 4.2))
    assert spans(label_automatically(stamps, near, marked)) == [(3.8, 4.2, "poke")]


def test_a_threshold_given_is_used():
    stamps = instants(6)
    peaks = pulses(stamps, (2, 2.2), height=3) + pulses(stamps, (4, 4.2), height=30)
    marked = [seconds(1, 5, "poke", "range")]
    low, high = (AutoLabelConfig(threshold=value) for value in (2.0, 10.0))
    assert len(label_automatically(stamps, peaks, marked, low)) == 2
    assert len(label_automatically(stamps, peaks, marked, high)) == 1


def test_noise_alone_is_not_parted_into_touches():
    stamps = instants(6)
    marked = [seconds(0, 6, "poke", "range")]
    assert label_automatically(stamps, pulses(stamps), marked) == ()


@given(st.floats(2, 50), st.floats(0.05, 0.95), st.integers(0, 2**16))
@settings(max_examples=40, deadline=None)
def test_the_compute_otsu_threshold_parts_two_groups_wherever_they_lie(
    ratio, share, seed
):
    rng = np.random.default_rng(seed)
    low = rng.uniform(1.0, 1.2, 400)
    high = rng.uniform(1.0, 1.2, max(2, int(400 * share))) * 3 * ratio
    threshold = compute_otsu_threshold(np.concatenate([low, high]))
    assert low.max() < threshold <= high.min()


def test_ranges_are_truth_widened_joined_by_gesture_and_parted_half_way():
    truth = [
        seconds(5, 6),
        seconds(7.5, 8),
        seconds(9, 10, "stroke"),
        seconds(20, 21, "none"),
        seconds(30, 31, "stroke", "auto"),
    ]
    got = build_rough_ranges(truth, margin=1.0)
    assert spans(got) == [(4, 8.5, "poke"), (8.5, 11, "stroke")]
    assert {label.source for label in got} == {"range"}
    check_no_overlap(got)


def test_perfect_labels_agree_perfectly_and_none_do_not():
    truth = [seconds(1, 2), seconds(3, 4, "stroke")]
    stamps = instants(5)
    perfect, nothing = LabelAgreement(), LabelAgreement()
    perfect.add(truth, truth, stamps)
    nothing.add(truth, [], stamps)
    same = perfect.summary()
    assert (same["accuracy"], same["balanced_accuracy"], same["event_iou"]) == (1, 1, 1)
    assert (same["event_recall"], same["event_precision"]) == (1, 1)
    assert (same["onset_error_s"], same["events_found"]) == (0, 2)
    blind = nothing.summary()
    assert blind["accuracy"] == pytest.approx(0.6)
    assert (blind["balanced_accuracy"], blind["event_iou"]) == (0.5, 0.0)
    assert (blind["event_precision"], blind["onset_error_s"]) == (None, None)


def test_agreement_counts_overlap_and_lateness_of_matched_events():
    agreement = LabelAgreement()
    found = [seconds(1.25, 2.25), seconds(1, 2, "stroke"), seconds(3, 3.1)]
    agreement.add([seconds(1, 2)], found, instants(5))
    figures = agreement.summary()
    assert figures["event_iou"] == pytest.approx(0.6)
    assert figures["onset_bias_s"] == pytest.approx(0.25)
    assert figures["event_precision"] == pytest.approx(1 / 3)


def test_one_label_found_is_never_counted_for_two_events():
    agreement = LabelAgreement()
    agreement.add([seconds(1, 2), seconds(3, 4)], [seconds(1, 4)], instants(5))
    figures = agreement.summary()
    assert figures["event_iou"] == pytest.approx(1 / 6)
    assert (figures["event_recall"], figures["onset_bias_s"]) == (0, 0)


SKIN = build_grid_skin(2, 2, name="square")


def record(path, *times, labels=(), duration=12.0, height=200):
    stamps = instants(duration)
    scans = []
    for stamp in stamps:
        counts = np.full(4, 50, np.int32)
        if any(a * SECOND <= stamp < b * SECOND for a, b in times):
            counts[1] += height
        scans.append(Scan(int(stamp), counts, np.ones(4, bool), np.empty(0)))
    calibration = Calibration.uniform(4, 1000, 100.0)
    with RecordingWriter(
        path, "table", SKIN, calibration, Metadata("set"), ()
    ) as writer:
        write_all(writer, scans, labels)
    return read_recording(path)


def test_a_recording_is_labelled_where_its_ranges_and_its_pressure_say(tmp_path):
    truth = (seconds(4, 4.5), seconds(8, 8.6, "stroke"))
    recording = record(tmp_path / "a.mcap", (4, 4.5), (8, 8.6), labels=truth)
    found = label_recording(recording).found
    assert spans(found) == [(4, 4.5, "poke"), (8, 8.6, "stroke")]


def test_ranges_in_the_recording_win_over_its_truth(tmp_path):
    labels = (seconds(4, 4.5), seconds(7, 10, "stroke", "range"))
    recording = record(tmp_path / "a.mcap", (4, 4.5), (8, 8.6), labels=labels)
    assert spans(label_recording(recording).found) == [(8, 8.6, "stroke")]


def test_a_recording_that_says_nothing_cannot_be_labelled(tmp_path):
    recording = record(tmp_path / "a.mcap", labels=(seconds(1, 2, "none"),))
    with pytest.raises(RecordingError, match="--ranges FILE"):
        label_recording(recording)


def test_rewriting_changes_the_labels_and_nothing_else(tmp_path):
    recording = record(tmp_path / "a.mcap", (4, 4.5), labels=(seconds(4, 4.5),))
    labels = [*recording.labels, seconds(4, 4.4, source="auto")]
    rewrite_recording(recording, labels=labels)
    again = read_recording(recording.path)
    assert again.labels == tuple(sorted(labels))
    assert again.metadata == recording.metadata
    np.testing.assert_array_equal(
        again.arrays().counts, record(tmp_path / "b.mcap", (4, 4.5)).arrays().counts
    )
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["a.mcap", "b.mcap"]


def test_a_copy_that_fails_leaves_nothing_behind(tmp_path):
    recording = record(tmp_path / "a.mcap", (4, 4.5), labels=(seconds(4, 4.5),))
    before = recording.path.read_bytes()

    def labels():
        yield seconds(4, 4.4, source="auto")
        raise OSError("disk full")

    for target in (None, tmp_path / "b.mcap"):
        with pytest.raises(OSError, match="disk full"):
            rewrite_recording(recording, target, labels=labels())
        assert list(tmp_path.iterdir()) == [recording.path]
        assert recording.path.read_bytes() == before


def test_a_cut_recording_is_never_replaced_but_may_be_copied(tmp_path):
    whole = record(tmp_path / "a.mcap", (4, 4.5), labels=(seconds(4, 4.5),))
    data = whole.path.read_bytes()[:-30]
    whole.path.write_bytes(data)
    cut = read_recording(whole.path)
    with pytest.raises(RecordingError, match="is cut short .* elsewhere"):
        rewrite_recording(cut)
    assert whole.path.read_bytes() == data
    rewrite_recording(cut, tmp_path / "b.mcap")
    copy = read_recording(tmp_path / "b.mcap")
    assert (copy.count, copy.truncated) == (cut.count, False)


def test_ranges_are_read_from_yaml_in_seconds_since_the_first_reading(tmp_path):
    path = tmp_path / "ranges.yaml"
    path.write_text(
        "- {start_s: 6, end_s: 9.5, gesture: Stroke}\n"
        "- start_s: 1\n  end_s: 2\n  gesture: poke\n"
    )
    got = load_ranges(path, 10 * SECOND)
    assert spans(got) == [(11, 12, "poke"), (16, 19.5, "stroke")]
    assert {label.source for label in got} == {"range"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no list"),
        ("start_s: 1", "holds no list"),
        ("- {start_s: 1", "is not YAML"),
        ("- {start_s: 1, end_s: 2}", "range 1 is"),
        ("- {start_s: 2, end_s: 1, gesture: poke}", "range 1 ends at 1 s, not after"),
        ("- {start_s: x, end_s: 1, gesture: poke}", "allowed are seconds"),
        ("- {start_s: .nan, end_s: 1, gesture: poke}", "allowed are seconds"),
        ("- {start_s: 1, end_s: 2, gesture: 3}", "allowed are seconds"),
        ("- {start_s: 1, end_s: 2, gesture: ''}", "has no gesture"),
    ],
)
def test_ranges_that_cannot_be_used_are_named_in_one_line(tmp_path, text, message):
    path = tmp_path / "ranges.yaml"
    path.write_text(text)
    with pytest.raises(RecordingError) as caught:
        load_ranges(path, 0)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_ranges_file_is_named(tmp_path):
    with pytest.raises(RecordingError, match="no ranges at .*gone.yaml"):
        load_ranges(tmp_path / "gone.yaml", 0)
