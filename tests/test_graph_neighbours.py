"""Who is whose neighbour: fixed inside a patch, live between patches."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.graph import FixedNeighbours, find_live_neighbours
from helpers.graphs import FOLDED, Scene, book, flat, motion, renumbered, rolled, ur5

SKINS = {
    "flat": lambda: flat(rows=5, columns=6, patches=2),
    "rolled": rolled,
    "book": book,
    "ur5": ur5,
}
on_any_skin = pytest.mark.parametrize("name", SKINS)


def place(skin, taxel):
    """What travels with a taxel."""
    patch = skin.patches[skin.patch_index[taxel]].id
    return patch, int(skin.rows[taxel]), int(skin.columns[taxel])


@on_any_skin
@pytest.mark.parametrize("k", [1, 8])
def test_fixed_neighbours_are_the_nearest_of_the_patch_and_ties_go_by_place(name, k):
    skin = SKINS[name]().skin
    table = FixedNeighbours(skin, k).table
    whole = np.rint(skin.positions * 1e6)
    for taxel in np.random.default_rng(0).permutation(skin.count)[:60]:
        mates = np.flatnonzero(skin.patch_index == skin.patch_index[taxel])
        squared = ((whole[mates] - whole[taxel]) ** 2).sum(axis=1)
        keys = sorted(
            (distance, place(skin, mate), mate)
            for distance, mate in zip(squared.tolist(), mates.tolist(), strict=True)
            if mate != taxel
        )
        assert table[taxel].tolist() == [mate for _, _, mate in keys[:k]]


@on_any_skin
def test_no_fixed_edge_crosses_patches_and_nobody_is_its_own_neighbour(name):
    skin = SKINS[name]().skin
    table = FixedNeighbours(skin, 8).table
    assert (skin.patch_index[table] == skin.patch_index[:, None]).all()
    assert (table != np.arange(skin.count)[:, None]).all()


def test_the_ur5_skin_has_eight_fixed_edges_a_taxel():
    assert FixedNeighbours(ur5().skin, 8).edge_count == 2112 * 8


def test_a_patch_with_fewer_taxels_than_neighbours_joins_them_all():
    skin = flat(rows=1, columns=3, patches=2).skin
    neighbours = FixedNeighbours(skin, 4)
    assert neighbours.edge_count == 2 * 3 * 2
    assert neighbours.table[1].tolist() == [0, 2, -1, -1]
    assert neighbours.table[5].tolist() == [4, 3, -1, -1]
    assert FixedNeighbours(flat(rows=1, columns=1).skin, 4).edge_count == 0


def test_rounding_errors_below_a_micrometre_choose_no_neighbour():
    skin = flat().skin
    noise = np.random.default_rng(1).uniform(-1e-7, 1e-7, skin.positions.shape)
    shaken = replace(skin, positions=skin.positions + noise)
    assert np.array_equal(
        FixedNeighbours(shaken, 8).table, FixedNeighbours(skin, 8).table
    )


@on_any_skin
def test_fixed_neighbours_do_not_depend_on_numbering(name):
    mounted = SKINS[name]()
    skin, other = mounted.skin, renumbered(Scene(mounted, ())).mounted.skin
    tables = [named_table(skin), named_table(other)]
    assert tables[0] == tables[1]


def named_table(skin):
    table = FixedNeighbours(skin, 8).table
    places = [place(skin, taxel) for taxel in range(skin.count)]
    return {places[i]: [places[j] for j in table[i]] for i in range(skin.count)}


def brute_force(p_world, patch, rank, k, reach):
    nearest = np.full((len(p_world), k), -1)
    for i, p in enumerate(p_world):
        length = np.rint(np.linalg.norm(p_world - p, axis=1) * 1e6)
        others = np.flatnonzero((patch != patch[i]) & (length <= round(reach * 1e6)))
        order = np.lexsort((rank[others], length[others]))[:k]
        nearest[i, : len(order)] = others[order]
    return nearest


def cloud(seed, nodes=80):
    rng = np.random.default_rng(seed)
    patch, rank = rng.integers(0, 4, nodes), rng.permutation(nodes)
    return rng.uniform(0, 0.1, (nodes, 3)), patch, rank


@pytest.mark.parametrize("k", [1, 4, 100])
@pytest.mark.parametrize("reach", [0.005, 0.03, 1.0])
def test_live_neighbours_are_the_nearest_of_other_patches_within_reach(k, reach):
    for seed in range(3):
        scene = cloud(seed)
        want = brute_force(*scene, k, reach)
        assert np.array_equal(find_live_neighbours(*scene, k, reach), want)
    grid = ur5().place_taxels(FOLDED)[0][::9], ur5().skin.patch_index[::9]
    rank = np.arange(len(grid[0]))[::-1].copy()
    want = brute_force(*grid, rank, k, reach)
    assert np.array_equal(find_live_neighbours(*grid, rank, k, reach), want)


def test_whoever_reaches_another_is_reached_by_it():
    nearest = find_live_neighbours(*cloud(7), 100, 0.03)
    pairs = {(i, j) for i, row in enumerate(nearest.tolist()) for j in row if j >= 0}
    assert pairs
    assert pairs == {(j, i) for i, j in pairs}


def test_equally_far_neighbours_and_those_just_in_reach_stay_when_all_moves():
    """Two grids at one pitch, where the reach is a whole number of pitches."""
    mounted = flat(rows=6, columns=6, patches=2)
    patch, rank = mounted.skin.patch_index, np.arange(mounted.skin.count)
    p_world, _ = mounted.place_taxels(np.zeros(0))
    want = find_live_neighbours(p_world, patch, rank, 4, 0.03)
    gap = np.linalg.norm(p_world[want] - p_world[:, None], axis=2)
    assert np.isclose(gap[want >= 0].max(), 0.03)
    for seed in range(5):
        T = motion(seed)
        turned = p_world @ T[:3, :3].T + T[:3, 3]
        assert np.array_equal(find_live_neighbours(turned, patch, rank, 4, 0.03), want)


def test_a_taxel_a_micrometre_out_of_reach_is_no_neighbour():
    patch, rank = np.array([0, 1, 1]), np.arange(3)
    for far, want in ((0.0300004, [1, 2]), (0.0300006, [1, -1])):
        p_world = np.array([[0.0, 0.0, 0.0], [0.029, 0.0, 0.0], [0.0, far, 0.0]])
        assert find_live_neighbours(p_world, patch, rank, 2, 0.03)[0].tolist() == want


def test_nobody_has_live_neighbours_alone_on_one_patch_or_when_none_are_wanted():
    p, patch, rank = cloud(3)
    assert (find_live_neighbours(p, np.zeros_like(patch), rank, 4, 1.0) == -1).all()
    assert find_live_neighbours(p, patch, rank, 0, 1.0).shape == (len(p), 0)
    assert find_live_neighbours(p[:0], patch[:0], rank[:0], 4, 1.0).shape == (0, 4)
    assert (find_live_neighbours(p, patch, rank, 4, 1e-5) == -1).all()


def test_live_neighbours_follow_the_pose():
    mounted = ur5()
    skin, rank = mounted.skin, np.arange(mounted.skin.count)
    edges = [
        find_live_neighbours(
            mounted.place_taxels(q)[0], skin.patch_index, rank, 4, 0.03
        )
        for q in (np.zeros(6), FOLDED)
    ]
    links = mounted.taxel_link_index
    across = [(links[e] != links[:, None]) & (e >= 0) for e in edges]
    assert across[0].sum() == 0
    assert across[1].sum() > 50
