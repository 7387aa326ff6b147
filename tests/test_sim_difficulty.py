"""These tests check the benchmark of how hard simulated clips are."""

import numpy as np
import pytest

from eskin.sim.dataset import GenerationSettings
from eskin.touch import Calibration
from helpers.worlds import SMALL_POOL
from lab.simulation.clips import as_tap, calibrate_counts, simulate_session
from lab.simulation.features import NAMES, clip_features
from lab.simulation.remains import EDGES, compute_histogram
from lab.simulation.true_features import true_features

AREAS = np.full(2, 1e-4)


def build_truth(force):
    """Build force, area and centroid of a touch."""
    truth = np.zeros((100, 5))
    truth[:, 0], truth[:, 1] = force, np.asarray(force) / 10
    truth[:, 2:] = np.where(truth[:, :1] > 0, 1.0, np.nan)
    return truth


def test_received_counts_read_as_their_pressure_and_others_as_none():
    pressure = np.array([2.0, 10.0, 60.0])
    calibration = Calibration(np.full(3, 0.02), 4095, curve="divider", exponent=0.8)
    counts = [calibration.compute_counts(kpa)[0] + 100 for kpa in pressure]
    counts = np.round([counts, counts]).astype(np.int32)
    received = np.array([[True] * 3, [True, False, False]])
    read = calibrate_counts(counts, received, np.full(3, 100.0), calibration)
    np.testing.assert_allclose(read[0], pressure, rtol=0.02)
    np.testing.assert_allclose(read[1], [2.0, 0.0, 0.0], rtol=0.02)


def test_features_count_the_peaks_and_gaps_of_two_pats():
    pressure = np.zeros((100, 2))
    assert not clip_features(pressure, np.eye(2, 3), AREAS).any()
    pressure[20:26, 0] = pressure[40:46, 0] = 20.0
    features = clip_features(pressure, np.eye(2, 3), AREAS)
    found = dict(zip(NAMES, features, strict=True))
    assert (found["peaks"], found["gaps"], found["union of taxels"]) == (2, 1, 1)
    assert np.isclose(found["peak force"], 2.0)
    assert np.isclose(found["seconds"], 0.52)


def test_histogram_does_not_depend_on_place_and_time():
    rng = np.random.default_rng(0)
    pressure = rng.exponential(10.0, (20, 30))
    shuffled = rng.permutation(pressure.ravel()).reshape(20, 30)
    assert (compute_histogram(pressure) == compute_histogram(shuffled)).all()
    assert compute_histogram(pressure).sum() == np.sum(pressure >= EDGES[0])


def test_true_features_are_finite_and_do_not_depend_on_the_place():
    short, course = np.zeros(100), np.sin(np.linspace(0, np.pi, 100)) * 5
    short[50] = 3.0
    sizes = set()
    for force in (np.zeros(100), np.full(100, 5.0), short, course):
        here, there = build_truth(force), build_truth(force)
        there[:, 2:] += [3.0, -2.0, 7.0]
        features = true_features(here)
        assert np.isfinite(features).all()
        np.testing.assert_allclose(features, true_features(there), atol=1e-9)
        sizes.add(len(features))
    assert len(sizes) == 1


@pytest.mark.slow
def test_clips_of_a_session_have_finite_features():
    settings = GenerationSettings("train", clips=5, subjects=1)
    session = settings.sessions[0]
    plans = settings.plan_clips(session)
    assert as_tap(plans[1]) is plans[1]
    made = simulate_session(session, plans, False, tuple(SMALL_POOL.items()))
    labels = ["double_pat", "grab", "none", "poke", "stroke"]
    assert sorted(each.label for each in made) == labels
    for each in made:
        assert np.isfinite(each.features).all()
        assert each.truth.shape == (100, 5)
        pressed = each.truth[:, 0] > 0
        assert np.isfinite(each.truth[pressed]).all()
        assert pressed.any() or each.label == "none"
