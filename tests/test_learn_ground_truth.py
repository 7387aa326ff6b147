"""Tests of what truly happened in a recording: its clips, true touches and labels."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.learn.ground_truth import (
    INDEX_NAME,
    MAX_DISTANCE,
    Clip,
    TouchLabel,
    extend_labels,
    read_clips,
    read_true_touches,
)
from eskin.recording import read_recording
from eskin.sim.dataset import read_index
from eskin.sim.dataset.index import INDEX_NAME as WRITTEN_NAME
from helpers.clips import START, generated
from helpers.events import SECOND, make_truth, record_events
from helpers.learning import label, record

LEFT = np.array([-0.15, 0.0, 0.0])
RIGHT = np.array([0.15, 0.0, 0.0])
NAMES = {7: TouchLabel(7, "poke", "tip"), 3: TouchLabel(3, "rub", "palm")}


def format_clip(file="a.mcap", start: int | str = START, **others) -> str:
    """Return a line of an index of clips."""
    facts = {"file": file, "start": start, "gesture": "poke", "kind": "tip"}
    return json.dumps(facts | {"plan": {"seconds": 2.0}} | others)


def write_index(folder, *lines):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / INDEX_NAME).write_text("\n".join(lines) + "\n")
    return folder


def test_generated_recording_has_its_clips_in_order(tmp_path):
    [path] = generated(tmp_path)
    clips = read_clips(path)
    assert WRITTEN_NAME == INDEX_NAME
    assert [(c.start, c.gesture, c.kind) for c in clips] == [
        (row.start, row.gesture, row.kind) for row in read_index(tmp_path)
    ]
    stamps = [scan.stamp for scan in read_recording(path).scans()]
    for clip in clips:
        inside = [stamp for stamp in stamps if clip.start <= stamp < clip.end]
        assert (inside[0], len(inside)) == (clip.start, 100)


def test_each_file_of_a_set_has_its_own_clips(tmp_path):
    lines = [format_clip(), format_clip("b/c.mcap"), format_clip(start=START + 9)]
    folder = write_index(tmp_path / "set", *lines)
    assert read_clips(folder / "a.mcap") == (
        Clip(START, START + 2 * SECOND, "poke", "tip"),
        Clip(START + 9, START + 2 * SECOND + 9, "poke", "tip"),
    )
    assert len(read_clips(folder / "b" / "c.mcap")) == 1
    assert read_clips(folder / "other.mcap") == ()


def test_recording_outside_sets_of_clips_has_none(tmp_path):
    assert read_clips(tmp_path / "a.mcap") == ()
    streams = write_index(tmp_path / "streams", format_clip(gesture=""))
    assert read_clips(streams / "a.mcap") == ()


def read_touches(path, touches=((7, LEFT), (3, RIGHT)), readings=5, **options):
    """Return true touches that stay where they are, from a recording."""
    truths = [
        make_truth(n / 50, number, NAMES[number].gesture, place, NAMES[number].kind)
        for number, place in touches
        for n in range(readings)
    ]
    return read_true_touches(record_events(path, truths, **options))


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Return two true touches, of five readings each."""
    return read_touches(tmp_path_factory.mktemp("truth") / "a.mcap")


def identify(truth, centres, forces=None, first=0):
    """Return the true touch of a sequence of contacts, 20 ms apart."""
    stamps = START + SECOND // 50 * (first + np.arange(len(centres)))
    forces = np.ones(len(centres)) if forces is None else np.array(forces, float)
    return truth.identify(stamps, np.array(centres), forces)


NOWHERE = np.full(3, np.nan)
NEAR = [0, 0, 0.99 * MAX_DISTANCE]
FAR = [0, 0, 1.01 * MAX_DISTANCE]


@pytest.mark.parametrize(
    ("centres", "forces", "first", "number"),
    [
        ([LEFT + [0, 0.02, 0.01]] * 4, None, 0, 7),
        ([RIGHT + [0, 0.02, 0.01]] * 4, None, 0, 3),
        ([LEFT, LEFT, LEFT, RIGHT], [1, 1, 1, 4], 0, 3),
        ([LEFT, LEFT, LEFT, RIGHT], [1, 1, 1, 2], 0, 7),
        ([RIGHT, LEFT], None, 0, 3),
        ([LEFT, RIGHT], None, 0, 3),
        ([LEFT + NEAR] * 4, None, 0, 7),
        ([LEFT + FAR] * 4, None, 0, None),
        ([LEFT] * 3, None, 4, 7),
        ([LEFT] * 3, None, 5, None),
        ([NOWHERE, RIGHT, NOWHERE], [0, 1, 0], 0, 3),
        ([NOWHERE] * 3, [0] * 3, 0, None),
    ],
)
def test_sequence_is_of_the_touch_near_most_of_its_force(
    truth, centres, forces, first, number
):
    """Of equals the lower number counts; without a touch in reach there is none."""
    assert (np.diff(truth.stamps) >= 0).all()
    assert identify(truth, centres, forces, first) == NAMES.get(number)


def test_nearer_of_two_touches_in_reach_counts(tmp_path):
    near = LEFT + [0.06, 0, 0]
    truth = read_touches(tmp_path / "a.mcap", ((7, LEFT), (3, near)))
    assert identify(truth, [LEFT + [0.02, 0, 0]] * 3) == NAMES[7]
    assert identify(truth, [LEFT + [0.04, 0, 0]] * 3) == NAMES[3]


def test_truth_without_touches_is_empty_and_real_recordings_have_none(tmp_path):
    empty = read_touches(tmp_path / "a.mcap", ())
    assert identify(empty, [LEFT] * 2) is None
    assert read_touches(tmp_path / "b.mcap", (), simulated=False) is None


def test_label_is_extended_up_to_the_next_on_a_calibrated_skin(tmp_path):
    """Only the best labels count: rough ranges do not where the truth is known."""
    path = record(tmp_path / "a.mcap", ["hold"], calibrated=True)
    true = (label(3.0, 3.5, "hold"), label(3.7, 4.0, "tap"), label(4.65, 4.7, "tap"))
    labels = (label(2.0, 5.0, "hold", "range"), *true)
    recording = replace(read_recording(path), labels=labels)
    ends = [(x.end - START) / SECOND for x in extend_labels(recording)]
    assert ends == pytest.approx([3.7, 4.6, 5.3])
    nominal = replace(recording, skin=replace(recording.skin, calibrated=False))
    assert extend_labels(nominal) == list(true)
    assert extend_labels(replace(nominal, labels=())) == []
