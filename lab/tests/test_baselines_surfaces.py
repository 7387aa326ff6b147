"""Spline surfaces on unrolled links, and the total force as one signal."""

import numpy as np
import pytest

from helpers.baselines import SMALL, UR5, toy
from lab.baselines import READINGS, SkinWindows, build_baseline
from lab.baselines.signal import BANDS, LEVELS, compute_bands, compute_signal_features
from lab.baselines.spline import build_surfaces, compute_moments


@pytest.fixture(scope="module", params=["flat", "arm"])
def mounted(request):
    return SMALL if request.param == "flat" else UR5


def test_every_taxel_is_on_one_surface(mounted):
    taxels = np.concatenate([s.taxels for s in build_surfaces(mounted.skin)])
    assert sorted(taxels.tolist()) == list(range(mounted.skin.count))


def test_pressure_that_is_linear_in_place_is_fitted_exactly(mounted):
    """The penalty is on curvature alone."""
    for surface in build_surfaces(mounted.skin):
        for axis in (0, 1):
            pressure = 2.0 + surface.places[:, axis]
            heights = surface.smooth @ pressure
            np.testing.assert_allclose(heights, pressure, atol=1e-3)


def test_taxels_of_a_link_keep_their_distances_when_unrolled(mounted):
    """But for those on both sides of the seam."""
    for surface in build_surfaces(mounted.skin):
        points = mounted.skin.positions[surface.taxels]
        true = np.linalg.norm(points[:, None] - points[None], axis=2)
        places = surface.places
        found = np.linalg.norm(places[:, None] - places[None], axis=2)
        near = (true > 0) & (true < 0.012)
        ratio = found[near] / true[near]
        assert np.median(ratio) == pytest.approx(1.0, abs=0.3)
        assert (ratio < 2.5).mean() > 0.9


def test_moments_follow_a_press_and_tell_its_size():
    (surface,) = build_surfaces(SMALL.skin)
    for place in np.quantile(surface.places, [0.4, 0.6], axis=0):
        distance = np.linalg.norm(surface.places - place, axis=1)
        small, wide = (
            compute_moments(surface.smooth @ pressure, surface.places)
            for pressure in np.exp(-((distance / np.array([[0.015], [0.03]])) ** 2))
        )
        np.testing.assert_allclose(small[2:4], place, atol=0.01)
        assert wide[0] > 2 * small[0]
        assert (wide[4:] > small[4:]).all()
    assert not compute_moments(np.zeros(len(surface.places)), surface.places).any()


def test_one_signal_has_no_places():
    """Wherever a touch is, its signal and features are the same; surfaces differ."""
    clips, _ = toy(2)
    order = np.random.default_rng(0).permutation(SMALL.skin.count)
    assert np.ptp(SMALL.skin.areas) == 0
    moved = SkinWindows(clips.pressure[:, :, order], clips.q)
    for name, same in (
        ("signal-svm", True),
        ("signal-mlp", True),
        ("spline-svm", False),
    ):
        baseline = build_baseline(name, SMALL)
        one = baseline.compute_rows(clips)
        other = baseline.compute_rows(moved)
        assert np.isfinite(one).all()
        assert np.allclose(one, other, rtol=1e-4, atol=1e-4) == same


@pytest.mark.parametrize(("hertz", "band"), [(0.5, 0), (2.0, 3), (5.0, 4), (12.0, 6)])
def test_a_periodic_force_has_its_power_in_its_band(hertz, band):
    time = np.arange(READINGS) / 50
    force = 3.0 + np.sin(2 * np.pi * hertz * time)[None]
    shares = compute_bands(force)[0]
    assert len(shares) == len(BANDS) - 1
    assert shares.argmax() == band
    assert shares.sum() == pytest.approx(1.0, abs=0.05)


def test_presses_are_counted_in_the_signal_and_silence_is_zero():
    force = np.zeros((3, READINGS))
    force[1, 20:30] = force[2, 20:30] = force[2, 50:60] = 4.0
    features = compute_signal_features(force)
    assert not features[0].any()
    first = features.shape[1] - (len(BANDS) - 1) - 2 * len(LEVELS)
    above = features[:, first]
    presses = features[:, first + 1]
    np.testing.assert_allclose(above, [0.0, 0.1, 0.2])
    assert presses.tolist() == [0, 1, 2]
