"""The network as a whole: skins of any density, windows of any kind, learning."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import cross_entropy

from eskin.graph import join_graphs
from eskin.model import NetworkConfig
from eskin.nn import RecogniserNetwork, build_graph_tensors
from helpers.graphs import (
    double,
    flat,
    logits,
    network_input,
    press_on_grid,
    press_on_seam,
    pressure_summary,
    random_graph,
    rolled,
    scene,
    stroke_on_grid,
    window_of,
)
from helpers.live import network


def embedding(net, batch) -> np.ndarray:
    """What the encoder makes of each graph."""
    with torch.no_grad():
        return net.encoder(window_of(net, batch).graphs).numpy()


# Half axes [m] of a finger's tip, its side and a palm.
SHAPES = {"tip": (0.022, 0.022), "side": (0.018, 0.05), "palm": (0.05, 0.04)}

# Pressure [kPa] and place [m] at each reading.
COURSES = {
    "tap": ((20, 60, 80), (0.0,) * 3),
    "release": ((80, 60, 25), (0.0,) * 3),
    "hold": ((40,) * 20, (0.0,) * 20),
    "stroke": ((15,) * 8, tuple(0.01 * n - 0.04 for n in range(8))),
    "whisper": ((2, 4, 6), (0.0,) * 3),
}


def unrolled(skin):
    """Where each taxel lies on the sheet that the skin was [m]."""
    x, y, z = skin.positions.T
    return (0.03 * np.arctan2(y, x), z) if skin.name == "rolled" else (x, y)


def touches(mounted):
    """The last graph of every course of every shape: one field on any skin."""
    across, along = unrolled(mounted.skin)
    last = []
    for width, height in SHAPES.values():
        for kpa, places in COURSES.values():
            squared = [
                ((across - x) / width) ** 2 + (along / height) ** 2 for x in places
            ]
            field = [
                k * np.maximum(1 - r, 0) for k, r in zip(kpa, squared, strict=True)
            ]
            graphs = scene(mounted, field, step=0.04).graphs()
            last.append(graphs.select(np.array([graphs.count - 1])))
    return join_graphs(last)


def against_other_touches(coarse, dense):
    """Mean distance of each touch to itself over that to others."""
    gap = np.linalg.norm(dense[:, None] - coarse[None], axis=2)
    itself = np.eye(len(gap), dtype=bool)
    return gap[itself].mean() / gap[~itself].mean()


@pytest.mark.parametrize("make", [flat, rolled])
def test_the_same_touch_on_twice_the_density_is_nearly_the_same(make):
    coarse = touches(make(rows=16, columns=18, pitch=0.01))
    dense = touches(make(rows=32, columns=36, pitch=0.005))
    assert dense.sizes.sum() > 2.5 * coarse.sizes.sum()
    spread = pressure_summary(coarse).std(axis=0) + 0.05
    summaries = [pressure_summary(batch) / spread for batch in (coarse, dense)]
    assert against_other_touches(*summaries) < 0.1
    for seed in range(3):
        net = network(seed=seed)
        embeddings = [embedding(net, batch) for batch in (coarse, dense)]
        assert against_other_touches(*embeddings) < 0.1


def test_the_same_image_of_pressure_on_another_shape_is_another_embedding():
    """The deformation that an image of pressures cannot tell (the paper)."""
    sheet, tube = flat(rows=9, columns=15), rolled()
    image = np.where(abs(sheet.skin.positions[:, 1]) < 0.025, 20.0, 0.0)
    laid, wrapped = (scene(m, [image]).graphs() for m in (sheet, tube))
    net = network()
    gap = np.abs(embedding(net, laid) - embedding(net, wrapped)).max()
    again = np.abs(embedding(net, laid) - embedding(net, double(laid))).max()
    assert gap > 1e-3 > 1e-5 > again


def test_a_reading_without_contact_is_embedded_as_zeros():
    rng, net = np.random.default_rng(0), network("shear")
    released = replace(random_graph(rng, 9), pressure=np.zeros(9, np.float32))
    batch = join_graphs([random_graph(rng, 0), random_graph(rng, 9), released])
    assert embedding(net, batch).any(axis=1).tolist() == [False, True, False]


def test_the_embedding_of_a_graph_does_not_depend_on_what_else_is_in_the_batch():
    rng, net = np.random.default_rng(1), network("shear")
    graphs = [random_graph(rng, n) for n in (5, 0, 30, 1, 0)]
    alone = np.concatenate([embedding(net, graph) for graph in graphs])
    np.testing.assert_allclose(embedding(net, join_graphs(graphs)), alone, atol=1e-5)


def test_windows_without_contact_nodes_or_readings_have_finite_logits_and_gradients():
    rng, net = np.random.default_rng(2), network("shear").train()
    empty = [random_graph(rng, 0)] * 3
    full = [random_graph(rng, 8) for _ in range(3)]
    released = replace(full[0], pressure=np.zeros(8, np.float32))
    batch = join_graphs([*empty, *full, released])
    window = np.array([0, 0, 0, 1, 1, 1, 2])
    slot = np.array([0, 5, 99, 0, 5, 99, 99])
    found = net(network_input(batch, window, slot, 4, True))
    assert found.shape == (4, 4)
    assert torch.isfinite(found).all()
    found.square().sum().backward()
    gradients = [p.grad for p in net.parameters() if p.grad is not None]
    assert len(gradients) == len(list(net.parameters()))
    assert all(torch.isfinite(g).all() for g in gradients)
    nothing = network_input(
        batch.select(np.array([], np.int64)), window[:0], slot[:0], 2, True
    )
    assert torch.isfinite(net(nothing)).all()


def test_the_order_of_readings_in_the_batch_does_not_matter():
    rng, net = np.random.default_rng(3), network("shear")
    batch = join_graphs([random_graph(rng, n) for n in (5, 0, 12, 7, 3, 20)])
    window, slot = np.array([0, 0, 0, 1, 1, 1]), np.array([3, 50, 50, 98, 99, 99])
    with torch.no_grad():
        want = net(network_input(batch, window, slot, 2, True))
        order = rng.permutation(6)
        inputs = batch.select(order), window[order], slot[order]
        found = net(network_input(*inputs, 2, True))
    torch.testing.assert_close(found, want, rtol=1e-4, atol=1e-5)


def test_a_network_for_pressure_takes_no_notice_of_shear():
    net = network("pressure")
    with_shear, without = (press_on_seam(shear).graphs() for shear in (True, False))
    assert np.array_equal(logits(net, with_shear), logits(net, without))
    net = network("shear")
    assert np.abs(logits(net, with_shear) - logits(net, without)).max() > 1e-2


def test_embedding_readings_once_and_placing_them_later_gives_the_same_logits():
    net, batch = network(), press_on_grid().graphs()
    inputs = window_of(net, batch)
    with torch.no_grad():
        e = torch.cat(
            [
                net.embed(build_graph_tensors(batch.select(np.array([n])), net.shear))
                for n in range(batch.count)
            ]
        )
        found = net.classify(e, inputs.slot_index).mean(dim=0)
        torch.testing.assert_close(found, net(inputs), rtol=1e-5, atol=1e-5)


def test_logits_are_the_mean_of_both_views():
    net, batch = network(), press_on_grid().graphs()
    with torch.no_grad():
        views = net.views(window_of(net, batch))
    assert views.shape == (2, 1, 4)
    np.testing.assert_allclose(logits(net, batch), views.mean(dim=0)[0], atol=1e-6)
    assert (views[0] - views[1]).abs().max() > 0.1


def test_standardised_features_have_mean_zero_and_spread_one():
    net = RecogniserNetwork(NetworkConfig(), 3, shear=True)
    summary = torch.randn(500, len(net.summary_mean)) * 7 + 30
    net.fit_summary(summary)
    centred = (summary - net.summary_mean) * net.summary_scale
    np.testing.assert_allclose(centred.mean(dim=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(centred.std(dim=0), 1.0, atol=1e-2)


def test_one_absurd_reading_moves_no_feature_without_bound():
    net, batch = network(), stroke_on_grid().graphs()
    loud = replace(batch, pressure=1e6 * batch.pressure)
    assert np.isfinite(logits(net, loud)).all()
    assert np.abs(logits(net, loud)).max() < 100


@pytest.mark.parametrize("shear", [False, True])
def test_the_network_overfits_eight_windows(shear):
    """By the contact graphs alone: the summary is taken away."""
    rng = np.random.default_rng(4)
    graphs = join_graphs(
        [random_graph(rng, int(rng.integers(4, 12))) for _ in range(24)]
    )
    window, slot = np.repeat(np.arange(8), 3), np.tile([97, 98, 99], 8)
    inputs = network_input(graphs, window, slot, 8, shear)
    blind = torch.zeros_like(inputs.graphs.summary)
    inputs = replace(inputs, graphs=replace(inputs.graphs, summary=blind))
    labels = torch.tensor([0, 1, 2, 3, 3, 2, 1, 0])
    torch.manual_seed(0)
    net = RecogniserNetwork(NetworkConfig(dropout=0.0), 4, shear)
    optimiser = torch.optim.Adam(net.parameters(), lr=5e-3)
    losses = []
    for _ in range(60):
        optimiser.zero_grad()
        loss = cross_entropy(net(inputs), labels)
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[0] > 1.0 > 0.1 > losses[-1]
    assert torch.equal(net(inputs).argmax(dim=1), labels)
