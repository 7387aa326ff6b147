"""Tests of the neighbours of taxels: fixed inside a patch, live between patches."""

import numpy as np
import pytest

from eskin.live import FixedNeighbours, find_live_neighbours
from helpers.graphs import (
    FOLDED,
    Scene,
    book,
    flat,
    renumber_scene,
    rolled,
    ur5,
)

SKINS = {
    "flat": lambda: flat(rows=5, columns=6, patches=2),
    "rolled": rolled,
    "book": book,
    "ur5": ur5,
    "renumbered ur5": lambda: renumber_scene(Scene(ur5(), ())).mounted,
}


@pytest.mark.parametrize("name", SKINS)
@pytest.mark.parametrize("k", [1, 8])
def test_fixed_neighbours_are_the_nearest_of_the_patch(name, k):
    """Ties are broken by patch, row and column."""
    skin = SKINS[name]().skin
    table = FixedNeighbours(skin, k).table
    whole = np.rint(skin.positions * 1e6)
    for taxel in np.random.default_rng(0).permutation(skin.count)[:60]:
        others = np.flatnonzero(skin.patch_index == skin.patch_index[taxel])
        others = others[others != taxel]
        squared = ((whole[others] - whole[taxel]) ** 2).sum(axis=1)
        order = np.lexsort((skin.columns[others], skin.rows[others], squared))
        assert np.array_equal(table[taxel], others[order][:k])


def test_patch_of_few_taxels_joins_them_all():
    neighbours = FixedNeighbours(flat(rows=1, columns=3, patches=2).skin, 4)
    assert (neighbours.table >= 0).sum() == 2 * 3 * 2
    assert neighbours.table[1].tolist() == [0, 2, -1, -1]
    assert neighbours.table[5].tolist() == [4, 3, -1, -1]
    assert (FixedNeighbours(flat(rows=1, columns=1).skin, 4).table < 0).all()


def search_all(p_world, patch, rank, k, reach):
    """Find live neighbours by computing all distances."""
    nearest = np.full((len(p_world), k), -1)
    for i, p in enumerate(p_world):
        length = np.rint(np.linalg.norm(p_world - p, axis=1) * 1e6)
        others = np.flatnonzero((patch != patch[i]) & (length <= round(reach * 1e6)))
        order = np.lexsort((rank[others], length[others]))[:k]
        nearest[i, : len(order)] = others[order]
    return nearest


def random_points(seed, nodes=80):
    """Return positions, patches and ranks."""
    rng = np.random.default_rng(seed)
    patch = rng.integers(0, 4, nodes)
    rank = rng.permutation(nodes)
    return rng.uniform(0, 0.1, (nodes, 3)), patch, rank


@pytest.mark.parametrize("k", [1, 4, 100])
@pytest.mark.parametrize("reach", [0.005, 0.03, 1.0])
def test_live_neighbours_are_the_nearest_of_other_patches(k, reach):
    p_world = ur5().place_taxels(FOLDED)[0][::9]
    patch = ur5().skin.patch_index[::9]
    folded_arm = p_world, patch, np.arange(len(patch))[::-1].copy()
    for nodes in (random_points(0), random_points(1), folded_arm):
        found = find_live_neighbours(*nodes, k, reach)
        assert np.array_equal(found, search_all(*nodes, k, reach))


@pytest.mark.parametrize(("far", "want"), [(0.0300004, [1, 2]), (0.0300006, [1, -1])])
def test_reach_is_compared_in_whole_micrometres(far, want):
    p_world = np.array([[0.0, 0.0, 0.0], [0.029, 0.0, 0.0], [0.0, far, 0.0]])
    patch = np.array([0, 1, 1])
    rank = np.arange(3)
    assert find_live_neighbours(p_world, patch, rank, 2, 0.03)[0].tolist() == want


def test_live_neighbours_may_be_none():
    p, patch, rank = random_points(3)
    assert (find_live_neighbours(p, np.zeros_like(patch), rank, 4, 1.0) == -1).all()
    assert (find_live_neighbours(p, patch, rank, 4, 1e-5) == -1).all()
    assert find_live_neighbours(p, patch, rank, 0, 1.0).shape == (len(p), 0)
    assert find_live_neighbours(p[:0], patch[:0], rank[:0], 4, 1.0).shape == (0, 4)
