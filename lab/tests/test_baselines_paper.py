"""The paper's network: what saves work changes nothing, and motion changes nothing."""

import numpy as np
import pytest
import torch

from eskin.live import find_live_neighbours
from helpers.baselines import UR5
from helpers.graphs import FOLDED
from lab.baselines.paper import PaperNetwork

pytestmark = pytest.mark.slow


def network(pooling="max", k=8):
    torch.manual_seed(0)
    net = PaperNetwork(UR5, 3, k, pooling).eval().double()
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
    skin, rng = UR5.skin, np.random.default_rng(0)
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
    some, all_nodes = network(), network()
    all_nodes.whole = True
    with torch.inference_mode():
        one, other = some.encode(*readings()), all_nodes.encode(*readings())
    assert one.shape == (4, 32)
    assert (one[0] - one[3]).abs().max() > 1e-3
    torch.testing.assert_close(one, other, atol=1e-9, rtol=1e-9)


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
        torch.testing.assert_close(one, other, atol=1e-9, rtol=1e-9)


def test_features_are_invariant_under_rigid_motion():
    """The first joint carries all of the skin."""
    net, (pressure, q) = network(), readings(moving=False)
    turned = q.clone()
    turned[:, 0] += 1.0
    with torch.inference_mode():
        one, other = net.encode(pressure, q), net.encode(pressure, turned)
    torch.testing.assert_close(one, other, atol=1e-9, rtol=1e-9)
