"""The paper's network: what saves work changes nothing, and motion changes nothing."""

import numpy as np
import pytest
import torch
from eskin_paper_network import PaperNetwork
from eskin_paper_network.layer import PaperLayer

from eskin.live import find_live_neighbours
from helpers.baselines import UR5
from helpers.graphs import FOLDED

pytestmark = pytest.mark.slow


def network(pooling="max", k=8, distance="kinematic"):
    torch.manual_seed(0)
    net = PaperNetwork(UR5, 3, k, pooling, distance).eval()
    with torch.no_grad():
        net.embed.weight *= 10
    return net


def between_links():
    """Where two links of the folded arm are nearest to each other [m]."""
    p_world, _ = UR5.place_taxels(FOLDED)
    links = UR5.taxel_link_index
    near = find_live_neighbours(p_world, UR5.skin.patch_index, np.arange(2112), 4, 0.03)
    across = (near >= 0) & (links[near] != links[:, None])
    return p_world[np.flatnonzero(across.any(axis=1))[0]]


def readings(moving=True):
    """A touch over a seam, one on two links of the folded arm, one alone, and none."""
    skin = UR5.skin
    rng = np.random.default_rng(0)
    pressure = np.zeros((4, skin.count), np.float32)
    p_world, _ = UR5.place_taxels(FOLDED)
    seam = p_world[skin.find_taxels("forearm_front")[15]]
    for reading, place in enumerate((seam, between_links())):
        near = np.argsort(np.linalg.norm(p_world - place, axis=1))[:60]
        pressure[reading, near] = rng.uniform(1, 30, 60)
    pressure[2, 700] = 12.0
    q = FOLDED + 0.01 * np.arange(4)[:, None] * moving
    return torch.from_numpy(pressure), torch.from_numpy(q)


def test_computing_only_changed_nodes_gives_the_same_features():
    some = network()
    all_nodes = network()
    all_nodes.whole = True
    with torch.inference_mode():
        one = some.encode(*readings())
        other = all_nodes.encode(*readings())
    assert one.shape == (4, 32)
    assert (one[0] - one[3]).abs().max() > 1e-3
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-3)


def test_computing_only_changed_nodes_gives_the_same_means_and_gradients():
    found = []
    for whole in (False, True):
        # Of a maximum, equal nodes share the gradient as rounding has it.
        net = network("mean").train()
        net.whole = whole
        features = net.encode(*readings())
        features.square().sum().backward()
        gradients = [p.grad for p in net.parameters() if p.grad is not None]
        found.append([features, *gradients])
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-3)


def test_features_are_invariant_under_rigid_motion():
    """The first joint carries all of the skin."""
    net = network()
    (pressure, q) = readings(moving=False)
    turned = q.clone()
    turned[:, 0] += 1.0
    with torch.inference_mode():
        one = net.encode(pressure, q)
        other = net.encode(pressure, turned)
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-3)


@pytest.mark.parametrize("distance", ["geometric", "patch", "none"])
def test_fixed_edges_give_the_same_features_in_every_pose(distance):
    net = network(distance=distance)
    (pressure, q) = readings()
    with torch.inference_mode():
        one = net.encode(pressure, q)
        other = net.encode(pressure, 0.5 * q)
    assert torch.equal(one, other)


def test_live_edges_give_other_features_where_links_face_each_other():
    net = network()
    (pressure, q) = readings()
    with torch.inference_mode():
        one = net.encode(pressure, q)
        other = net.encode(pressure, 0 * q)
    assert (one[1] - other[1]).abs().max() > 1e-4
    torch.testing.assert_close(one[2], other[2], atol=1e-5, rtol=1e-3)


def test_without_lengths_messages_do_not_depend_on_places():
    net = network(distance="none")
    patch = network()
    (pressure, q) = readings()
    patch.load_state_dict(net.state_dict())
    with torch.no_grad():
        net.near.table = patch.near.table
        net.positions *= 2
        one = net.encode(pressure[2:3], q[2:3])
        net.positions /= 2
        net.rest = None
        torch.testing.assert_close(one, net.encode(pressure[2:3], q[2:3]))


def sum_edges_by_torch(layer, v, x, first, source, length):
    """Equation 2 for a list of edges, with torch's own gradients."""
    target = torch.from_numpy(np.repeat(np.arange(len(first) - 1), np.diff(first)))
    r = x[target] - x[source]
    edge = torch.stack([r.square().sum(dim=1), length], dim=1)
    hidden = layer.of_target(v)[target] + layer.of_source(v)[source]
    silu = torch.nn.functional.silu
    m = silu(layer.message(silu(hidden + layer.of_edge(edge))))
    count = len(first) - 1
    messages = torch.zeros(count, v.shape[1]).double().index_add(0, target, m)
    moves = torch.zeros(count, 3).double().index_add(0, target, r * layer.move(m))
    updated = layer.update(torch.cat([v[:count], messages], dim=1))
    return updated, x[:count] + layer.C * moves


@pytest.mark.parametrize("rows", [5, 400])
def test_gradients_of_a_layer_are_those_of_equation_2(rows):
    """400 rows need several blocks of edges, and one target has more than a block."""
    rng = np.random.default_rng(1)
    counts = rng.integers(0, 6, rows - 2)
    counts[1] = min(rows, 300)
    first = np.concatenate([[0], counts.cumsum()])
    source = rng.integers(0, rows, first[-1]).astype(np.int32)
    torch.manual_seed(1)
    layer = PaperLayer(8, 4, moves=True, uses_length=True)
    exact = PaperLayer(8, 4, moves=True, uses_length=True).double()
    exact.load_state_dict(layer.state_dict())
    v = torch.randn(rows, 8, requires_grad=True)
    x = torch.randn(rows, 3, requires_grad=True)
    length = rng.random(len(source)).astype(np.float32)
    v_exact = v.detach().double().requires_grad_()
    x_exact = x.detach().double().requires_grad_()
    one = layer(v, x, first, source, length)
    other = sum_edges_by_torch(
        exact,
        v_exact,
        x_exact,
        first,
        torch.from_numpy(source).long(),
        torch.from_numpy(length).double(),
    )
    for outputs in (one, other):
        weights = torch.arange(1.0, 1 + outputs[0].shape[1]), torch.tensor([1.0, 2, 3])
        sum((o * w).sum() for o, w in zip(outputs, weights, strict=True)).backward()
    pairs = [(v.grad, v_exact.grad), (x.grad, x_exact.grad)]
    pairs += [
        (p.grad, e.grad)
        for p, e in zip(layer.parameters(), exact.parameters(), strict=True)
    ]
    for got, want in [*zip(one, other, strict=True), *pairs]:
        scale = want.abs().max().item()
        torch.testing.assert_close(got.double(), want, atol=1e-4 * scale, rtol=1e-3)


def test_the_largest_of_all_nodes_is_pooled():
    """A rest feature counts where its node does not differ, and only there."""
    net = network()
    (pressure, q) = readings()
    whole = network()
    whole.whole = True
    with torch.no_grad():
        for each in (net, whole):
            each.layers[2].update[2].bias += 5.0
        one = net.encode(pressure, q)
        other = whole.encode(pressure, q)
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-3)
