"""Tests of batches of contact graphs and of their features."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.live import (
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    compress_shear,
    compute_node_scalars,
    create_empty_batch,
    join_graphs,
)
from eskin.live.summary_kernels import AREA, FORCE, RATE, SPEED
from helpers.graphs import (
    assert_same,
    book,
    bump,
    flat,
    make_scene,
    orthogonal,
    pressure_summary,
    random_graph,
    random_graphs,
    rolled,
    shear_summary,
    split_graphs,
    to_float64,
)

SUMMARIES = (pressure_summary, shear_summary)
FEATURES = (*SUMMARIES, compute_node_scalars)


@pytest.fixture(params=[(4, 1, 7), (0, 5, 0, 0, 3, 0), (0, 0), (5, 0)], ids=str)
def graphs(request):
    rng = np.random.default_rng(0)
    return [random_graph(rng, nodes) for nodes in request.param]


def test_select_inverts_join(graphs):
    batch = join_graphs(graphs)
    for found, graph in zip(split_graphs(batch), graphs, strict=True):
        assert_same(found, graph)
    chosen = np.random.default_rng(0).integers(0, len(graphs), 9)
    assert_same(batch.select(chosen), join_graphs([graphs[n] for n in chosen]))


def test_join_is_associative(graphs):
    parts = [join_graphs(graphs[:1]), join_graphs(graphs[1:])]
    assert_same(join_graphs(parts), join_graphs(graphs))


def test_empty_selection_has_no_graphs():
    batch = random_graphs(np.random.default_rng(0), (3, 0, 2))
    empty = batch.select(np.array([], np.int64))
    assert_same(empty, create_empty_batch(batch.neighbours.shape[1]))
    assert (empty.size, len(empty.taxels), empty.offsets.tolist()) == (0, 0, [0])
    assert_same(join_graphs([empty, batch, empty]), batch)
    assert not any(len(features(empty)) for features in FEATURES)


def test_join_needs_a_batch():
    with pytest.raises(ValueError, match="at least one"):
        join_graphs([])


def test_sources_are_the_neighbours_of_active_nodes(graphs):
    batch = join_graphs(graphs)
    assert batch.sizes.tolist() == [len(graph.taxels) for graph in graphs]
    assert np.array_equal(batch.targets, np.flatnonzero(batch.pressure > 0))
    assert (batch.sources >= 0).any(axis=0).all()
    for node, sources in zip(batch.targets, batch.sources, strict=True):
        first = batch.offsets[batch.graph_index[node]]
        neighbours = batch.neighbours[node]
        sources = sources[sources >= 0] - first
        assert sorted(sources) == sorted(neighbours[neighbours >= 0])
    isolated = batch._replace(neighbours=np.full_like(batch.neighbours, -1))
    assert isolated.sources.shape == (len(batch.targets), 0)


@pytest.mark.parametrize("features", FEATURES)
def test_features_of_a_batch_are_those_of_each_graph(graphs, features):
    alone = np.concatenate([features(graph) for graph in graphs])
    together = features(join_graphs(graphs))
    np.testing.assert_allclose(together, alone, rtol=1e-5, atol=1e-5)
    assert together.dtype == np.float32
    assert np.isfinite(together).all()


def feature(batch, name, floor=None):
    """Return a column of the summary; with a floor, without its logarithm."""
    names = PRESSURE_SUMMARY
    values = pressure_summary(batch)
    if name in SHEAR_SUMMARY:
        names = SHEAR_SUMMARY
        values = shear_summary(batch)
    assert values.shape == (batch.size, len(names))
    column = values[:, names.index(name)]
    return column if floor is None else np.expm1(column) * floor


def test_force_area_and_rates_are_in_newton_and_cm2():
    mounted = flat(pitch=0.02)
    load = np.where(bump(mounted.skin, (0, 0, 0), radius=0.021) > 0, 50.0, 0.0)
    batch = make_scene(mounted, [load, 2 * load, load], step=0.1).graphs()
    force = 5 * 50e3 * 4e-4
    for name, floor, want in (
        ("force", FORCE, [force, 2 * force, force]),
        ("loading rate", RATE, [force / 0.5, force / 0.1, 0]),
        ("unloading rate", RATE, [0, 0, force / 0.1]),
        ("area", AREA, [20, 20, 20]),
        ("area above 20 kPa", AREA, [20, 20, 20]),
        ("area above 50 kPa", AREA, [0, 20, 0]),
        ("area above 90 kPa", AREA, [0, 20, 0]),
    ):
        np.testing.assert_allclose(feature(batch, name, floor), want, rtol=1e-3)


@pytest.mark.parametrize("third", [0.0, 1e-9, 1.0])
def test_length_breadth_and_depth_are_exact_where_two_are_equal(third):
    """Six nodes on the principal axes, turned in any way."""
    rng = np.random.default_rng(0)
    variances = np.array([4.0, third, third])
    batch = to_float64(random_graph(rng, 6))
    batch = batch._replace(pressure=1 / batch.areas)
    axes = np.diag(np.sqrt(3 * variances))
    want = np.sqrt(variances + 0.01**2) - 0.01
    for Q in (np.eye(3), *(orthogonal(rng, 1) for _ in range(20))):
        turned_axes = batch._replace(positions=np.concatenate([axes, -axes]) @ Q.T)
        names = "length", "breadth", "depth"
        found = [feature(turned_axes, name)[0] for name in names]
        np.testing.assert_allclose(found, want, atol=1e-10)


@pytest.mark.parametrize("speed", [0.05, 0.5])
@pytest.mark.parametrize(("surface", "axis", "x"), [(flat, 1, 0.0), (rolled, 2, 0.03)])
def test_stroke_has_the_speed_of_the_hand(speed, surface, axis, x):
    mounted = surface(rows=21, columns=9)
    places = (
        np.array([x, 0, 0]) + np.linspace(-0.06, 0.06, 13)[:, None] * np.eye(3)[axis]
    )
    loads = [bump(mounted.skin, place) for place in places]
    batch = make_scene(mounted, loads, step=0.01 / speed).graphs()
    found = feature(batch, "speed", SPEED)
    assert found[0] == 0.0
    np.testing.assert_allclose(found[2:-2], 100 * speed, rtol=0.1)


def test_load_on_a_moving_link_has_no_speed():
    mounted = book()
    load = bump(mounted.skin, (0.05, 0, -0.01))
    qs = np.linspace(0.0, 1.0, 6)[:, None]
    batch = make_scene(mounted, [load] * 6, qs, shear=True).graphs()
    np.testing.assert_allclose(feature(batch, "speed"), 0.0, atol=1e-5)
    along = feature(batch, "shear along the motion")
    np.testing.assert_allclose(along, 0.0, atol=1e-12)


def test_load_that_appears_or_ends_has_no_speed():
    mounted = flat()
    load = bump(mounted.skin, (0.02, 0.01, 0))
    batch = make_scene(mounted, [load, 0 * load, load]).graphs()
    assert feature(batch, "speed").tolist() == [0.0, 0.0, 0.0]


def test_normals_agree_on_a_flat_patch_and_not_around_a_tube():
    """An image of the same pressures does not show the shape (the paper, Fig. 3)."""
    sheet = flat(rows=9, columns=15)
    tube = rolled()
    image = np.where(abs(sheet.skin.positions[:, 1]) < 0.025, 20.0, 0.0)
    laid, wrapped = (make_scene(m, [image]).graphs() for m in (sheet, tube))
    assert np.array_equal(np.sort(laid.pressure), np.sort(wrapped.pressure))
    assert feature(laid, "agreement of normals")[0] == pytest.approx(1.0)
    assert feature(wrapped, "agreement of normals")[0] < 0.5
    assert feature(wrapped, "depth")[0] > 1.0 > feature(laid, "depth")[0] + 0.99


@pytest.mark.parametrize(
    ("name", "matrix", "least"),
    [
        ("agreement of shear", None, 0.9),
        ("divergence", [[1.0, 0.0], [0.0, 1.0]], 0.6),
        ("curl", [[0.0, 1.0], [-1.0, 0.0]], 0.6),
    ],
)
def test_drag_pinch_and_twist_differ_in_shear(name, matrix, least):
    mounted = flat()
    p = mounted.skin.positions[:, :2]
    load = bump(mounted.skin, (0, 0, 0), radius=0.035)
    outward = p / (np.linalg.norm(p, axis=1, keepdims=True) + 1e-9)
    field = np.tile([1.0, 0.0], (len(p), 1)) if matrix is None else outward @ matrix
    touch = make_scene(mounted, [load])
    drag = (0.5 * load[:, None] * field).astype(np.float32)
    reading = replace(touch.readings[0], shear=drag)
    batch = replace(touch, readings=(reading,)).graphs()
    for other in ("agreement of shear", "divergence", "curl"):
        [value] = feature(batch, other)
        assert value > least if other == name else abs(value) < 0.1


def test_compressed_shear_keeps_direction_and_order():
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = compress_shear(directions * np.geomspace(1e-6, 1e4, 50)[:, None])
    lengths = np.linalg.norm(found, axis=1)
    np.testing.assert_allclose(found, lengths[:, None] * directions, atol=1e-12)
    assert (np.diff(lengths) > 0).all()
    assert lengths[-1] < 5.0
    assert not compress_shear(np.zeros((2, 3))).any()


@pytest.mark.parametrize("kpa", [1e-3, 1.0, 500.0])
def test_node_scalars_are_of_order_one(kpa):
    mounted = flat()
    loads = [k * bump(mounted.skin, (0, 0, 0), kpa=kpa) for k in (0.1, 1.0, 0.0)]
    scalars = compute_node_scalars(make_scene(mounted, loads, shear=True).graphs())
    assert np.abs(scalars).max() < 4.0
