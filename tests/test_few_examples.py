"""Tests of the measurement over few examples: what is learned and what is tested."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="no torch; pip install '.[train]'")

from eskin.learn.dataset import prepare
from eskin.learn.ground_truth import read_clips
from eskin.recording import read_recording
from helpers.clips import generated
from helpers.learning import record
from lab.few_examples import (
    describe_rows,
    find_nearest,
    find_people,
    format_share,
    split,
)
from lab.recorded_examples import RecordedExamples, write_clip

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Ten repetitions of two groups by each of two people."""
    path = record(tmp_path_factory.mktemp("few") / "a.mcap")
    person = tuple("ab"[n // 20] for n in range(40))
    group = tuple(("pat", "hit")[n % 2] for n in range(40))
    source = tuple(str(n) for n in range(40))
    return RecordedExamples(prepare([path]), person, group, source)


def test_repetitions_of_one_recording_are_held_out_or_learned_together(examples):
    pairs = replace(examples, source=tuple(f"{n // 4}{n % 2}" for n in range(40)))
    pool, tests = split(pairs, "a", 2, np.random.default_rng(1))
    learned = {pairs.source[n] for group in pool for n in group}
    held = [pairs.source[n] for n in tests["a"]]
    assert not learned & set(held)
    assert all(held.count(name) == 2 for name in held) and len(set(held)) == 4


def test_held_out_repetitions_are_of_every_group_and_never_learned(examples):
    pool, tests = split(examples, "a", 3, np.random.default_rng(1))
    learned = {n for group in pool for n in group}
    assert {examples.person[n] for n in learned} == {"a"}
    assert not learned & set(tests["a"]) and len(learned) == 14
    for person, held in tests.items():
        assert {examples.person[n] for n in held} == {person}
        assert sorted(examples.group[n] for n in held) == ["hit"] * 3 + ["pat"] * 3


def test_people_with_too_few_of_a_group_are_not_learned_from(examples):
    assert find_people(examples, 9) == ["a", "b"] and find_people(examples, 10) == []
    fewer = replace(examples, source=("0",) * 20 + examples.source[20:])
    assert find_people(fewer, 1) == ["b"]


def test_nearest_example_gives_its_class_and_a_lost_touch_none(examples):
    names = examples.vocabulary
    features = np.array([[names.index(group), 0.0] for group in examples.group])
    features[5] = np.nan
    found = find_nearest(features, examples, [0, 1, 2, 3, 5])
    truth = [names.index(group) for group in examples.group]
    assert found[5] == names.index("none")
    assert np.delete(found, 5).tolist() == np.delete(truth, 5).tolist()
    assert replace(examples).vocabulary == ("none", "hit", "pat")


def test_share_has_its_interval_and_rows_their_mean_spread_and_maximum():
    rng = np.random.default_rng(0)
    assert format_share(np.array([0.5, 0.5]), rng) == "50.0 (50.0 to 50.0)"
    assert format_share(np.array([]), rng) == "-"
    rows = np.array([[0.0, 2.0], [4.0, 2.0]])
    assert describe_rows(rows).tolist() == [2.0, 2.0, 2.0, 0.0, 4.0, 2.0]


def test_a_clip_is_cut_with_rest_before_it(tmp_path):
    [path, *_] = generated(tmp_path / "set")
    recording = read_recording(path)
    scans, clips = list(recording.scans()), read_clips(path)
    for number, clip in enumerate(clips):
        write_clip(tmp_path / f"{number}.mcap", recording, scans, clip)
        cut = read_recording(tmp_path / f"{number}.mcap")
        found = list(cut.scans())
        stamps = np.array([scan.stamp for scan in found])
        rest = int((stamps < clip.start).sum())
        assert rest == sum(scan.stamp < clips[0].start for scan in scans) > 50
        assert np.ptp(np.diff(stamps)) == 0 and stamps[-1] < clip.end
        assert all(np.array_equal(scan.q, found[rest].q) for scan in found[:rest])
        begins = [label.start for label in recording.labels if label.source == "true"]
        inside = [begin for begin in begins if clip.start <= begin < clip.end]
        assert [label.start for label in cut.labels] == inside
