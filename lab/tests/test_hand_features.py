"""Hand-made features: finite everywhere, and what they are named."""

import numpy as np
import pytest

from eskin.learn.dataset import prepare
from helpers.learning import record
from lab.baselines.hand import BANDS, compute_band_powers, compute_features


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return prepare([record(tmp_path_factory.mktemp("f") / "a.mcap", kind="shear")])


def test_every_interval_has_the_same_number_of_finite_features(dataset):
    rows = np.arange(len(dataset.stamps))
    silent = rows[:30]
    touched = rows[48:75]
    for shear in (False, True):
        sizes = set()
        for stretch in (silent, silent[:1], silent[:3], touched, touched[:1], rows):
            features = compute_features(dataset, stretch, shear)
            assert np.isfinite(features).all()
            sizes.add(features.shape)
        assert len(sizes) == 1


def test_shear_adds_features_and_keeps_the_others(dataset):
    segment = dataset.labelled[0]
    rows = np.arange(segment.first, segment.end)
    without = compute_features(dataset, rows, False)
    with_shear = compute_features(dataset, rows, True)
    assert len(with_shear) > len(without)
    whole = 1 + 2 + 2 + len(BANDS) - 1
    np.testing.assert_array_equal(with_shear[:whole], without[:whole])


@pytest.mark.parametrize(("hertz", "band"), [(0.6, 0), (1.5, 1), (2.5, 2), (4.0, 3)])
def test_a_periodic_signal_has_its_power_in_its_band(hertz, band):
    seconds = np.arange(200) / 20
    shares = compute_band_powers(1 + np.sin(2 * np.pi * hertz * seconds), seconds)
    assert shares.argmax() == band
    assert shares[band] > 0.8
    assert shares.sum() <= 1 + 1e-9
