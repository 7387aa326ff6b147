"""A window is changed as another person and another skin would change it."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.learn.batches import augment
from eskin.learn.config import NO_AUGMENTATION, AugmentConfig
from eskin.learn.dataset import prepare
from eskin.live import HISTORY, join_graphs
from helpers.graphs import random_graph
from helpers.learning import AS_RECORDED, record

CHANGED = {"pressure", "before", "shear", "shear_before"}
STILL = {"taxel_gain": 0.0, "dead": 0.0, "offset": 0.0, "shear_gain": 0.0}


@pytest.fixture(scope="module")
def graphs(tmp_path_factory):
    path = tmp_path_factory.mktemp("shear") / "a.mcap"
    dataset = prepare([record(path, kind="shear")])
    return dataset.graphs.select(np.arange(50, len(dataset.stamps)))


def load_windows(graphs, length=10):
    return np.arange(graphs.size) // length


def ratios(graphs, changed):
    """New to old pressure where there was any, with window and taxel."""
    node = graphs.pressure > 0
    window = load_windows(graphs)[graphs.graph_index]
    ratio = changed.pressure[node] / graphs.pressure[node]
    return window[node], graphs.taxels[node], ratio


def vary(graphs, config, seed=0):
    return augment(graphs, load_windows(graphs), np.random.default_rng(seed), config)


def test_zero_settings_change_nothing(graphs):
    same = vary(graphs, AS_RECORDED)
    for before, after in zip(graphs, same, strict=True):
        assert before.dtype == after.dtype
        np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize("seed", range(3))
def test_augmentation_changes_only_pressure_and_shear(graphs, seed):
    changed = vary(graphs, AugmentConfig(), seed)
    assert changed.pressure.min() >= 0 and changed.before.min() >= 0
    for name, before in graphs._asdict().items():
        after = getattr(changed, name)
        assert (before.shape, before.dtype) == (after.shape, after.dtype)
        if name not in CHANGED:
            np.testing.assert_array_equal(before, after)
        else:
            assert not np.array_equal(before, after)
            assert np.isfinite(after).all()


def test_untouched_taxels_stay_untouched(graphs):
    changed = vary(graphs, AugmentConfig())
    assert (changed.pressure[graphs.pressure == 0] == 0).all()
    assert (changed.shear[(graphs.shear == 0).all(axis=1)] == 0).all()


def test_taxel_gains_are_drawn_once_per_window(graphs):
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


def test_the_gain_of_a_person_is_one_per_window(graphs):
    window, _, ratio = ratios(graphs, vary(graphs, AugmentConfig(0.4, **STILL)))
    means = []
    for number in np.unique(window):
        mine = ratio[window == number]
        np.testing.assert_allclose(mine, mine[0], rtol=1e-5)
        means.append(mine[0])
    assert np.std(np.log(means)) > 0.1


def test_the_previous_reading_gets_the_same_gains(graphs):
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


def test_dead_taxels_are_zero_in_their_whole_window(graphs):
    config = AugmentConfig(0.0, 0.0, 0.5, 0.0, 0.0)
    window, taxel, ratio = ratios(graphs, vary(graphs, config))
    assert set(np.unique(ratio)) == {0.0, 1.0}
    for key in set(zip(window.tolist(), taxel.tolist(), strict=True)):
        one = ratio[(window == key[0]) & (taxel == key[1])]
        assert len(set(one.tolist())) == 1


def test_the_offset_is_bounded(graphs):
    config = AugmentConfig(0.0, 0.0, 0.0, 2.0, 0.0)
    lost = graphs.pressure - vary(graphs, config).pressure
    assert lost.min() >= 0 and 0 < lost.max() <= 2.0 + 1e-5


def synthetic(windows=60, length=4, nodes=8):
    """Graphs of windows, each of taxels 0 to 7, with a history."""
    rng = np.random.default_rng(0)
    count = windows * length
    return join_graphs([random_graph(rng, nodes) for _ in range(count)]), np.repeat(
        np.arange(windows), length
    )


def varied(config, patch_index=None, seed=0):
    graphs, window = synthetic()
    rng = np.random.default_rng(seed)
    return graphs, window, augment(graphs, window, rng, config, patch_index)


def test_past_forces_get_the_gain_of_the_person():
    config = replace(NO_AUGMENTATION, gain=0.4)
    graphs, window, changed = varied(config)
    node = graphs.pressure > 0
    person = np.zeros(window.max() + 1)
    person[window[graphs.graph_index[node]]] = (
        changed.pressure[node] / graphs.pressure[node]
    )
    for column, name in enumerate(HISTORY):
        grows = person[window] if name in ("impulse", "peak force") else 1.0
        np.testing.assert_allclose(
            changed.history[:, column], graphs.history[:, column] * grows, rtol=1e-4
        )


def test_changes_of_the_skin_leave_past_forces_alone():
    config = replace(NO_AUGMENTATION, taxel_gain=0.3, dead=0.3, offset=2.0, noise=0.2)
    graphs, _, changed = varied(config)
    np.testing.assert_array_equal(changed.history, graphs.history)


def test_noise_is_independent_and_centred_on_the_pressure():
    graphs, _, changed = varied(replace(NO_AUGMENTATION, noise=0.1))
    node = graphs.pressure > 0
    ratio = changed.pressure[node] / graphs.pressure[node]
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)
    assert ratio.std() == pytest.approx(0.1, abs=0.02)
    assert len(np.unique(ratio)) > 0.9 * len(ratio)
    # The reading before has noise of its own.
    both = node & (graphs.before > 0)
    other = changed.before[both] / graphs.before[both]
    now = changed.pressure[both] / graphs.pressure[both]
    assert abs(np.corrcoef(now, other)[0, 1]) < 0.1
    assert changed.pressure.dtype == changed.before.dtype == np.float32


PATCHES = np.array([0, 0, 0, 1, 1, 2, 2, 2, 3])


def silent_patches(graphs, window, changed):
    """The patches of each window that were touched, and of these the silent ones."""
    for number in range(window.max() + 1):
        mine = window[graphs.graph_index] == number
        active = mine & (graphs.pressure > 0)
        touched = set(PATCHES[graphs.taxels[active]].tolist())
        remaining = set(PATCHES[graphs.taxels[mine & (changed.pressure > 0)]].tolist())
        yield touched, touched - remaining


def test_one_of_several_touched_patches_may_be_dropped():
    config = replace(NO_AUGMENTATION, patch=1.0)
    graphs, window, changed = varied(config, PATCHES)
    found = list(silent_patches(graphs, window, changed))
    assert all(len(silent) == (len(touched) > 1) for touched, silent in found)
    assert {patch for _, silent in found for patch in silent} == {0, 1, 2}
    kept = changed.pressure > 0
    np.testing.assert_allclose(changed.pressure[kept], graphs.pressure[kept], rtol=1e-6)
    assert (changed.before[changed.pressure > 0] >= 0).all()


def test_the_setting_is_the_share_of_windows_with_a_dropped_patch():
    graphs, window, changed = varied(replace(NO_AUGMENTATION, patch=0.4), PATCHES)
    silent = [len(silent) for _, silent in silent_patches(graphs, window, changed)]
    assert np.mean(silent) == pytest.approx(0.4, abs=0.15)
    graphs, window, changed = varied(replace(NO_AUGMENTATION, patch=1.0))
    np.testing.assert_array_equal(changed.pressure, graphs.pressure)


def test_the_only_touched_patch_is_never_dropped():
    config = replace(NO_AUGMENTATION, patch=1.0)
    graphs, _, changed = varied(config, np.zeros(9, np.int64))
    np.testing.assert_array_equal(changed.pressure, graphs.pressure)
