"""A window is changed as another person and another skin would change it."""

from dataclasses import fields

import numpy as np
import pytest

from eskin.learn.augment import AugmentConfig, augment
from eskin.learn.dataset import prepare
from learn_scenes import AS_RECORDED, record

CHANGED = {"pressure", "before", "shear", "shear_before"}
STILL = {"taxel_gain": 0.0, "dead": 0.0, "offset": 0.0, "shear_gain": 0.0}


@pytest.fixture(scope="module")
def graphs(tmp_path_factory):
    path = tmp_path_factory.mktemp("shear") / "a.mcap"
    dataset = prepare([record(path, kind="shear")])
    return dataset.graphs.select(np.arange(50, len(dataset.stamps)))


def windows_of(graphs, length=10):
    return np.arange(graphs.count) // length


def ratios(graphs, changed):
    """New to old pressure where there was any, with window and taxel."""
    node = graphs.pressure > 0
    window = windows_of(graphs)[graphs.graph_index]
    ratio = changed.pressure[node] / graphs.pressure[node]
    return window[node], graphs.taxels[node], ratio


def vary(graphs, config, seed=0):
    return augment(graphs, windows_of(graphs), np.random.default_rng(seed), config)


def test_the_scene_has_pressure_and_shear(graphs):
    assert (graphs.pressure > 0).sum() > 100
    assert np.abs(graphs.shear).max() > 1


def test_no_settings_change_nothing(graphs):
    same = vary(graphs, AS_RECORDED)
    for field in fields(graphs):
        before, after = getattr(graphs, field.name), getattr(same, field.name)
        assert before.dtype == after.dtype
        np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_pulls_and_all_but_pressure_and_shear_stays(graphs, seed):
    changed = vary(graphs, AugmentConfig(), seed)
    assert changed.pressure.min() >= 0 and changed.before.min() >= 0
    for field in fields(graphs):
        before, after = getattr(graphs, field.name), getattr(changed, field.name)
        assert (before.shape, before.dtype) == (after.shape, after.dtype)
        if field.name not in CHANGED:
            np.testing.assert_array_equal(before, after)
        else:
            assert not np.array_equal(before, after)
            assert np.isfinite(after).all()


def test_untouched_taxels_stay_untouched(graphs):
    changed = vary(graphs, AugmentConfig())
    assert (changed.pressure[graphs.pressure == 0] == 0).all()
    assert (changed.shear[(graphs.shear == 0).all(axis=1)] == 0).all()


def test_a_taxel_has_one_gain_in_a_window_and_another_in_the_next(graphs):
    config = AugmentConfig(**STILL | {"taxel_gain": 0.2})
    window, taxel, ratio = ratios(graphs, vary(graphs, config))
    gains = {}
    for key, value in zip(zip(window, taxel, strict=True), ratio, strict=True):
        assert gains.setdefault(key, value) == pytest.approx(value, rel=1e-5)
    assert len(set(gains.values())) > 0.9 * len(gains)
    by_taxel = {}
    for (_, number), gain in gains.items():
        by_taxel.setdefault(number, []).append(gain)
    assert all(np.ptp(g) > 1e-3 for g in by_taxel.values() if len(g) > 1)
    assert max(map(len, by_taxel.values())) > 1


def test_a_person_presses_as_much_harder_on_every_taxel_of_a_window(graphs):
    window, _, ratio = ratios(graphs, vary(graphs, AugmentConfig(0.4, **STILL)))
    means = []
    for number in np.unique(window):
        mine = ratio[window == number]
        np.testing.assert_allclose(mine, mine[0], rtol=1e-5)
        means.append(mine[0])
    assert np.std(np.log(means)) > 0.1


def test_the_reading_before_changes_as_the_reading_did(graphs):
    config = AugmentConfig(offset=0.0)
    changed = vary(graphs, config)
    node = (graphs.pressure > 0) & (graphs.before > 0) & (changed.pressure > 0)
    assert node.any()
    now = changed.pressure[node] / graphs.pressure[node]
    np.testing.assert_allclose(changed.before[node] / graphs.before[node], now, 1e-5)


def test_shear_keeps_its_direction(graphs):
    changed = vary(graphs, AugmentConfig(dead=0.0))
    cross = np.cross(graphs.shear, changed.shear)
    np.testing.assert_allclose(cross, 0, atol=1e-3)
    assert ((graphs.shear * changed.shear).sum(axis=1) >= 0).all()


def test_dead_taxels_are_silent_in_their_whole_window(graphs):
    config = AugmentConfig(0.0, 0.0, 0.5, 0.0, 0.0)
    window, taxel, ratio = ratios(graphs, vary(graphs, config))
    assert set(np.unique(ratio)) == {0.0, 1.0}
    for key in set(zip(window.tolist(), taxel.tolist(), strict=True)):
        one = ratio[(window == key[0]) & (taxel == key[1])]
        assert len(set(one.tolist())) == 1


def test_the_offset_takes_no_more_than_its_bound(graphs):
    config = AugmentConfig(0.0, 0.0, 0.0, 2.0, 0.0)
    lost = graphs.pressure - vary(graphs, config).pressure
    assert lost.min() >= 0 and 0 < lost.max() <= 2.0 + 1e-5
