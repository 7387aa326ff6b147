"""Methods of the comparison: their digests, settings and trainings."""

from dataclasses import replace
from functools import partial
from inspect import signature

import numpy as np
import pytest

from eskin.learn.evaluation import ClipPredictions
from eskin.learn.training import Trainer
from eskin.live import GraphConfig
from helpers.clips import generated
from helpers.learning import TINY
from lab.baselines.series import SERIES
from lab.comparison import methods
from lab.comparison.examples import find_examples
from lab.comparison.methods import (
    METHODS,
    BaselineMethod,
    RecogniserMethod,
    build_touch_rows,
)

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


@pytest.mark.parametrize("name", ["boosting-on-touch", *SERIES])
def test_methods_on_touches_give_probabilities_of_every_clip(name, examples):
    answers = METHODS[name].fit(examples, 0)(examples)
    assert answers.shape == (len(examples.clips), len(examples.gestures))
    np.testing.assert_allclose(np.exp(answers).sum(axis=1), 1.0, rtol=1e-6)


def test_the_repr_of_a_method_shows_all_settings_and_no_address():
    for name, method in METHODS.items():
        assert " at 0x" not in repr(method), name
        if isinstance(method, BaselineMethod):
            assert isinstance(method.make, partial)
            takes = set(signature(method.make.func).parameters) - {"mounted"}
            assert set(method.make.keywords) == takes, name


@pytest.mark.parametrize(("small", "times"), [(3, 2), (6, 1), (500, 1)])
def test_steps_grow_with_the_number_of_clips(
    small, times, examples, untrained, monkeypatch
):
    monkeypatch.setattr(methods, "SMALL", small)
    assert len(examples.clips) == 6
    RecogniserMethod(SHORT).fit(examples, 0)
    assert untrained[0].config == replace(SHORT, steps=times * SHORT.steps)


def test_clips_without_contact_are_none_or_the_training_shares(
    examples, tmp_path, untrained, monkeypatch
):
    def nothing(network, dataset, vocabulary):
        certain = np.where(np.array(vocabulary) == "none", 0.0, -np.inf)
        unknown = np.zeros(2, dtype=np.int64)
        return ClipPredictions((), unknown, unknown, np.tile(certain, (2, 1)))

    generated(tmp_path / "a", chosen="paper")
    touches = find_examples([tmp_path / "a"], tmp_path / "pack")
    monkeypatch.setattr(methods, "predict_clips", nothing)
    for learned in (examples, touches):
        shares = np.array([name == "none" for name in learned.gestures], float)
        if learned is touches:
            made = [clip.gesture for _, clip in learned.clips]
            counts = [made.count(name) for name in learned.gestures]
            shares = np.array(counts) / len(made)
        answers = RecogniserMethod(SHORT).fit(learned, 0)(learned)
        np.testing.assert_allclose(np.exp(answers), np.tile(shares, (2, 1)))
    assert "none" in examples.gestures and "none" not in touches.gestures


def test_touch_features_are_zero_without_contact(examples, monkeypatch):
    rows = build_touch_rows(examples)
    assert len(rows) == len(examples.clips) and np.isfinite(rows).all()
    assert rows.any(axis=1).all() and len(np.unique(rows, axis=0)) == len(rows)
    ends = list(methods.find_last_rows(examples.dataset(GraphConfig()), examples.clips))
    ends[2] = -1
    monkeypatch.setattr(methods, "find_last_rows", lambda dataset, every: ends)
    other = build_touch_rows(examples)
    assert not other[2].any()
    np.testing.assert_array_equal(np.delete(other, 2, 0), np.delete(rows, 2, 0))
