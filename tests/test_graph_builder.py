"""Tests of the graph builder: what a graph holds of a touch now and one reading ago."""

import numpy as np
import pytest

from eskin.live import NODE_SCALARS, GraphBuilder, GraphConfig, compute_node_scalars
from helpers.graphs import (
    FOLDED,
    SCENES,
    Scene,
    assert_same,
    book,
    bump,
    flat,
    make_scene,
    move_scene,
    press_on_grid,
    reading_at,
    split_graphs,
    touch_on_arm,
    ur5,
)

NONE = np.empty(0, np.int64)
GRID = flat()
LOAD = bump(GRID.skin, (0, 0, 0))
PRESSED = np.flatnonzero(LOAD)


def build_at(times, *loads):
    """Return the graphs of a touch on the grid at some times [s]."""
    loads = loads or [LOAD] * len(times)
    readings = [reading_at(t, load) for t, load in zip(times, loads, strict=True)]
    return Scene(GRID, tuple(readings)).graphs()


def by_taxel(graph, field, count=GRID.skin.count):
    """Return a field for every taxel of the skin, zero where it is no node."""
    values = np.zeros(count)
    values[graph.taxels] = getattr(graph, field)
    return values


@pytest.mark.parametrize("name", SCENES)
def test_graph_holds_pressure_now_and_one_reading_ago(name):
    touch = SCENES[name]()
    earlier = np.zeros(touch.mounted.skin.count)
    for graph, reading in zip(
        split_graphs(touch.graphs()), touch.readings, strict=True
    ):
        for field, want in (("before", earlier), ("pressure", reading.pressure)):
            found = by_taxel(graph, field, len(want))
            np.testing.assert_allclose(found, want, rtol=1e-6)
        earlier = reading.pressure


def test_nodes_are_the_touch_now_and_before_and_their_neighbours():
    before = bump(GRID.skin, (-0.02, 0, 0))
    now = bump(GRID.skin, (0.01, 0, 0))
    pressed = np.flatnonzero((before > 0) | (now > 0))
    around = GraphBuilder(GRID).geometry.fixed_neighbours[pressed]
    want = np.unique(np.concatenate([pressed, around[around >= 0]]))
    graph = split_graphs(build_at((0, 0.1), before, now))[1]
    assert np.array_equal(graph.taxels, want)


def test_graph_holds_only_the_loads_of_its_own_active_taxels():
    mounted = flat(columns=20)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.011) for x in (-0.015, 0.015))
    builder = GraphBuilder(mounted)
    for step in range(2):
        reading = reading_at(0.1 * step, left + right + 1)
        builder.advance(reading, np.flatnonzero(left + right))
    graph = builder.build(np.flatnonzero(left), np.flatnonzero(left))
    for field in ("pressure", "before", "age"):
        values = by_taxel(graph, field, mounted.skin.count)
        assert np.array_equal(np.flatnonzero(values), np.flatnonzero(left))


def test_areas_are_in_cm2_and_centred_positions_in_cm():
    touch = press_on_grid()
    graph = split_graphs(touch.graphs())[0]
    np.testing.assert_allclose(graph.areas, 1.0, rtol=1e-6)
    np.testing.assert_allclose(graph.positions.mean(axis=0), 0.0, atol=1e-5)
    p = touch.mounted.skin.positions[graph.taxels]
    steps = graph.positions - graph.positions[0]
    np.testing.assert_allclose(steps, 100 * (p - p[0]), atol=1e-5)


def test_age_counts_from_when_a_taxel_became_active():
    wide, narrow = (bump(GRID.skin, (0, 0, 0), radius=r) for r in (0.025, 0.005))
    graphs = build_at(0.1 * np.arange(5), narrow, wide, wide, narrow, wide)
    ages = np.array([by_taxel(graph, "age") for graph in split_graphs(graphs)])
    middle = int(narrow.argmax())
    edge = int(np.flatnonzero(wide)[0])
    np.testing.assert_allclose(ages[:, middle], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    np.testing.assert_allclose(ages[:, edge], [0.0, 0.0, 0.1, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(("start", "gap"), [(0.0, 0.6), (0.0, 30.0), (-1.7e9, 0.6)])
def test_first_reading_and_long_gap_have_no_load_before(start, gap):
    """Rates count from zero over half a second then."""
    graphs = build_at(start + np.cumsum([0, 0.1, gap]))
    before = [graph.before.any() for graph in split_graphs(graphs)]
    assert before == [False, True, False]
    np.testing.assert_allclose(graphs.seconds, [0.5, 0.1, 0.5], rtol=1e-6)


def test_rate_does_not_depend_on_the_rate_of_readings():
    """A load that grows by 100 kPa/s, at 20 and at 200 Hz."""
    rates = []
    for step in (0.05, 0.005):
        loads = [n * 100 * step * LOAD / LOAD.max() for n in (1, 2, 3)]
        last = split_graphs(build_at(step * np.arange(3), *loads))[2]
        rate = compute_node_scalars(last)[:, NODE_SCALARS.index("rate")]
        rates.append(rate[last.taxels == LOAD.argmax()])
    np.testing.assert_allclose(rates[0], np.arcsinh(100 / 50) / 2, rtol=1e-5)
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-3)


def test_shear_is_rotated_into_the_world():
    touch = touch_on_arm(shear=True)
    earlier = np.zeros((touch.mounted.skin.count, 2), np.float32)
    for graph, reading in zip(
        split_graphs(touch.graphs()), touch.readings, strict=True
    ):
        axes = touch.mounted.compute_frames(reading.q, graph.taxels)[:, :, :2]
        for field, shear in (("shear", reading.shear), ("shear_before", earlier)):
            want = (axes @ shear[graph.taxels][:, :, None])[:, :, 0]
            np.testing.assert_allclose(getattr(graph, field), want, atol=1e-4)
        assert np.abs((graph.shear * graph.normals).sum(axis=1)).max() < 1e-4
        earlier = reading.shear


def test_reading_without_shear_has_only_shear_before():
    drag = np.ones((GRID.skin.count, 2), np.float32)
    readings = reading_at(0.0, LOAD, shear=drag), reading_at(0.1, LOAD)
    one, two = split_graphs(Scene(GRID, readings).graphs())
    assert one.shear.any() and two.shear_before.any()
    assert not one.shear_before.any() and not two.shear.any()


def test_patches_are_joined_while_they_face_each_other():
    mounted = book()
    load = bump(mounted.skin, (-0.05, 0, 0)) + bump(mounted.skin, (0.05, 0, -0.01))
    batch = make_scene(mounted, [load] * 3, [[0.0], [np.pi], [0.0]]).graphs()
    patch = mounted.skin.patch_index[batch.taxels]
    across = (patch[batch.targets, None] != patch[batch.sources]) & (batch.sources >= 0)
    graph = batch.graph_index[batch.targets]
    edges = [int(across[graph == n].sum()) for n in range(3)]
    assert edges == [0, 4 * int((graph == 1).sum()), 0]


def test_reach_and_number_of_live_neighbours_add_edges():
    touch = touch_on_arm()
    configs = ((0, 0.03), (4, 0.01), (4, 0.03), (8, 0.03))
    graphs = [touch.graphs(GraphConfig(live=k, live_reach=r)) for k, r in configs]
    edges = [int((batch.neighbours >= 0).sum()) for batch in graphs]
    assert edges == sorted(set(edges))


def test_graph_has_every_fixed_edge_between_its_nodes():
    touch = touch_on_arm()
    table = GraphBuilder(touch.mounted).geometry.fixed_neighbours
    graph = split_graphs(touch.graphs())[1]
    for node, taxel in enumerate(graph.taxels):
        want = [t for t in table[taxel].tolist() if t in graph.taxels]
        fixed = graph.neighbours[node, :8]
        assert graph.taxels[fixed[fixed >= 0]].tolist() == want


def test_positions_far_from_the_origin_keep_their_precision():
    skin = ur5().skin
    touch = make_scene(ur5(), [bump(skin, skin.positions[0])], [FOLDED])
    far = np.eye(4)
    far[:3, 3] = 1000.0, -2000.0, 500.0
    here, there = (scene.graphs() for scene in (touch, move_scene(touch, far)))
    np.testing.assert_allclose(there.positions, here.positions, atol=1e-5)


def test_graph_does_not_depend_on_graphs_built_before():
    """A builder reuses its memory, which grows with the largest graph."""
    every = np.arange(ur5().skin.count)
    few = every[:3]
    load = np.linspace(1, 9, len(every))
    drag = np.ones((len(every), 2), np.float32)
    used = GraphBuilder(ur5())
    fresh = GraphBuilder(ur5())
    for builder in (used, fresh):
        for step in range(2):
            builder.advance(reading_at(0.1 * step, load, FOLDED, drag), every)
    assert len(used.build(every, every).taxels) == len(every)
    assert_same(used.build(few, few), fresh.build(few, few))


def test_active_taxels_may_come_twice_and_in_any_order():
    touch = touch_on_arm(shear=True)
    one = GraphBuilder(touch.mounted)
    other = GraphBuilder(touch.mounted)
    rng = np.random.default_rng(0)
    earlier = NONE
    for reading in touch.readings:
        taxels = np.flatnonzero(reading.pressure)
        one.advance(reading, taxels)
        other.advance(reading, rng.permutation(np.concatenate([taxels, taxels])))
        found = other.build(rng.permutation(taxels), rng.permutation(earlier))
        assert_same(found, one.build(taxels, earlier))
        earlier = taxels


def test_loads_of_two_readings_ago_are_forgotten():
    builder = GraphBuilder(GRID)
    for n, active in enumerate((PRESSED, NONE, PRESSED)):
        builder.advance(reading_at(0.1 * n, LOAD), active)
    graph = builder.build(PRESSED, PRESSED)
    assert graph.pressure.any()
    assert not graph.before.any() and not graph.age.any()
