"""Motions, mirror images and numbering of a whole scene change no logit."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from helpers.graphs import (
    SCENES,
    double,
    logits,
    mirrored,
    motion,
    moved,
    on_flat_skins,
    orthogonal,
    press_on_grid,
    random_graph,
    renumbered,
    shuffled,
    turned,
    window_of,
    with_bystanders,
)
from helpers.live import network

everywhere = pytest.mark.parametrize("name", SCENES)
with_and_without = pytest.mark.parametrize("shear", [False, True])
PRECISION = {torch.float32: 2e-5, torch.float64: 1e-10}
in_both_precisions = pytest.mark.parametrize("dtype", PRECISION)


def net_for(shear):
    """Random weights; features that hardly ever change are magnified most."""
    net = network("shear" if shear else "pressure")
    net.fit_summary(on_flat_skins(shear))
    return net


def assert_logits_equal(net, one, other, dtype=torch.float32):
    want = logits(net, one, dtype)
    assert np.ptp(want) > 0.3
    scale = np.abs(want).max()
    np.testing.assert_allclose(
        logits(net, other, dtype), want, rtol=0, atol=scale * PRECISION[dtype]
    )


@everywhere
@with_and_without
def test_moving_the_whole_robot_changes_no_logit(name, shear):
    scene, net = SCENES[name](shear), net_for(shear)
    for seed in range(3):
        other = moved(scene, motion(seed))
        assert_logits_equal(net, scene.graphs(), other.graphs())


@everywhere
@with_and_without
def test_a_mirror_image_of_the_whole_robot_changes_no_logit(name, shear):
    scene, net = SCENES[name](shear), net_for(shear)
    assert_logits_equal(net, scene.graphs(), mirrored(scene).graphs())
    other = moved(mirrored(scene), motion(7))
    assert_logits_equal(net, scene.graphs(), other.graphs())


@everywhere
@with_and_without
def test_numbering_taxels_and_patches_otherwise_changes_no_logit(name, shear):
    scene, net = SCENES[name](shear), net_for(shear)
    for seed in range(3):
        other = renumbered(scene, seed)
        assert_logits_equal(net, scene.graphs(), other.graphs())


@everywhere
@with_and_without
@in_both_precisions
def test_a_node_that_nobody_active_hears_changes_no_logit(name, shear, dtype):
    net, batch = net_for(shear), SCENES[name](shear).graphs()
    batch = double(batch) if dtype == torch.float64 else batch
    other = with_bystanders(batch, np.random.default_rng(6))
    assert len(other.taxels) > len(batch.taxels)
    assert_logits_equal(net, batch, other, dtype)


def test_a_node_at_rest_that_an_active_one_hears_does_matter():
    net, batch = net_for(False), press_on_grid().graphs()
    heard = np.unique(batch.sources[batch.sources >= 0])
    [rest, *_] = heard[(batch.pressure[heard] == 0) & (batch.before[heard] == 0)]
    areas = batch.areas.copy()
    areas[rest] *= 3
    assert_another_touch(net, batch, areas=areas.astype(np.float64))


@everywhere
@pytest.mark.parametrize("change", [renumbered, mirrored, lambda s: moved(s, motion())])
def test_the_neighbours_are_the_same_taxels_whatever_the_scene_looks_like(name, change):
    """Also where several are equally far: ties go by patch, row and column."""
    scene = SCENES[name]()
    other = change(scene)
    edges, changed = (
        edges_by_place(s.mounted.skin, s.graphs()) for s in (scene, other)
    )
    assert edges == changed


def edges_by_place(skin, batch):
    """Every edge of each graph, by patch, row and column of its ends."""
    ids = [skin.patches[n].id for n in skin.patch_index]
    places = list(zip(ids, skin.rows.tolist(), skin.columns.tolist(), strict=True))
    taxels, graphs = batch.taxels.tolist(), batch.graph_index.tolist()
    return {
        (graphs[target], places[taxels[target]], places[taxels[source]])
        for target, sources in zip(batch.targets.tolist(), batch.sources, strict=True)
        for source in sources[sources >= 0].tolist()
    }


@everywhere
@with_and_without
@in_both_precisions
@pytest.mark.parametrize("sign", [1, -1])
def test_turned_and_mirrored_graphs_have_the_same_logits(name, shear, dtype, sign):
    net, batch = net_for(shear), SCENES[name](shear).graphs()
    batch = double(batch) if dtype == torch.float64 else batch
    other = turned(batch, orthogonal(np.random.default_rng(1), sign), (3.0, -5.0, 2.0))
    assert_logits_equal(net, batch, other, dtype)


@everywhere
@with_and_without
@in_both_precisions
def test_the_order_of_nodes_and_of_their_sources_changes_no_logit(name, shear, dtype):
    net, batch = net_for(shear), SCENES[name](shear).graphs()
    batch = double(batch) if dtype == torch.float64 else batch
    other = shuffled(batch, np.random.default_rng(2))
    assert_logits_equal(net, batch, other, dtype)


@in_both_precisions
@pytest.mark.parametrize("sign", [1, -1])
def test_graphs_that_no_skin_ever_gave_are_no_exception(dtype, sign):
    rng, net = np.random.default_rng(3), net_for(True)
    batch = random_graph(rng, 40)
    batch = double(batch) if dtype == torch.float64 else batch
    other = turned(shuffled(batch, rng), orthogonal(rng, sign), (1.0, 2.0, 3.0))
    assert_logits_equal(net, batch, other, dtype)


def assert_another_touch(net, batch, **changes):
    """Far beyond rounding."""
    one, other = double(batch), replace(double(batch), **changes)
    gap = logits(net, other, torch.float64) - logits(net, one, torch.float64)
    assert np.abs(gap).max() > 1e-5


def test_shear_turned_without_its_skin_is_another_touch():
    """The network hears the direction of shear against the normals and the places."""
    net, batch = net_for(True), SCENES["a press on the seam of two patches"](True)
    batch = batch.graphs()
    other = turned(double(batch), orthogonal(np.random.default_rng(4), 1))
    assert_another_touch(net, batch, shear=other.shear, shear_before=other.shear_before)


def test_normals_turned_without_their_places_are_another_touch():
    """The summary takes no notice, but the network does."""
    net, batch = net_for(False), SCENES["a hand between patches on two links"]()
    batch = batch.graphs()
    other = turned(double(batch), orthogonal(np.random.default_rng(4), 1))
    assert_another_touch(net, batch, normals=other.normals)


@pytest.mark.parametrize("share", [1.3, 0.7])
def test_the_same_load_on_places_farther_apart_is_another_touch(share):
    """Also to the encoder, whose edges know their length."""
    net, batch = net_for(False), double(random_graph(np.random.default_rng(5), 40))
    other = replace(batch, positions=share * batch.positions)
    with torch.no_grad():
        one, far = (
            net.double().encoder(window_of(net, b, torch.float64).graphs)
            for b in (batch, other)
        )
    assert (one - far).abs().max() > 1e-3
