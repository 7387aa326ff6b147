"""The check for leaks: only the touch may reveal the label, and a leak is found."""

import numpy as np
import pytest

from eskin.learn.evaluation import ClipPredictions
from eskin.recording import NONE
from eskin.sim.dataset import GenerationSettings, generate
from helpers.simulation import build_small_simulator
from lab import leaks
from lab.baselines.interface import TOUCHED, SkinWindows
from lab.comparison import find_examples
from lab.leaks import check_chance, onsets, windows_before_contact

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Eight clips of the simulator."""
    place = tmp_path_factory.mktemp("leaks")
    settings = GenerationSettings("paper", clips=8, subjects=1)
    generate(place / "a", settings, factory=build_small_simulator)
    return find_examples([place / "a"], place / "pack")


def test_windows_before_contact_hold_no_pressure(examples):
    cut, chosen = windows_before_contact(examples)
    assert 0 < len(chosen) <= len(examples.clips)
    assert cut.pressure.max() < TOUCHED
    assert (examples.windows.pressure[chosen] >= TOUCHED).any(axis=(1, 2)).all()


def test_windows_before_contact_keep_the_readings_before_it(examples):
    cut, chosen = windows_before_contact(examples)
    for row, n, onset in zip(
        cut.pressure, chosen, onsets(examples)[chosen], strict=True
    ):
        first = int(onset)
        np.testing.assert_array_equal(row[:first], examples.windows.pressure[n, :first])
        assert (row[first:] == row[first - 1]).all()


def test_clips_that_begin_in_contact_are_left_out(examples, monkeypatch):
    since = onsets(examples)
    since[0] = 0.0
    monkeypatch.setattr("lab.leaks.onsets", lambda examples: since)
    assert 0 not in windows_before_contact(examples)[1]


def test_accuracy_above_chance_ends_the_command():
    check_chance("guesser", np.arange(400) % 4 == 0)
    with pytest.raises(SystemExit, match="cheater: 40.0% of 400 right; allowed"):
        check_chance("cheater", np.arange(400) % 5 < 2)


def test_a_baseline_that_knows_the_labels_is_always_right(examples, monkeypatch):
    """A leak would show in every check; and only labels are shuffled."""
    windows, truth = examples.windows, examples.truth(examples.gestures)
    clip_of = {row.tobytes(): n for n, row in enumerate(windows.pressure)}
    assert len(clip_of) == len(truth)
    trained = []

    def true(windows):
        return truth[[clip_of[row.tobytes()] for row in windows.pressure]]

    class Cheater:
        def fit(self, windows, labels, seed):
            trained.append((true(windows).tolist(), labels.tolist()))

        def predict_probabilities(self, windows):
            return np.eye(len(examples.gestures))[true(windows)]

    def some(examples):
        chosen = np.array([6, 1, 4])
        return SkinWindows(windows.pressure[chosen], windows.q[chosen]), chosen

    monkeypatch.setattr(leaks, "build_baseline", lambda name, mounted: Cheater())
    monkeypatch.setattr(leaks, "windows_before_contact", some)
    monkeypatch.setattr(leaks, "ours_shuffled", lambda *_: truth)
    found = dict(leaks.answers(examples, examples, 0))
    assert len(found) == 2 * len(leaks.WHOLE_SKIN) + 1
    assert all(right.all() for right in found.values())
    for shuffled, before in zip(trained[::2], trained[1::2], strict=True):
        assert sorted(shuffled[0]) == sorted(shuffled[1]) and shuffled[0] != shuffled[1]
        assert before[0] == before[1] and len(before[0]) == 3


def test_the_recogniser_is_trained_on_shuffled_gestures(examples, monkeypatch):
    trained, truth = [], examples.truth(examples.gestures)

    class Untrained:
        def __init__(self, dataset, vocabulary, config, seed):
            trained.append([segment.gesture for segment in dataset.segments])

        def run(self, quiet):
            return None

    def cheat(network, dataset, vocabulary):
        names = [vocabulary.index(examples.gestures[n]) for n in truth]
        unknown = np.zeros(len(truth), dtype=np.int64)
        return ClipPredictions((), unknown, unknown, np.eye(len(vocabulary))[names])

    monkeypatch.setattr(leaks, "Trainer", Untrained)
    monkeypatch.setattr(leaks, "predict_clips", cheat)
    found = leaks.ours_shuffled(examples, examples, 0)
    np.testing.assert_array_equal(found, truth)
    graph = leaks.FOR_SMALL_SETS.graph
    was = [segment.gesture for segment in examples.dataset(graph).segments]
    (now,) = trained
    assert sorted(now) == sorted(was) and now != was
    assert [name == NONE for name in now] == [name == NONE for name in was]
