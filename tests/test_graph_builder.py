"""What a graph says of a touch at one reading, and of the reading before."""

import numpy as np
import pytest

from eskin.graph import (
    NODE_FIELDS,
    NODE_SCALARS,
    GraphBuilder,
    GraphConfig,
    compute_node_scalars,
    join_graphs,
)
from helpers.graphs import (
    FOLDED,
    SCENES,
    Scene,
    book,
    bump,
    flat,
    moved,
    press_on_grid,
    pressure_summary,
    reading_at,
    scene,
    touch_on_arm,
    ur5,
)

NO_HISTORY = np.empty(0, np.int64)


def at(batch, name, taxels):
    """The values of some taxels of a single graph; zero where they are no nodes."""
    values = np.zeros(batch.taxels.max() + 1)
    values[batch.taxels] = getattr(batch, name)
    return values[taxels]


def test_before_is_what_was_pressed_one_reading_ago():
    for name in SCENES:
        touch = SCENES[name]()
        graphs = touch.graphs()
        count = touch.mounted.skin.count
        earlier = np.zeros(count)
        for index, reading in enumerate(touch.readings):
            graph = graphs.select(np.array([index]))
            before, now = np.zeros(count), np.zeros(count)
            before[graph.taxels], now[graph.taxels] = graph.before, graph.pressure
            np.testing.assert_allclose(before, earlier, rtol=1e-6)
            np.testing.assert_allclose(now, reading.pressure, rtol=1e-6)
            earlier = reading.pressure


def test_a_graph_holds_the_touch_now_and_before_and_their_fixed_neighbours():
    mounted = flat()
    here, there = bump(mounted.skin, (-0.02, 0, 0)), bump(mounted.skin, (0.01, 0, 0))
    touch = scene(mounted, [here, there])
    builder = GraphBuilder(mounted)
    pressed = np.flatnonzero((here > 0) | (there > 0))
    around = builder.geometry.fixed_neighbours[pressed]
    want = np.unique(np.concatenate([pressed, around[around >= 0]]))
    assert np.array_equal(touch.graphs().select(np.array([1])).taxels, want)


def test_a_touch_knows_nothing_of_the_pressure_of_another():
    mounted = flat(columns=20)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.011) for x in (-0.015, 0.015))
    builder = GraphBuilder(mounted)
    for step in range(2):
        builder.advance(
            reading_at(0.1 * step, left + right), np.flatnonzero(left + right)
        )
    mine, other = np.flatnonzero(left), np.flatnonzero(right)
    graph = builder.build(mine, mine)
    assert (at(graph, "pressure", mine) > 0).all()
    for name in ("pressure", "before", "age"):
        assert not at(graph, name, other).any()


def test_pressure_of_taxels_that_are_not_active_is_no_pressure():
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    active = load > 15
    builder = GraphBuilder(mounted)
    builder.advance(reading_at(0.0, load + 1.0), np.flatnonzero(active))
    graph = builder.build(np.flatnonzero(active), NO_HISTORY)
    assert np.array_equal(
        np.sort(graph.taxels[graph.pressure > 0]), np.where(active)[0]
    )


def test_areas_are_in_cm2_and_positions_in_cm_about_the_middle():
    touch = press_on_grid()
    graph = touch.graphs().select(np.array([0]))
    skin = touch.mounted.skin
    np.testing.assert_allclose(graph.areas, 1.0, rtol=1e-6)
    np.testing.assert_allclose(graph.positions.mean(axis=0), 0.0, atol=1e-5)
    gaps = skin.positions[graph.taxels] - skin.positions[graph.taxels[0]]
    steps = graph.positions - graph.positions[0]
    np.testing.assert_allclose(steps, 100 * gaps, atol=1e-5)


def test_age_counts_from_when_the_taxel_became_active():
    mounted = flat()
    wide, narrow = (bump(mounted.skin, (0, 0, 0), radius=r) for r in (0.025, 0.005))
    touch = scene(mounted, [narrow, wide, wide, narrow, wide], step=0.1)
    graphs = touch.graphs()
    middle, edge = int(narrow.argmax()), int(np.flatnonzero(wide)[0])
    singles = [graphs.select(np.array([n])) for n in range(5)]
    ages = [[float(at(g, "age", t)) for g in singles] for t in (middle, edge)]
    np.testing.assert_allclose(ages[0], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    np.testing.assert_allclose(ages[1], [0.0, 0.0, 0.1, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("gap", [0.6, 30.0])
def test_after_a_long_gap_rates_count_from_zero_over_half_a_second(gap):
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    builder = GraphBuilder(mounted)
    taxels = np.flatnonzero(load)
    graphs = []
    for seconds in (0.0, 0.1, 0.1 + gap):
        builder.advance(reading_at(seconds, load), np.flatnonzero(load))
        graphs.append(builder.build(taxels, taxels))
    assert not graphs[0].before.any()
    assert graphs[1].before.any()
    assert not graphs[2].before.any()
    np.testing.assert_allclose(join_graphs(graphs).seconds, [0.5, 0.1, 0.5], rtol=1e-6)


def test_the_first_reading_follows_none_however_its_clock_begins():
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    for seconds in (0.0, -1_700_000_000.0):
        builder = GraphBuilder(mounted)
        builder.advance(reading_at(seconds, load), np.flatnonzero(load))
        graph = builder.build(np.flatnonzero(load), NO_HISTORY)
        assert graph.seconds.tolist() == [0.5]


def test_a_steady_rate_does_not_depend_on_how_often_one_looks():
    """100 kPa/s in the middle of a growing load, at 20 and at 200 Hz."""
    mounted = flat()
    shape = bump(mounted.skin, (0, 0, 0), kpa=1.0)
    rates = []
    for step in (0.05, 0.005):
        touch = scene(mounted, [k * 100 * step * shape for k in (1, 2, 3)], step=step)
        last = touch.graphs().select(np.array([2]))
        rate = compute_node_scalars(last)[:, NODE_SCALARS.index("rate")]
        rates.append(rate[last.taxels == shape.argmax()])
    np.testing.assert_allclose(rates[0], np.arcsinh(100 / 50) / 2, rtol=1e-5)
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-3)


def test_shear_follows_the_taxels_axes_into_the_world():
    touch = touch_on_arm(shear=True)
    graphs, mounted = touch.graphs(), touch.mounted
    for index, reading in enumerate(touch.readings):
        graph = graphs.select(np.array([index]))
        taxels = graph.taxels
        R = mounted.compute_frames(reading.q, taxels)
        x, y = reading.shear[taxels].T
        want = x[:, None] * R[:, :, 0] + y[:, None] * R[:, :, 1]
        np.testing.assert_allclose(graph.shear, want, atol=1e-4)
        assert np.abs((graph.shear * graph.normals).sum(axis=1)).max() < 1e-4
        if index:
            x, y = touch.readings[index - 1].shear[taxels].T
            want = x[:, None] * R[:, :, 0] + y[:, None] * R[:, :, 1]
            np.testing.assert_allclose(graph.shear_before, want, atol=1e-4)


def test_shear_that_is_not_measured_any_more_is_not_remembered():
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    drag = np.ones((mounted.skin.count, 2), np.float32)
    builder, taxels = GraphBuilder(mounted), np.flatnonzero(load)
    builder.advance(reading_at(0.0, load, shear=drag), np.flatnonzero(load))
    assert builder.build(taxels, NO_HISTORY).shear.any()
    builder.advance(reading_at(0.1, load), np.flatnonzero(load))
    graph = builder.build(taxels, taxels)
    assert not graph.shear.any()
    assert graph.shear_before.any()


def test_patches_that_close_on_each_other_are_joined_only_while_they_do():
    mounted = book()
    load = bump(mounted.skin, (-0.05, 0, 0)) + bump(mounted.skin, (0.05, 0, -0.01))
    qs = [[0.0], [np.pi], [0.0]]
    batch = scene(mounted, [load] * 3, qs).graphs()
    patch = mounted.skin.patch_index[batch.taxels]
    hears, heard = patch[batch.targets, None], patch[batch.sources]
    across = (hears != heard) & (batch.sources >= 0)
    graph = batch.graph_index[batch.targets]
    per_graph = [int(across[graph == n].sum()) for n in range(3)]
    active = int((graph == 1).sum())
    assert per_graph == [0, 4 * active, 0]


def test_a_longer_reach_joins_more_and_no_live_neighbours_join_none():
    touch = touch_on_arm()
    edges = [
        int((touch.graphs(GraphConfig(live=k, live_reach=reach)).neighbours >= 0).sum())
        for k, reach in ((0, 0.03), (4, 0.01), (4, 0.03), (8, 0.03))
    ]
    assert edges == sorted(set(edges))


def test_every_fixed_edge_inside_the_touch_is_in_its_graph():
    touch = touch_on_arm()
    table = GraphBuilder(touch.mounted).geometry.fixed_neighbours
    graph = touch.graphs().select(np.array([1]))
    for node, taxel in enumerate(graph.taxels):
        want = [t for t in table[taxel].tolist() if t in graph.taxels]
        fixed = graph.neighbours[node, :8]
        assert graph.taxels[fixed[fixed >= 0]].tolist() == want


def test_a_touch_of_nothing_is_a_graph_without_nodes():
    touch = scene(flat(), np.zeros((2, 81)))
    batch = touch.graphs()
    assert (batch.count, len(batch.taxels)) == (2, 0)
    assert not pressure_summary(batch).any()


def test_positions_far_from_the_origin_keep_their_precision():
    touch = scene(ur5(), [bump(ur5().skin, ur5().skin.positions[0])], [FOLDED])
    far = np.eye(4)
    far[:3, 3] = 1000.0, -2000.0, 500.0
    here, there = (Scene.graphs(s) for s in (touch, moved(touch, far)))
    np.testing.assert_allclose(there.positions, here.positions, atol=1e-5)


def soiled(builder):
    """The builder's memory filled with what no graph holds."""
    workspace = builder.workspace
    for name, values in workspace._asdict().items():
        if name not in ("marks", "search", "graph"):
            values.fill(7)
    for values in (*workspace.search, *workspace.graph):
        values.fill(7)


def same(one, other):
    for name in (*NODE_FIELDS, "offsets", "seconds", "history"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.parametrize("shear", [True, False])
def test_a_graph_does_not_depend_on_what_its_memory_held(shear):
    touch = touch_on_arm(shear=shear)
    clean, used = (GraphBuilder(touch.mounted) for _ in range(2))
    earlier = NO_HISTORY
    for reading in touch.readings:
        taxels = np.flatnonzero(reading.pressure)
        for builder in (clean, used):
            builder.advance(reading, taxels)
        clean.workspace = GraphBuilder(touch.mounted).workspace
        soiled(used)
        same(used.build(taxels, earlier), clean.build(taxels, earlier))
        earlier = taxels


def test_memory_grows_with_a_touch_and_changes_no_graph():
    mounted = ur5()
    every = np.arange(mounted.skin.count)
    few, load = every[:3], np.linspace(1, 9, mounted.skin.count)
    used, fresh = GraphBuilder(mounted), GraphBuilder(mounted)
    for builder in (used, fresh):
        for step in range(2):
            builder.advance(reading_at(0.1 * step, load, FOLDED), every)
    memory = used.workspace
    same(used.build(few, few), fresh.build(few, few))
    assert used.workspace is memory
    assert len(used.build(every, every).taxels) == len(every)
    grown = used.workspace
    assert grown is not memory
    same(used.build(few, few), fresh.build(few, few))
    assert used.workspace is grown


def test_active_taxels_may_be_told_twice_and_in_any_order():
    touch = touch_on_arm(shear=True)
    told, twice = (GraphBuilder(touch.mounted) for _ in range(2))
    rng, earlier = np.random.default_rng(0), NO_HISTORY
    for reading in touch.readings:
        taxels = np.flatnonzero(reading.pressure)
        told.advance(reading, taxels)
        twice.advance(reading, rng.permutation(np.concatenate([taxels, taxels])))
        one = told.build(taxels, earlier)
        same(twice.build(rng.permutation(taxels), rng.permutation(earlier)), one)
        earlier = taxels


def test_what_a_taxel_felt_two_readings_ago_is_forgotten():
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    taxels, builder = np.flatnonzero(load), GraphBuilder(mounted)
    for n, active in enumerate((taxels, NO_HISTORY, taxels)):
        builder.advance(reading_at(0.1 * n, load), active)
    graph = builder.build(taxels, taxels)
    assert graph.pressure.any()
    assert not graph.before.any() and not graph.age.any()
