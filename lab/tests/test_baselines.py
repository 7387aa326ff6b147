"""Laws of every baseline."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from eskin.errors import SkinMismatchError
from helpers.baselines import SMALL, toy
from helpers.live import mounted
from lab.baselines import (
    BASELINES,
    NETWORKS,
    READINGS,
    FitConfig,
    SkinWindows,
    build_baseline,
)
from lab.baselines.estimators import GradientBoosting, RandomForest
from lab.baselines.hand import HandBaseline
from lab.baselines.interface import RollingWindow
from lab.baselines.network import MOST_HELD, hold_windows_out

pytestmark = pytest.mark.slow

NAMES = (*BASELINES, *NETWORKS)
QUICK = FitConfig(epochs=12, batch=6, rate=5e-3)
every_baseline = pytest.mark.parametrize("name", NAMES)


FEW_TREES = {
    "random-forest": RandomForest(trees=8),
    "gradient-boosting": GradientBoosting(trees=4),
}


@pytest.fixture(autouse=True)
def few_trees(monkeypatch):
    for name, estimator in FEW_TREES.items():
        baseline = partial(HandBaseline, estimator=estimator)
        monkeypatch.setitem(BASELINES, name, baseline)


def fit(name, seed):
    return build_baseline(name, SMALL, FitConfig(epochs=1)).fit(*toy(2), seed)


@cache
def fitted(name):
    return fit(name, 5)


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.long if n == "paper" else ()) for n in NAMES],
)
def test_clearly_different_classes_are_separated(name):
    clips, labels = toy(2, seed=1)
    baseline = build_baseline(name, SMALL, QUICK).fit(*toy(), 3)
    answers = baseline.predict_probabilities(clips)
    assert answers.argmax(axis=1).tolist() == labels.tolist()


@every_baseline
def test_probabilities_are_of_all_classes_and_sum_to_one(name):
    answers = fitted(name).predict_probabilities(toy(2, seed=1)[0])
    assert answers.shape == (6, 3)
    assert (answers >= 0).all()
    np.testing.assert_allclose(answers.sum(axis=1), 1, atol=1e-5)


@every_baseline
def test_the_same_seed_gives_the_same_answers(name):
    clips, _ = toy(2)
    one = fitted(name)
    other = fit(name, 5)
    answers = one.predict_probabilities(clips)
    assert np.array_equal(answers, other.predict_probabilities(clips))


@pytest.mark.parametrize("name", ["mlp-max", "random-forest", *NETWORKS])
def test_another_seed_gives_other_answers(name):
    clips, _ = toy(2)
    one = fitted(name)
    other = fit(name, 6)
    answers = one.predict_probabilities(clips)
    assert not np.array_equal(answers, other.predict_probabilities(clips))


@pytest.mark.parametrize(
    "change", [{"epochs": 1}, {"batch": 2}, {"rate": 1e-4}, {"schedule": "constant"}]
)
def test_every_setting_of_training_changes_the_result(change):
    clips, labels = toy(2)
    usual = FitConfig(epochs=2, batch=3)
    answers = [
        build_baseline("tactile-image", SMALL, config)
        .fit(clips, labels, 5)
        .predict_probabilities(clips)
        for config in (usual, replace(usual, **change))
    ]
    assert not np.array_equal(*answers)


@every_baseline
def test_windows_of_another_skin_are_refused_with_one_line(name):
    others = SkinWindows(
        np.zeros((2, READINGS, 90), np.float32), np.zeros((2, READINGS, 0), np.float32)
    )
    for call in (
        lambda: build_baseline(name, SMALL).fit(others, np.arange(2)),
        lambda: fitted(name).predict_probabilities(others),
    ):
        with pytest.raises(SkinMismatchError) as caught:
            call()
        message = str(caught.value)
        assert "clips of (100, 90) pressures" in message and "\n" not in message
        assert "of robot 'table' are (100, 240)" in message


@every_baseline
def test_labels_that_do_not_fit_the_clips_are_refused(name):
    clips, _ = toy(2)
    for labels in ([0, 1], [0] * 6, [0, 2, 0, 2, 0, 2]):
        with pytest.raises(ValueError, match="labels of . classes up to . for 6 clips"):
            build_baseline(name, SMALL).fit(clips, np.array(labels))


@every_baseline
def test_a_baseline_that_was_not_fitted_is_refused(name):
    with pytest.raises(ValueError, match="has learned nothing yet"):
        build_baseline(name, SMALL).predict_probabilities(toy(2)[0])


@every_baseline
def test_streams_give_the_probabilities_of_the_window(name):
    """Not tested for networks on whole windows, which repeat the work 100 times."""
    clips, _ = toy(2, seed=1)
    want = fitted(name).predict_probabilities(clips)[2]
    for way, stream in fitted(name).build_streams().items():
        if way or name not in NETWORKS:
            readings = zip(clips.pressure[2], clips.q[2].astype(float), strict=True)
            *_, got = (stream.push(*reading) for reading in readings)
            np.testing.assert_allclose(got, want, atol=1e-4, err_msg=way)


def test_a_rolling_window_holds_the_last_readings_oldest_first():
    window = RollingWindow((2,))
    for n in range(250):
        rows = window.push(np.array([n, -n]))
        want = np.maximum(np.arange(n - READINGS + 1, n + 1), 0)
        assert np.array_equal(rows, np.stack([want, -want], axis=1))


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="no baseline 'oracle'; allowed are svm-max"):
        build_baseline("oracle", mounted())


def test_windows_of_one_example_are_held_out_together():
    """They overlap, so that those held out would otherwise be known."""
    example = np.repeat(np.arange(40), 5)
    clips = SkinWindows(np.zeros((200, 1, 1)), np.zeros((200, 1, 1)), example)
    own, held = hold_windows_out(clips, 0.25, np.random.default_rng(0))
    assert len(own) == 150 and len(held) == 50
    assert not set(example[own]) & set(example[held])


def test_at_most_some_windows_choose_the_epoch():
    clips = SkinWindows(np.zeros((4000, 1, 1)), np.zeros((4000, 1, 1)))
    own, held = hold_windows_out(clips, 0.15, np.random.default_rng(0))
    assert len(own) == 3400 and len(held) == MOST_HELD
    assert len(hold_windows_out(clips, 0.0, np.random.default_rng(0))[1]) == 0
