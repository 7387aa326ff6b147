"""Tests of the check of labels before they are learned, scored or written."""

import re
from dataclasses import replace

import pytest

from eskin.errors import RecordingError
from eskin.labelling import label_recording
from eskin.labelling.editing import LabelEditor
from eskin.learn.dataset import prepare
from eskin.learn.events import trace_recordings
from eskin.learn.events.matching import read_true_events
from eskin.live import load_model
from eskin.recording import (
    LabelSet,
    check_labels,
    read_recording,
    rewrite_recording,
)
from eskin.sets.conversion import ImportedClip, write_clips
from helpers.cli import assert_refused, call_json
from helpers.learning import label, onset, record

PLAN = ("hold", "tap") * 3
MODEL = load_model("ur5")
LASTS = 0.2
"""Duration of a label, shorter than the pause between two touches [s]."""


def mark(shift=0.0, plan=PLAN):
    """Return a label at the beginning of each touch of a plan, shifted [s]."""
    return [
        label(onset(n) + shift, onset(n) + shift + LASTS, gesture)
        for n, gesture in enumerate(plan)
    ]


@pytest.fixture
def make(tmp_path):
    """Return a function that records the touches of the plan with some labels."""

    def make(labels, name="a.mcap", **options):
        options = {"calibrated": True} | options
        return record(tmp_path / name, PLAN, labels=labels, **options)

    return make


def shift_labels(path, seconds):
    """Shift the labels of a recording in place."""
    recording = read_recording(path)
    begins = [(x.start - recording.start) / 1e9 + seconds for x in recording.labels]
    labels = [
        label(begin, begin + LASTS, x.gesture)
        for begin, x in zip(begins, recording.labels, strict=True)
    ]
    rewrite_recording(recording, labels=labels)


@pytest.mark.parametrize("shift", [-2.3, -0.3, 1.6, 3.6])
def test_labels_beside_their_touches_are_refused_with_the_shift_that_mends_them(
    make, shift
):
    path = make(mark(shift))
    with pytest.raises(RecordingError, match=r"a\.mcap: \d of \d labels hold no") as e:
        prepare([path])
    text = str(e.value)
    assert f"'hold' from {onset(0) + shift:.2f} to " in text
    told = float(re.search(r"shift the labels by ([+-]\d+\.\d+) s", text)[1])
    assert f"{abs(told):.2f} s {'earlier' if told < 0 else 'later'}" in text
    shift_labels(path, told)
    assert prepare([path]).labelled


def test_no_shift_is_advised_that_right_labels_would_lose_their_touch_by(make):
    """Three gestures are too faint, two labels are right, and touches have no label."""
    faint = [label(0.3 + 0.3 * n, 0.5 + 0.3 * n, "tap") for n in range(3)]
    with pytest.raises(RecordingError, match="3 of 5 labels hold no touch") as e:
        prepare([make([*faint, *mark()[:2]])])
    assert str(e.value).endswith("; correct their times")


def test_labels_beside_the_touches_of_streams_are_refused_too(make):
    with pytest.raises(RecordingError, match="6 of 6 labels hold no touch"):
        list(trace_recordings([make(mark(1.6))], MODEL))


def test_labels_are_judged_together_where_a_recording_has_few(tmp_path):
    """A single label may be of a faint touch; many that are alike are not."""
    paths = [
        record(
            tmp_path / f"{n}.mcap",
            ("hold",),
            labels=[label(onset(0) - 1.0, onset(0) - 0.8, "hold")],
            calibrated=True,
        )
        for n in range(3)
    ]
    for path in paths:
        assert len(prepare([path]).missed) == 1
    with pytest.raises(RecordingError, match=r"3 of 3 labels.* by \+1\.\d\d s"):
        prepare(paths)


def test_touches_that_are_not_felt_count_as_missed_which_is_told(make, caplog):
    faint = [label(0.1 + 0.5 * n, 0.4 + 0.5 * n, "tap") for n in range(4)]
    dataset = prepare([make([*faint, *mark()])])
    assert [each.gesture for each in dataset.missed] == ["tap"] * 4
    assert "4 labels without a touch; the first is 'tap' at 0.10 s" in caplog.text


def test_labels_without_a_gesture_need_no_touch(make, caplog):
    rest = [label(0.1 + 0.5 * n, 0.4 + 0.5 * n, "none") for n in range(4)]
    assert prepare([make(rest)]).missed == ()
    assert not caplog.text


def test_labels_of_a_skin_without_touches_are_not_compared_with_them(make):
    assert len(prepare([make(mark(1.6), calibrated=False)]).labelled) == len(PLAN)


@pytest.mark.parametrize(("shift", "side"), [(-60, "before"), (5000, "after")])
def test_labels_outside_of_their_recording_are_refused(make, shift, side):
    with pytest.raises(RecordingError) as caught:
        prepare([make(mark(shift))])
    for part in ("a.mcap: 6 of 6 labels lie outside", "'hold'", side, "nanoseconds"):
        assert part in str(caught.value)


def test_few_labels_outside_of_their_recording_are_not_learned(make):
    dataset = prepare([make([*mark(), label(90, 91, "tap")])])
    assert len(dataset.labelled) == len(PLAN) and not dataset.missed


def test_labels_that_count_are_the_true_events(make):
    recording = read_recording(make([*mark(), label(90, 91, "tap")]))
    events = read_true_events(recording)
    assert [event.gesture for event in events] == list(PLAN)


def learn(path):
    prepare([path])


def score(path):
    list(trace_recordings([path], MODEL))


def label_by_ranges(path):
    recording = read_recording(path)
    label_recording(recording, [replace(x, source="range") for x in recording.labels])


def label_by_hand(path):
    LabelEditor(read_recording(path)).save()


def convert(path):
    """Convert a recording as if it were a file of a public set."""
    recording = read_recording(path)
    scans = recording.scans()
    clip = ImportedClip("c", recording.metadata, scans, recording.label_set)
    write_clips([clip], path.parent / "out", recording.skin, recording.calibration)


WRITERS = (label_by_ranges, label_by_hand, convert)
"""What writes labels."""
READERS = (learn, score)
"""What reads the labels of existing recordings."""
ENTRANCES = (*READERS, *WRITERS)
LATE = label(onset(5), onset(5) + LASTS, "tap")
OVERLAP = r"a\.mcap: labels 'hold' from 2\.40 .* 'tap' from 2\.50 to 3\.00 s overlap"
WRONG = {
    name: ([*mark(plan=PLAN[:-1]), replace(LATE, gesture=name)], part)
    for part in [r"a\.mcap, label at 12\.40 s: gesture"]
    for name in ("unknown", "tap ", "a\nb", "x" * 300, "Hold")
} | {
    "overlap": ([*mark(), label(2.5, 3.0, "tap")], OVERLAP),
    "before": (mark(-60), r"a\.mcap: 6 of 6 labels lie outside .* before its start"),
    "after": (mark(5000), r"a\.mcap: 6 of 6 labels lie outside .* after its end"),
    "most after": (
        [*mark(plan=PLAN[:3]), *(label(90 + n, 91 + n, "tap") for n in range(4))],
        r"a\.mcap: 4 of 7 labels lie outside .* after its end",
    ),
}
FEW_OUTSIDE = {
    "before": ([label(-90, -89, "tap"), *mark()], "from -90.00 to -89.00 s .* before"),
    "after": ([*mark(), label(90, 91, "tap")], "from 90.00 to 91.00 s .* after"),
    "an hour later": ([*mark(), label(3600, 3601, "tap")], "from 3600.00 to 3601.00 s"),
}
"""Labels of which all but one are right, with the place of the wrong one."""


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("enter", ENTRANCES)
def test_wrong_labels_are_refused_alike_wherever_they_come_in(make, enter, kind):
    labels, part = WRONG[kind]
    path = make(labels)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match=part):
        enter(path)
    assert path.read_bytes() == before
    assert [*path.parent.iterdir()] == [path]


@pytest.mark.parametrize("kind", FEW_OUTSIDE)
@pytest.mark.parametrize("enter", WRITERS)
def test_no_label_outside_of_its_recording_is_written(make, enter, kind):
    labels, place = FEW_OUTSIDE[kind]
    path = make(labels)
    before = path.read_bytes()
    part = rf"a\.mcap: 1 of 7 labels lie outside .* 'tap' {place}"
    with pytest.raises(RecordingError, match=part):
        enter(path)
    assert path.read_bytes() == before
    assert [*path.parent.iterdir()] == [path]


@pytest.mark.parametrize("kind", FEW_OUTSIDE)
@pytest.mark.parametrize("enter", READERS)
def test_few_labels_outside_are_left_out_where_they_are_read(make, enter, kind, caplog):
    labels, place = FEW_OUTSIDE[kind]
    enter(make(labels))
    text = rf"1 of 7 labels lie outside .* 'tap' {place}.*; they are left out"
    assert re.search(text, caplog.text)


@pytest.mark.parametrize("enter", READERS)
def test_half_of_the_labels_are_not_most_of_them(make, enter, caplog):
    outside = [label(90 + n, 91 + n, "tap") for n in range(3)]
    enter(make([*mark(plan=PLAN[:3]), *outside]))
    assert re.search("3 of 6 labels lie outside .*; they are left out", caplog.text)


def test_true_labels_outside_are_not_written_with_the_ranges_of_others(make):
    """Automatic labelling keeps the true labels of a recording, whatever is marked."""
    recording = read_recording(make([*mark(), label(90, 91, "tap")]))
    ranges = [replace(x, source="range") for x in mark()]
    with pytest.raises(RecordingError, match="1 of 7 labels lie outside"):
        label_recording(recording, ranges)


def test_labels_outside_are_removed_where_a_recording_is_viewed(make, capsys):
    path = make([*mark(), label(90, 91, "tap")])
    before = path.read_bytes()
    result, out = call_json(capsys, "view", path, "--port", "0", "--seconds", "0.1")
    assert result == {"labels": len(PLAN), "saved": False}
    assert "1 of 7 labels lie outside" in out
    assert path.read_bytes() == before


@pytest.mark.parametrize("enter", ENTRANCES)
def test_right_labels_pass_wherever_they_come_in(make, enter):
    enter(make(mark()))


def test_more_labels_than_a_recording_may_have_are_refused(tmp_path):
    labels = tuple(label(n, n + 1, "tap") for n in range(20_001))
    some = LabelSet(tmp_path, labels, labels[0].start, labels[-1].end)
    with pytest.raises(RecordingError, match="20,001 labels; allowed are 20,000"):
        check_labels([some])
    check_labels([replace(some, labels=labels[1:])])


@pytest.mark.parametrize("count", [1, 2])
def test_labels_are_needed_of_one_recording_at_least(make, count):
    silent = [read_recording(make([], f"{n}.mcap")).label_set for n in range(count)]
    named = make(mark(), "named.mcap")
    check_labels(silent)
    with pytest.raises(RecordingError, match=r"0\.mcap.* labels; .*eskin label"):
        check_labels(silent, needed=True)
    check_labels([*silent, read_recording(named).label_set], needed=True)


@pytest.mark.parametrize(
    ("last", "part"),
    [
        (
            "{start_s: 3, end_s: 4, gesture: tap}",
            "ranges.yaml, label at 3.00 s: gestures 'Tap' and 'tap' differ only in",
        ),
        ("{start_s: 90, end_s: 91, gesture: Tap}", "ranges.yaml: 1 of 3 labels lie"),
    ],
)
def test_wrong_ranges_are_refused_by_the_name_of_their_file(
    make, tmp_path, capsys, last, part
):
    ranges = tmp_path / "ranges.yaml"
    ranges.write_text(
        "- {start_s: 1, end_s: 2, gesture: Tap}\n"
        "- {start_s: 5, end_s: 6, gesture: Tap}\n"
        f"- {last}\n"
    )
    path = make(mark())
    before = path.read_bytes()
    assert_refused(capsys, "label", path, "--ranges", ranges, part=part)
    assert path.read_bytes() == before


def test_wrong_labels_are_mended_by_hand_one_after_the_other(make):
    wrong = [*mark(plan=PLAN[:-2]), label(10.4, 10.6, "tap "), label(10.5, 10.7, "x")]
    editor = LabelEditor(read_recording(make(wrong)))
    with pytest.raises(RecordingError):
        editor.save()
    editor.remove(editor.labels[-1])
    with pytest.raises(RecordingError, match="'tap ' begins or ends"):
        editor.save()
    editor.set_range("tap", 10.4, 10.6)
    editor.save()


def test_two_recordings_spell_a_gesture_alike(make):
    names = {"hold": "Hold", "tap": "tap"}
    other = [label(onset(n), onset(n) + LASTS, names[g]) for n, g in enumerate(PLAN)]
    with pytest.raises(RecordingError, match=r"b\.mcap, label at .*'hold' and 'Hold'"):
        prepare([make(mark()), make(other, "b.mcap")])
