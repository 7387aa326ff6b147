"""Classifiers of series: what they are computed from, and easy gestures."""

import numpy as np
import pytest

from lab.baselines.interface import READINGS
from lab.baselines.series import (
    CHANNELS,
    SERIES,
    MiniRocket,
    align_series,
    compute_interval_quantiles,
)

RNG = np.random.default_rng(0)


def make_touches(gesture, count=12):
    """Return series of touches by one finger or a hand, of several durations."""
    X = np.zeros((count, len(CHANNELS), READINGS))
    force, area, travel = (CHANNELS.index(name) for name in ("force", "area", "travel"))
    for row in X:
        steps = int(RNG.integers(12, 25))
        on = np.zeros(READINGS, bool)
        on[-30 - steps : -30] = True
        if gesture == "double_pat":
            on[-30 - 2 * steps - 6 : -36 - steps] = True
        if gesture in ("stroke", "grab"):
            on[-80:-30] = True
        row[force] = 3.0 * on
        row[area] = np.log1p(2.0) * on
        row[area] *= 3.0 if gesture == "grab" else 1.0
        row[travel] = np.linspace(0, 2.2, READINGS) * (gesture == "stroke")
    return X + RNG.normal(0, 0.01, X.shape)


@pytest.mark.parametrize("name", SERIES)
def test_easy_gestures_are_told_apart(name):
    gestures = ("double_pat", "grab", "poke", "stroke")
    X, Z = (np.concatenate([make_touches(each) for each in gestures]) for _ in range(2))
    y = np.repeat(gestures, 12)
    model = SERIES[name](0).fit(X, y)
    assert tuple(model.classes_) == gestures
    probabilities = model.predict_proba(Z)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1.0)
    assert (model.classes_[probabilities.argmax(axis=1)] == y).mean() > 0.9


def test_series_end_with_the_touch_and_repeat_what_is_missing():
    readings = RNG.random((3, len(CHANNELS)))
    series = align_series(readings, np.array([50, 51, 54]))
    np.testing.assert_array_equal(series[:, -5:].T, readings[[0, 1, 1, 1, 2]])
    assert not series[:, :-5].any()


def test_convolved_features_are_shares_that_no_gain_of_a_channel_changes():
    X = RNG.random((6, len(CHANNELS), READINGS))
    found = MiniRocket(3).fit(X).transform(X)
    assert found.min() >= 0 and found.max() <= 1 and found.std(axis=0).max() > 0.1
    gains = np.array([[0.1], *[[7.0]] * (len(CHANNELS) - 1)])
    again = MiniRocket(3).fit(gains * X).transform(gains * X)
    np.testing.assert_allclose(again, found, atol=0.011)


def test_first_quantiles_are_of_the_whole_series():
    X = RNG.random((4, 1, READINGS))
    found = compute_interval_quantiles(X)
    whole = np.quantile(X[:, 0], np.linspace(0, 1, 25), axis=1).T
    whole[:, 1::2] -= X.mean(axis=2)
    np.testing.assert_allclose(found[:, :25], whole)
