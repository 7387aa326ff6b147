"""Methods of the comparison: their digests, settings and trainings."""

from dataclasses import replace
from functools import partial
from inspect import signature

import numpy as np
import pytest

from eskin.learn.evaluation import predict_clips, score_segments
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.training import Trainer
from eskin.live import GraphConfig
from helpers.clips import generated
from helpers.learning import NETWORK, TINY, record_people
from lab.baselines.series import SERIES
from lab.comparison.examples import ClipExamples, find_examples
from lab.comparison.methods import (
    METHODS,
    METHODS_ON_RECORDINGS,
    ON_FEATURES,
    BaselineMethod,
    RecogniserMethod,
    build_touch_rows,
    score_touches,
)
from lab.comparison.segments import find_segments

pytestmark = pytest.mark.slow

SHORT = replace(TINY, validation=0.0)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Six clips."""
    folder = tmp_path_factory.mktemp("set")
    generated(folder / "a")
    return find_examples([folder / "a"], folder / "pack")


@pytest.fixture
def untrained(monkeypatch):
    """Trainers whose `run` was called; none of them trains."""
    trainers = []

    def run(trainer, quiet):
        trainers.append(trainer)
        return trainer.network.eval()

    monkeypatch.setattr(Trainer, "run", run)
    return trainers


@pytest.mark.parametrize(
    "name",
    ["boosting-on-touch", *SERIES, *(f"{name}-features" for name in ON_FEATURES)],
)
def test_methods_on_touches_give_probabilities_of_every_clip(name, examples):
    answers = METHODS[name].fit(examples, 0)(examples)
    assert answers.shape == (examples.count, len(examples.gestures))
    np.testing.assert_allclose(np.exp(answers).sum(axis=1), 1.0, rtol=1e-6)


def test_the_repr_of_a_method_shows_all_settings_and_no_address():
    every = [*METHODS.items(), *METHODS_ON_RECORDINGS.items()]
    for name, method in every:
        assert " at 0x" not in repr(method), name
        if isinstance(method, BaselineMethod):
            assert isinstance(method.make, partial)
            takes = set(signature(method.make.func).parameters) - {"mounted"}
            assert set(method.make.keywords) == takes, name


@pytest.mark.parametrize(("small", "times"), [(3, 2), (6, 1), (500, 1), (None, 1)])
def test_steps_grow_with_the_number_of_examples(small, times, examples, untrained):
    assert examples.count == 6
    RecogniserMethod(SHORT, small).fit(examples, 0)
    assert untrained[0].config.steps == times * SHORT.steps


def test_clips_without_contact_are_none_or_the_training_shares(
    examples, tmp_path, untrained, monkeypatch
):
    def nothing(self, dataset):
        return [None] * self.count

    generated(tmp_path / "a", chosen="paper")
    touches = find_examples([tmp_path / "a"], tmp_path / "pack")
    monkeypatch.setattr(ClipExamples, "find_touches", nothing)
    for learned in (examples, touches):
        shares = np.array([name == "none" for name in learned.gestures], float)
        if learned is touches:
            counts = [learned.labels.count(name) for name in learned.gestures]
            shares = np.array(counts) / learned.count
        answers = RecogniserMethod(SHORT).fit(learned, 0)(learned)
        expected = np.tile(shares, (learned.count, 1))
        np.testing.assert_allclose(np.exp(answers), expected, atol=1e-6)
    assert "none" in examples.gestures and "none" not in touches.gestures


def test_touch_features_are_zero_without_contact(examples, tmp_path, monkeypatch):
    forms = ("features", "summary")
    rows = build_touch_rows(examples, forms).rows
    assert len(rows) == examples.count and np.isfinite(rows).all()
    assert rows.any(axis=1).all() and len(np.unique(rows, axis=0)) == len(rows)
    find = ClipExamples.find_touches

    def all_but_third(self, dataset):
        touches = find(self, dataset)
        return [None if n == 2 else touch for n, touch in enumerate(touches)]

    monkeypatch.setattr(ClipExamples, "find_touches", all_but_third)
    other = build_touch_rows(replace(examples, pack=tmp_path), forms).rows
    assert not other[2].any()
    np.testing.assert_array_equal(np.delete(other, 2, 0), np.delete(rows, 2, 0))


@pytest.fixture
def network():
    return RecogniserNetwork(NETWORK, 5, shear=False).eval()


def test_clips_and_segments_are_scored_as_by_evaluation(examples, tmp_path, network):
    people = record_people(tmp_path / "people")
    segments = find_segments(people, tmp_path)
    for some in (examples, segments):
        dataset = some.dataset(GraphConfig())
        touches = some.find_touches(dataset)
        scores = score_touches(network, dataset, touches)
        if some is examples:
            vocabulary = tuple(f"{n}" for n in range(5 - len(some.gestures)))
            vocabulary += some.gestures
            wanted = predict_clips(network, dataset, vocabulary).log_probabilities
        else:
            wanted = score_segments(network, dataset, dataset.labelled)
        np.testing.assert_allclose(scores, wanted, rtol=1e-6)
