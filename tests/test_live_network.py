"""Tests of the compiled network: its parts compute what those of torch do."""

from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.learn.nn import SlotIndex, build_graph_tensors
from eskin.live import SLOT_NS, Network
from helpers.graphs import LOADS, add_nodes_at_rest, random_graph
from helpers.live import model_of, network
from helpers.live_parts import SequenceWindow, compute_features


@cache
def make_networks(kind="pressure", **sizes):
    """Build the same network in torch and compiled."""
    net = network(kind, **sizes)
    return net, Network(model_of(net))


def put_at_rest(rng, graph, share):
    """Return a graph with no load, now or before, at a share of the nodes."""
    rest = rng.random(len(graph.taxels)) < share
    changed = {name: getattr(graph, name).copy() for name in LOADS}
    for values in changed.values():
        values[rest] = 0.0
    return graph._replace(**changed)


SIZES = (
    {},
    {"width": 16, "layers": 3},
    {"width": 32, "layers": 1, "channels": 5, "slots": 60},
    {"layers": 0},
    {"width": 0},
)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(
    sizes=st.sampled_from(SIZES),
    seed=st.integers(0, 1000),
    nodes=st.sampled_from([0, 1, 2, 7, 40, 150]),
    rest=st.sampled_from([0.0, 0.5, 1.0]),
    kind=st.sampled_from(["pressure", "shear"]),
    neighbours=st.sampled_from([0, 6]),
)
def test_features_of_any_graph_are_those_of_torch(
    sizes, seed, nodes, rest, kind, neighbours
):
    """Also with more nodes at rest, which the compiled network leaves out."""
    rng = np.random.default_rng(seed)
    (net, live) = make_networks(kind, **sizes)
    graph = put_at_rest(rng, random_graph(rng, nodes, neighbours), rest)
    with torch.no_grad():
        [want] = net.embed(build_graph_tensors(graph, net.shear)).numpy()
    for each in (graph, add_nodes_at_rest(graph, rng)):
        np.testing.assert_allclose(compute_features(live, each), want, atol=1e-5)


def test_features_of_a_large_graph_are_those_of_torch():
    """With more nodes and edges than there is memory for at first."""
    rng = np.random.default_rng(5)
    (net, live) = make_networks()
    small = random_graph(rng, 20)
    large = random_graph(rng, 300, neighbours=130)
    before = compute_features(live, small).copy()
    with torch.no_grad():
        [want] = net.embed(build_graph_tensors(large, net.shear)).numpy()
    np.testing.assert_allclose(compute_features(live, large), want, atol=1e-5)
    assert np.array_equal(compute_features(live, small), before)


SLOTS = (25, 26, 30, 41, 101)


def assert_windows_equal(slots, stamps, width=4):
    """Compare the logits at every stamp with those of torch for the whole window."""
    net, live = make_networks(slots=slots, channels=6, width=width)
    window = SequenceWindow(live.parts.heads, live.slots)
    rows = np.random.default_rng(0).normal(size=(len(stamps), len(live.parts.features)))
    rows = 2 * rows.astype(np.float32)
    numbers = np.array(stamps) // SLOT_NS
    slot = numbers - numbers[:, None] + slots - 1
    index, reading = np.nonzero(np.tril(slot >= 0))
    slot = torch.tensor(slot[index, reading])
    slot_index = SlotIndex(torch.tensor(index), slot, len(stamps))
    with torch.no_grad():
        want = net.classify(torch.tensor(rows[reading]), slot_index).mean(dim=0)
    found = [window.push(stamp, row) for stamp, row in zip(stamps, rows, strict=True)]
    np.testing.assert_allclose(found, want, atol=1e-4)


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(
    slots=st.sampled_from(SLOTS),
    width=st.sampled_from([0, 4]),
    steps=st.lists(
        st.one_of(
            st.integers(1, SLOT_NS // 3),
            st.just(SLOT_NS),
            st.integers(SLOT_NS, 9 * SLOT_NS),
            st.integers(20 * SLOT_NS, 100 * SLOT_NS),
        ),
        min_size=1,
        max_size=60,
    ),
    start=st.integers(0, 10**18),
)
def test_logits_at_any_stamps_are_those_of_the_whole_window(slots, width, steps, start):
    stamps = [start + int(step) for step in np.cumsum(steps)]
    assert_windows_equal(slots, stamps, width)


@pytest.mark.parametrize("slots", SLOTS)
@pytest.mark.parametrize("gap", [-1, 0, 1])
def test_slots_before_a_pause_of_one_window_are_not_used_again(slots, gap):
    pause = slots + gap
    numbers = [*range(40), *range(40 + pause, 60 + pause)]
    assert_windows_equal(slots, [n * SLOT_NS for n in numbers])
