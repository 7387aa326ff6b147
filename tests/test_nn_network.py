"""Tests of the network: encoder, temporal heads, and what it learns."""

import numpy as np
import pytest
import torch

from eskin.learn.nn import RecogniserNetwork, SlotIndex, TemporalHead
from eskin.live import NetworkConfig, join_graphs
from eskin.live.model_config import MIN_SLOTS
from helpers.graphs import (
    embed,
    flat,
    logits,
    make_scene,
    network_input,
    pressure_summary,
    random_graph,
    random_graphs,
    rolled,
    split_graphs,
    stroke_on_grid,
)
from helpers.live import network

# Half axes [m] of a fingertip and a palm.
SHAPES = (0.022, 0.022), (0.05, 0.04)
# Pressure [kPa] and place [m] at each reading.
COURSES = {
    "tap": ((20, 60, 80), (0.0,) * 3),
    "release": ((80, 60, 25), (0.0,) * 3),
    "light": ((2, 4, 6), (0.0,) * 3),
    "stroke": ((15,) * 4, (-0.01, 0.0, 0.01, 0.02)),
}


def make_touches(mounted):
    """Return the last graph of each course of each shape."""
    across, along, z = mounted.skin.positions.T
    if mounted.skin.name == "rolled":
        across = 0.03 * np.arctan2(along, across)
        along = z
    last = []
    for width, height in SHAPES:
        for course in COURSES.values():
            loads = [
                kpa
                * np.maximum(1 - ((across - x) / width) ** 2 - (along / height) ** 2, 0)
                for kpa, x in zip(*course, strict=True)
            ]
            last.append(
                split_graphs(make_scene(mounted, loads, step=0.04).graphs())[-1]
            )
    return join_graphs(last)


def compare_distances(coarse, dense):
    """Return the mean distance between equal touches over that between others."""
    gap = np.linalg.norm(dense[:, None] - coarse[None], axis=2)
    equal = np.eye(len(gap), dtype=bool)
    return gap[equal].mean() / gap[~equal].mean()


@pytest.mark.parametrize("make_skin", [flat, rolled])
def test_twice_the_density_hardly_changes_embeddings(make_skin):
    coarse = make_touches(make_skin(rows=16, columns=18, pitch=0.01))
    dense = make_touches(make_skin(rows=32, columns=36, pitch=0.005))
    assert dense.sizes.sum() > 2.5 * coarse.sizes.sum()
    spread = pressure_summary(coarse).std(axis=0) + 0.05
    summaries = [pressure_summary(batch) / spread for batch in (coarse, dense)]
    assert compare_distances(*summaries) < 0.1
    for seed in range(3):
        net = network(seed=seed)
        assert compare_distances(embed(net, coarse), embed(net, dense)) < 0.1


def test_reading_without_contact_is_embedded_as_zeros():
    rng = np.random.default_rng(0)
    net = network("shear")
    released = random_graph(rng, 9)._replace(pressure=np.zeros(9, np.float32))
    batch = join_graphs([random_graph(rng, 0), random_graph(rng, 9), released])
    assert embed(net, batch).any(axis=1).tolist() == [False, True, False]


def test_windows_without_contact_or_readings_have_finite_logits_and_gradients():
    rng = np.random.default_rng(2)
    net = network("shear").train()
    released = random_graph(rng, 8)._replace(pressure=np.zeros(8, np.float32))
    batch = join_graphs([random_graphs(rng, (0, 0, 0, 8, 8, 8)), released])
    window = np.array([0, 0, 0, 1, 1, 1, 2])
    slot = np.array([0, 5, 99, 0, 5, 99, 99])
    found = net(network_input(batch, window, slot, 4, True))
    assert found.shape == (4, 4)
    found.square().sum().backward()
    gradients = [parameter.grad for parameter in net.parameters()]
    assert all(grad is not None and torch.isfinite(grad).all() for grad in gradients)
    assert torch.isfinite(found).all()
    none = network_input(batch.select(window[:0]), window[:0], slot[:0], 2, True)
    assert torch.isfinite(net(none)).all()


@torch.no_grad()
def test_logits_do_not_depend_on_the_batch_nor_its_order():
    rng = np.random.default_rng(3)
    net = network("shear")
    batch = random_graphs(rng, (5, 0, 12, 7, 3, 20))
    window = np.array([0, 0, 0, 1, 1, 1])
    slot = np.array([3, 50, 50, 98, 99, 99])

    def classify(rows, windows):
        order = window[rows] % windows, slot[rows]
        return net(network_input(batch.select(rows), *order, windows, True))

    want = classify(np.arange(6), 2)
    alone = torch.cat([classify(np.arange(3), 1), classify(np.arange(3, 6), 1)])
    for found in (classify(rng.permutation(6), 2), alone):
        torch.testing.assert_close(found, want, rtol=1e-4, atol=1e-5)


@torch.no_grad()
def test_readings_in_one_slot_count_as_their_maximum():
    net = network()
    e = torch.randn(4, 26 + 2 * net.config.width)
    window = torch.tensor([0, 0, 0, 1])
    slot = torch.tensor([2, 2, 0, 1])
    pooled = torch.stack([e[:2].amax(dim=0), e[2], e[3]])
    found = net.classify(e, SlotIndex(window, slot, 2))
    want = net.classify(pooled, SlotIndex(window[1:], slot[1:], 2))
    assert torch.equal(found, want)


def test_standardised_features_have_mean_zero_and_scale_one():
    net = RecogniserNetwork(NetworkConfig(), 3, shear=True)
    summary = torch.randn(500, len(net.summary_mean)) * 7 + 30
    net.fit_summary(summary)
    centred = (summary - net.summary_mean) * net.summary_scale
    np.testing.assert_allclose(centred.mean(dim=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(centred.std(dim=0), 1.0, atol=1e-2)


def test_extreme_pressure_has_bounded_logits():
    net = network()
    batch = stroke_on_grid().graphs()
    loud = batch._replace(pressure=1e6 * batch.pressure)
    assert np.abs(logits(net, loud)).max() < 100


SLOTS = 100
INPUTS = 6
CHANNELS = 8


def make_head(classes=4) -> TemporalHead:
    torch.manual_seed(0)
    head = TemporalHead(INPUTS, CHANNELS, classes, dropout=0.5).eval()
    with torch.no_grad():
        for parameter in head.parameters():
            parameter += 0.1 * torch.randn_like(parameter)
    return head


def compute_statistics(head, e, present):
    """Return mean, deviation, maximum and integral at each of three time scales."""
    with torch.no_grad():
        head.classify.weight.copy_(torch.eye(12 * CHANNELS))
        head.classify.bias.zero_()
        return head(e, present).view(len(e), 3, 4, CHANNELS)


@torch.no_grad()
@pytest.mark.parametrize("share", [0.0, 0.05, 0.6])
def test_slots_without_a_reading_do_not_matter(share):
    head = make_head()
    e = torch.randn(5, SLOTS, INPUTS)
    present = (torch.rand(5, SLOTS) < share).float()
    other = torch.where(present[:, :, None] > 0, e, 1e3 * torch.randn_like(e))
    torch.testing.assert_close(head(other, present), head(e, present))


@pytest.mark.parametrize("slots", range(MIN_SLOTS, MIN_SLOTS + 8))
def test_every_slot_matters_and_the_newest_at_every_scale(slots):
    """Where the slots do not fit the strides, the oldest ones are left out."""
    head = make_head(12 * CHANNELS)
    e = torch.randn(1, slots, INPUTS).expand(slots + 1, -1, -1).clone()
    e[range(slots), range(slots)] += 5.0
    *changed, want = compute_statistics(head, e, torch.ones(slots + 1, slots))
    gaps = torch.stack(changed).sub(want).abs().amax(dim=(2, 3))
    assert (gaps[:, 0] > 1e-4).all()
    assert (gaps[-1] > 1e-4).all()


def test_statistics_of_a_steady_touch_do_not_depend_on_the_rate():
    """Only the integral knows its duration (partial convolutions, Liu et al. 2018)."""
    head = make_head(12 * CHANNELS)
    for layer in (head.short, head.long):
        weight = layer.conv.weight.data
        weight.copy_(weight.mean(dim=2, keepdim=True).expand_as(weight))
    e = torch.randn(INPUTS).expand(4, SLOTS, INPUTS)
    present = torch.zeros(4, SLOTS)
    for mask, slots in zip(
        present, (range(20, 100), range(60, 100), range(20, 100, 5), ()), strict=True
    ):
        mask[list(slots)] = 1.0
    long, short, slow, none = compute_statistics(head, e, present)
    for other in (short, slow):
        torch.testing.assert_close(other[:, :3], long[:, :3])
    torch.testing.assert_close(long[:, 3], 0.8 * long[:, 0])
    torch.testing.assert_close(short[:, 3], 0.4 * long[:, 0])
    torch.testing.assert_close(slow[:, 3], long[:, 3])
    assert not none[:, [0, 2, 3]].any()
