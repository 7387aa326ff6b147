"""Tests of symmetry: motions, mirror images and numbering change no logit.

They are eq. (1) of Jiang et al. 2025 where S_g changes nothing.
"""

from functools import cache

import numpy as np
import pytest
import torch

from eskin.live import compute_summary, join_graphs
from helpers.graphs import (
    SCENES,
    add_nodes_at_rest,
    embed,
    logits,
    mirror_scene,
    motion,
    move_scene,
    orthogonal,
    press_on_grid,
    press_on_seam,
    random_graph,
    renumber_scene,
    shuffle_nodes,
    stroke_on_grid,
    to_float64,
    turned,
)
from helpers.live import network

PRECISION = {torch.float32: 2e-5, torch.float64: 1e-10}
SCENE_CHANGES = {
    "moved": lambda scene, seed: move_scene(scene, motion(seed)),
    "mirrored": lambda scene, _: mirror_scene(scene),
    "mirrored and moved": lambda scene, n: move_scene(mirror_scene(scene), motion(n)),
    "renumbered": renumber_scene,
}
GRAPH_CHANGES = {
    "rotated": lambda batch, rng: turned(batch, orthogonal(rng, 1), (3.0, -5.0, 2.0)),
    "mirrored": lambda batch, rng: turned(batch, orthogonal(rng, -1), (3.0, -5.0, 2.0)),
    "shuffled": shuffle_nodes,
    "with nodes at rest": add_nodes_at_rest,
}


@cache
def make_network(shear):
    """Build a network that magnifies what hardly changes in touches of flat grids."""
    net = network("shear" if shear else "pressure")
    flat_touches = press_on_grid, press_on_seam, stroke_on_grid
    batch = join_graphs([make(shear).graphs() for make in flat_touches])
    net.fit_summary(torch.as_tensor(compute_summary(batch, shear)))
    return net


@cache
def make_graphs(name, shear=True):
    """Return the graphs of a scene, or one that no skin would give."""
    if name == "random":
        return random_graph(np.random.default_rng(3), 40)
    return SCENES[name](shear).graphs()


def assert_logits_equal(net, one, other, dtype=torch.float32):
    want = logits(net, one, dtype)
    assert np.ptp(want) > 0.3
    atol = np.abs(want).max() * PRECISION[dtype]
    np.testing.assert_allclose(logits(net, other, dtype), want, rtol=0, atol=atol)


def list_edges(skin, batch):
    """Return every edge of each graph, by patch, row and column of its ends."""
    ids = [skin.patches[n].id for n in skin.patch_index]
    places = list(zip(ids, skin.rows.tolist(), skin.columns.tolist(), strict=True))
    taxels = batch.taxels.tolist()
    graphs = batch.graph_index.tolist()
    return {
        (graphs[target], places[taxels[target]], places[taxels[source]])
        for target, sources in zip(batch.targets.tolist(), batch.sources, strict=True)
        for source in sources[sources >= 0].tolist()
    }


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("change", SCENE_CHANGES)
@pytest.mark.parametrize("shear", [False, True])
def test_changed_scene_has_the_same_edges_and_logits(name, change, shear):
    """Also where neighbours are equally far: patch, row and column break ties."""
    net = make_network(shear)
    scene = SCENES[name](shear)
    batch = make_graphs(name, shear)
    edges = list_edges(scene.mounted.skin, batch)
    for seed in range(2):
        other = SCENE_CHANGES[change](scene, seed)
        graphs = other.graphs()
        assert list_edges(other.mounted.skin, graphs) == edges
        assert_logits_equal(net, batch, graphs)


@pytest.mark.parametrize("name", [*SCENES, "random"])
@pytest.mark.parametrize("change", GRAPH_CHANGES)
@pytest.mark.parametrize("shear", [False, True])
@pytest.mark.parametrize("dtype", PRECISION)
def test_changed_graphs_have_the_same_logits(name, change, shear, dtype):
    batch = make_graphs(name)
    batch = to_float64(batch) if dtype == torch.float64 else batch
    other = GRAPH_CHANGES[change](batch, np.random.default_rng(1))
    assert_logits_equal(make_network(shear), batch, other, dtype)


def rotate_alone(batch, *fields):
    """Return the batch with some of its vectors rotated, and the others as they are."""
    other = turned(batch, orthogonal(np.random.default_rng(4), 1))
    return {field: getattr(other, field) for field in fields}


def enlarge_source_at_rest(batch):
    sources = np.unique(batch.sources[batch.sources >= 0])
    [rest, *_] = sources[(batch.pressure[sources] + batch.before[sources]) == 0]
    nodes = np.arange(len(batch.areas))
    return {"areas": np.where(nodes == rest, 3 * batch.areas, batch.areas)}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("seam of two patches", lambda b: rotate_alone(b, "shear", "shear_before")),
        ("patches on two links", lambda b: rotate_alone(b, "normals")),
        ("grid", enlarge_source_at_rest),
        ("random", lambda b: {"positions": 1.3 * b.positions}),
    ],
)
def test_other_changes_change_the_embedding(name, change):
    net = make_network(True)
    batch = to_float64(make_graphs(name))
    other = batch._replace(**change(batch))
    gap = embed(net, other, torch.float64) - embed(net, batch, torch.float64)
    assert np.abs(gap).max() > 1e-5
