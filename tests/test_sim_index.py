"""The index of a set: every clip, and enough to make it again alone."""

import json

import numpy as np
import pytest

from eskin.errors import GenerationError
from eskin.recording import read_recording
from eskin.sim.dataset import (
    ClipRow,
    GenerationSettings,
    Simulator,
    generate,
    read_index,
    remake_clip,
)
from helpers.simulation import StandIn

SMALL = GenerationSettings("train", "square", seed=3, clips=23, subjects=4)
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    generate(folder, SMALL, factory=StandIn)
    return folder


def test_the_index_lists_every_clip_in_order(folder):
    rows = read_index(folder)
    assert len(rows) == 23
    places = [(row.file, row.number) for row in rows]
    assert places == sorted(places)
    for row in rows:
        assert (row.start // SECOND - 1_750_000_000) % 3600 == 6 * (row.number + 1)
        assert (row.kind, row.regime) == ("tip", "paper")
        assert row.pose_group in row.plan.groups


def test_a_row_is_the_same_after_a_line(folder):
    for row in read_index(folder):
        assert ClipRow.from_line(row.to_line()) == row


def test_a_line_says_first_what_is_asked_for_most(folder):
    line = json.loads((folder / "clips.jsonl").read_text().splitlines()[0])
    assert list(line)[:11] == [
        "file",
        "number",
        "start",
        "gesture",
        "kind",
        "subject",
        "build",
        "pose_group",
        "moving",
        "difficulty",
        "regime",
    ]
    assert set(line["touches"][0]) == {
        "touch",
        "gesture",
        "kind",
        "subject",
        "link",
        "onset",
        "end",
        "impulse",
    }
    assert line["plan"]["person"]["seed"]


def test_any_clip_can_be_made_again_alone(folder):
    maker = StandIn("square")
    for row in read_index(folder):
        arrays = read_recording(folder / row.file).arrays()
        first = int(np.searchsorted(arrays.stamps, row.start))
        clip = remake_clip(row, maker)
        part = slice(first, first + len(clip.counts))
        assert arrays.stamps[first] == row.start
        np.testing.assert_array_equal(arrays.counts[part], clip.counts)
        np.testing.assert_array_equal(arrays.received[part], clip.received)


def test_a_clip_of_the_simulator_can_be_made_again_alone(tmp_path):
    settings = GenerationSettings("test-x", clips=5, subjects=1)
    generate(tmp_path, settings)
    row = read_index(tmp_path)[3]
    arrays = read_recording(tmp_path / row.file).arrays()
    clip = remake_clip(row, Simulator("ur5"))
    first = int(np.searchsorted(arrays.stamps, row.start))
    part = slice(first, first + 100)
    assert arrays.stamps[first] == row.start
    np.testing.assert_array_equal(arrays.counts[part], clip.counts)
    np.testing.assert_array_equal(arrays.q[part], clip.q)


def test_touches_are_those_of_the_truth(folder):
    for row in read_index(folder):
        truths = [t for t in read_recording(folder / row.file).truths()]
        for touch in row.touches:
            mine = [truth for truth in truths if truth.touch == touch.touch]
            seconds = [(truth.stamp - row.start) / SECOND for truth in mine]
            assert touch.onset <= min(seconds) and max(seconds) < touch.end
            impulse = sum(truth.force for truth in mine) / 50
            assert touch.impulse == pytest.approx(impulse)
            assert {truth.gesture for truth in mine} == {touch.gesture, row.gesture}


def test_an_index_that_is_missing_or_broken_is_named(tmp_path):
    with pytest.raises(GenerationError, match="no index .*clips.jsonl"):
        read_index(tmp_path)
    for text in ("{", "[]", '{"file": "a"}'):
        (tmp_path / "clips.jsonl").write_text(text + "\n")
        with pytest.raises(GenerationError, match="line 1 is no clip") as caught:
            read_index(tmp_path)
        assert "\n" not in str(caught.value)
