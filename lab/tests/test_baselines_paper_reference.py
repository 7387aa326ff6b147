"""The paper's network against its equation 2 written out, node by node in the world."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from eskin_paper_network import PaperNetwork

from eskin.skin import MountedSkin
from helpers.graphs import book

pytestmark = pytest.mark.slow

KPA = 10.0  # unit of pressure [kPa]
LEAST = 0.5  # pressure that is read as zero [kPa]
LENGTH = 0.03  # unit of length [m]
K_LIVE = 4
REACH = 0.03
OPEN = 0.4  # [rad]
NEARLY = 2.7  # [rad]
CLOSED = 3.1  # [rad]


@cache
def uneven_book() -> MountedSkin:
    """Two patches on a hinge, no two pairs of taxels equally far apart."""
    mounted = book()
    skin = mounted.skin
    shift = np.random.default_rng(1).normal(0, 0.001, (skin.count, 3))
    return MountedSkin(replace(skin, positions=skin.positions + shift), mounted.robot)


def network(pooling, k) -> PaperNetwork:
    torch.manual_seed(0)
    return PaperNetwork(uneven_book(), 3, k, pooling).eval()


def readings():
    """A touch on one patch, on both open and closed, nearly closed, and no touch."""
    skin = uneven_book().skin
    rng = np.random.default_rng(0)
    pressure = np.zeros((5, skin.count), np.float32)
    cover = skin.find_taxels("cover")
    page = skin.find_taxels("page")
    pressure[0, cover[:9]] = rng.uniform(1, 30, 9)
    for reading in (1, 2, 3):
        for patch in (cover, page):
            pressure[reading, patch[20:30]] = rng.uniform(0, 30, 10)
    pressure[4, cover[5]] = 0.4
    q = np.array([[OPEN], [OPEN], [CLOSED], [NEARLY], [CLOSED]])
    return pressure, q


def nearest(distances, k):
    """The `k` with the least distance, from a dict."""
    return sorted(distances, key=lambda node: distances[node])[:k]


def neighbours(p, patch, pressures, k):
    """Sources of the edges of each node: inside its patch, and live ones."""
    nodes = range(len(p))
    apart = np.linalg.norm(p[:, None] - p, axis=2)
    inside = [
        nearest({j: apart[i, j] for j in nodes if j != i and patch[j] == patch[i]}, k)
        for i in nodes
    ]
    triggered = {i for i in nodes if pressures[i] > 0}
    searched = triggered | {j for i in triggered for j in inside[i]}
    across = [[] for _ in nodes]
    for i in searched:
        others = (j for j in searched if patch[j] != patch[i] and apart[i, j] <= REACH)
        across[i] = nearest({j: apart[i, j] for j in others}, K_LIVE)
    return inside, across


def silu(values):
    return values / (1 + np.exp(-values))


def linear(layer, values):
    bias = 0 if layer.bias is None else layer.bias.numpy()
    return layer.weight.numpy() @ values + bias


def phi_e(layer, v_i, v_j, squared, distance):
    """Two dense layers; the first is kept in parts."""
    parts = layer.of_target, layer.of_source, layer.of_edge
    W = np.concatenate([part.weight.numpy() for part in parts], axis=1)
    inputs = np.concatenate([v_i, v_j, [squared, distance]])
    hidden = silu(W @ inputs + layer.of_target.bias.numpy())
    return silu(linear(layer.message, hidden))


def perceptron(layers, values):
    return linear(layers[2], silu(linear(layers[0], values)))


def reference(net, pressure, q, k):
    """Features of one reading and how many live edges there are."""
    mounted = net.mounted
    patch = mounted.skin.patch_index
    pressures = np.where(pressure >= LEAST, pressure.astype(float) / KPA, 0.0)
    p, _ = mounted.place_taxels(q)
    inside, across = neighbours(p, patch, pressures, k)
    first = x = p / LENGTH
    v = [linear(net.embed, np.array([each])) for each in pressures]
    for layer in net.layers:
        x_next = x.copy()
        v_next = []
        for i in range(len(x)):
            m_i = np.zeros(len(v[i]))
            for j in inside[i] + across[i]:
                r = x[i] - x[j]
                e_ij = np.linalg.norm(first[i] - first[j])
                m_ij = phi_e(layer, v[i], v[j], r @ r, e_ij)
                x_next[i] += r * perceptron(layer.move, m_ij) / k
                m_i += m_ij
            v_next.append(perceptron(layer.update, np.concatenate([v[i], m_i])))
        x = x_next
        v = v_next
    pool = np.max if net.pooling == "max" else np.mean
    return pool(v, axis=0), sum(map(len, across))


@pytest.mark.parametrize(("pooling", "k"), [("max", 8), ("mean", 4)])
def test_features_equal_equation_2_computed_node_by_node(pooling, k):
    net = network(pooling, k)
    (pressure, q) = readings()
    with torch.inference_mode():
        got = net.encode(torch.from_numpy(pressure), torch.from_numpy(q)).numpy()
        want = [
            reference(net, *reading, k) for reading in zip(pressure, q, strict=True)
        ]
    live = [count for _, count in want]
    assert live[:2] == [0, 0] and live[2] > 20 and live[3] > 0 and live[4] == 0
    for one, (other, _) in zip(got, want, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5, rtol=1e-4)
