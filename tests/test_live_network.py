"""The compiled network against the torch one, with random weights."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from benchmarks.live_parts import SequenceWindow, compute_features
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.runtime import rtsys
from numba.core.runtime._nrt_python import memsys_disable_stats, memsys_enable_stats

from eskin.errors import ModelError
from eskin.graph import HISTORY, NODE_FIELDS, GraphBatch, compute_summary, join_graphs
from eskin.graph.summary_kernels import compute_eigenvalues
from eskin.live import Network
from eskin.live.kernels import activate
from eskin.live.network import NODES
from eskin.model import SLOT_NS, Model
from eskin.model.file import network_shapes
from eskin.nn import build_graph_tensors
from helpers.graphs import network_input, with_bystanders
from helpers.live import VOCABULARY, model_of, network
from helpers.summary_reference import reference_summary

SIZES = [
    {},
    {"width": 8, "layers": 1, "channels": 5},
    {"width": 32, "layers": 3, "channels": 16, "slots": 60},
    {"layers": 0, "slots": 101},
]


def random_graph(rng, nodes, touched=True, shear=True) -> GraphBatch:
    def real(*shape):
        return rng.normal(size=shape).astype(np.float32)

    pressure = np.maximum(20 * real(nodes), 0) * touched
    normals = real(nodes, 3)
    return GraphBatch(
        taxels=np.arange(nodes),
        pressure=pressure,
        before=np.maximum(20 * real(nodes), 0),
        age=np.abs(real(nodes)) * (pressure > 0),
        areas=np.abs(real(nodes)) + np.float32(0.1),
        positions=2 * real(nodes, 3),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        shear=10 * real(nodes, 3) * shear,
        shear_before=10 * real(nodes, 3) * shear,
        neighbours=rng.integers(-1, max(nodes, 1), (nodes, 6)) * (nodes > 0),
        offsets=np.array([0, nodes]),
        seconds=np.array([0.02], np.float32),
        history=np.abs(real(1, len(HISTORY))),
    )


def of_torch(net, batch, stamps):
    """Logits of one window that ends with the last stamp."""
    now = stamps[-1] // SLOT_NS
    slot = stamps // SLOT_NS - now + net.config.slots - 1
    window = np.zeros(len(stamps), int)
    with torch.no_grad():
        return net(network_input(batch, window, slot, 1, net.shear))[0].numpy()


def features_of(live, batch):
    """Features of every graph of a batch, each on its own."""
    graphs = [batch.select(np.array([k])) for k in range(batch.count)]
    return np.array([compute_features(live, graph).copy() for graph in graphs])


def of_live(net, batch, stamps):
    """The same without torch."""
    live = Network(model_of(net))
    window, logits = SequenceWindow(live.heads, live.slots), None
    for row, stamp in zip(features_of(live, batch), stamps.tolist(), strict=True):
        logits = window.push(stamp, row)
    return logits


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("kind", ["pressure", "shear"])
@pytest.mark.parametrize("step", [0.1, 0.02, 0.005])
def test_the_logits_are_those_of_torch_at_any_rate(sizes, kind, step):
    rng = np.random.default_rng(1)
    net = network(kind, **sizes)
    span = (net.config.slots - 1) * SLOT_NS * 1e-9
    times = np.arange(span, 0.0, -step)[::-1] - rng.uniform(0, step / 3)
    stamps = 10**18 + np.rint((times - times[0]) * 1e9).astype(np.int64)
    graphs = [random_graph(rng, int(rng.integers(0, 40))) for _ in stamps]
    batch = join_graphs(graphs)
    want = of_torch(net, batch, stamps)
    assert np.abs(want).max() > 0.3
    np.testing.assert_allclose(of_live(net, batch, stamps), want, atol=1e-4)


@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_a_window_of_untouched_and_empty_graphs_gives_the_logits_of_torch(kind):
    rng = np.random.default_rng(2)
    net = network(kind)
    stamps = 10**18 + SLOT_NS * np.array([0, 5, 6, 40])
    graphs = [random_graph(rng, n, touched=False) for n in (0, 3, 0, 12)]
    batch = join_graphs(graphs)
    want = of_torch(net, batch, stamps)
    np.testing.assert_allclose(of_live(net, batch, stamps), want, atol=1e-4)


def at_rest(rng, batch, share):
    """The same with nothing felt, now or before, at a share of the nodes."""
    rest = rng.random(len(batch.taxels)) < share
    names = ("pressure", "before", "age", "shear", "shear_before")
    changed = {name: getattr(batch, name).copy() for name in names}
    for values in changed.values():
        values[rest] = 0.0
    return replace(batch, **changed)


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 1000),
    nodes=st.sampled_from([0, 1, 2, 7, 40, 150]),
    rest=st.sampled_from([0.0, 0.5, 1.0]),
    kind=st.sampled_from(["pressure", "shear"]),
    alone=st.booleans(),
)
def test_the_features_of_any_graph_are_those_of_torch(seed, nodes, rest, kind, alone):
    rng = np.random.default_rng(seed)
    batch = at_rest(rng, random_graph(rng, nodes), rest)
    if alone:
        batch = replace(batch, neighbours=np.full_like(batch.neighbours, -1))
    net, live = of_kind(kind)
    with torch.no_grad():
        want = net.embed(build_graph_tensors(batch, net.shear)).numpy()
    np.testing.assert_allclose(features_of(live, batch), want, atol=1e-5)


@cache
def of_kind(kind):
    net = network(kind, width=16, layers=3)
    return net, Network(model_of(net))


def test_more_edges_than_fit_one_block_give_the_features_of_torch():
    rng = np.random.default_rng(5)
    net, live = of_kind("pressure")
    batch = random_graph(rng, 300)
    many = replace(batch, neighbours=rng.integers(-1, 300, (300, 130)))
    with torch.no_grad():
        want = net.embed(build_graph_tensors(many, net.shear)).numpy()
    np.testing.assert_allclose(features_of(live, many), want, atol=1e-5)


@pytest.mark.parametrize("kind", ["pressure", "shear"])
@pytest.mark.parametrize("touched", [True, False])
def test_the_compiled_summary_is_that_of_numpy(kind, touched):
    rng = np.random.default_rng(6)
    shear = kind == "shear"
    for nodes in (0, 1, 2, 3, 50):
        batch = random_graph(rng, nodes, touched)
        [found] = compute_summary(batch, shear)
        want = reference_summary(batch, shear)
        np.testing.assert_allclose(found, want, atol=1e-5)


@given(
    st.lists(st.floats(-9, 9), min_size=9, max_size=9),
    st.sampled_from([0.0, 1e-9, 1.0]),
)
def test_eigenvalues_are_exact_where_some_are_equal(entries, third):
    basis, _ = np.linalg.qr(np.reshape(entries, (3, 3)))
    a = basis @ np.diag([4.0, third, third]) @ basis.T
    found = compute_eigenvalues(a[0, 0], a[1, 1], a[2, 2], a[0, 1], a[0, 2], a[1, 2])
    np.testing.assert_allclose(found, [4.0, third, third], atol=1e-12)


def test_arrays_longer_than_the_graph_give_its_features():
    rng = np.random.default_rng(8)
    live = Network(model_of(network("shear")))
    short, long = random_graph(rng, 20).arrays, random_graph(rng, 90).arrays
    for name in NODE_FIELDS:
        getattr(long, name)[:20] = getattr(short, name)
    longer = long._replace(
        offsets=short.offsets, seconds=short.seconds, history=short.history
    )
    want = compute_features(live, short).copy()
    assert np.array_equal(compute_features(live, longer), want)


def test_a_graph_of_a_batch_has_the_features_that_it_has_alone():
    rng = np.random.default_rng(3)
    live = Network(model_of(network("shear")))
    graphs = [random_graph(rng, n, touched=n != 7) for n in (5, 0, 30, 7, 0)]
    alone = [compute_features(live, graph).copy() for graph in graphs]
    assert np.array_equal(features_of(live, join_graphs(graphs)), alone)


def test_nodes_that_nobody_active_hears_change_no_feature():
    rng = np.random.default_rng(7)
    live = Network(model_of(network("shear")))
    batch = join_graphs([random_graph(rng, n) for n in (12, 1, 30)])
    other = features_of(live, with_bystanders(batch, rng))
    np.testing.assert_allclose(other, features_of(live, batch), atol=1e-5)


def test_a_model_for_pressure_takes_no_notice_of_shear():
    rng = np.random.default_rng(4)
    live = Network(model_of(network("pressure")))
    graph = random_graph(rng, 20)
    without = replace(graph, shear=0 * graph.shear, shear_before=0 * graph.shear)
    assert np.array_equal(features_of(live, graph), features_of(live, without))


def test_a_graph_larger_than_any_before_is_made_room_for_once():
    rng = np.random.default_rng(9)
    live, small = Network(model_of(network())), random_graph(rng, 20)
    want = features_of(live, small)
    memory = live.workspace
    features_of(live, random_graph(rng, NODES))
    assert live.workspace is memory
    features_of(live, random_graph(rng, NODES + 1))
    grown = live.workspace
    assert grown is not memory
    features_of(live, random_graph(rng, 2 * NODES))
    assert live.workspace is grown
    assert np.array_equal(features_of(live, small), want)


def arrays_in(values):
    """How many arrays a tuple of tuples holds."""
    if isinstance(values, tuple):
        return sum(arrays_in(value) for value in values)
    return int(isinstance(values, np.ndarray))


@pytest.mark.parametrize("nodes", [0, 5, 200])
def test_a_reading_takes_no_memory_in_compiled_code(nodes):
    rng = np.random.default_rng(10)
    live = Network(model_of(network("shear")))
    window, graph = (
        SequenceWindow(live.heads, live.slots),
        random_graph(rng, nodes).arrays,
    )
    memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for n in range(30):
            window.push(10**18 + 3 * n * SLOT_NS, compute_features(live, graph))
        after = rtsys.get_allocation_stats()
    finally:
        memsys_disable_stats()
    given = (graph, live.weights, live.workspace, live.heads, window.state)
    handles = arrays_in(given) + 3  # features twice and logits; the rest is ours
    assert after.alloc - before.alloc == 30 * handles
    assert after.free - before.free == 30 * handles


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_every_parameter_of_torch_has_its_shape_in_the_card(sizes, kind):
    net = network(kind, **sizes)
    shapes = {name: tuple(w.shape) for name, w in net.state_dict().items()}
    assert network_shapes(model_of(net).card) == shapes


def test_silu_neither_overflows_nor_differs_from_torch():
    x = np.concatenate([np.linspace(-100, 100, 20001), [-1e4, 1e4]])
    x = x.astype(np.float32)
    want = torch.nn.functional.silu(torch.tensor(x)).numpy()
    found = x.copy()[None]
    activate(found, np.zeros_like(x))
    np.testing.assert_allclose(found[0], want, rtol=1e-6, atol=1e-6)


def broken(**changes) -> Model:
    """A good model with some weights changed; None takes one away."""
    model = model_of(network())
    weights = {**model.weights, **changes}
    kept = {name: weight for name, weight in weights.items() if weight is not None}
    return Model(kept, model.card)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"encoder.embed.weight": None}, "lacks parameter 'encoder.embed.weight'"),
        (
            {"graph_head.short.bias": np.zeros(3, np.float32)},
            r"'graph_head.short.bias' has shape \(3,\); allowed is \(32,\)",
        ),
        (
            {"summary_head.classify.bias": np.zeros(7, np.float32)},
            r"classify.bias' has shape \(7,\); allowed is \(4,\).* 4 classes "
            r"\(none, poke, stroke, grab\)",
        ),
        ({"extra": np.zeros(1, np.float32)}, "has a parameter 'extra'"),
        (
            {"summary_mean": np.full(17, np.nan, np.float32)},
            "'summary_mean' holds NaN",
        ),
    ],
)
def test_weights_that_do_not_fit_are_refused_by_name(changes, message):
    if "summary_mean" in changes:
        size = len(model_of(network()).weights["summary_mean"])
        changes = {"summary_mean": np.full(size, np.nan, np.float32)}
    with pytest.raises(ModelError, match=message) as caught:
        Network(broken(**changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("vocabulary", "words"),
    [
        (("poke", "stroke", "grab", "pat"), "poke, stroke, grab, pat"),
        (("none", "poke", "poke", "grab"), "none, poke, poke, grab"),
        ((), "empty"),
        (("none",), "none"),
    ],
)
def test_a_vocabulary_that_cannot_be_is_refused(vocabulary, words):
    model = model_of(network())
    card = replace(model.card, vocabulary=vocabulary)
    with pytest.raises(ModelError, match=f"vocabulary is {words}; allowed"):
        Network(Model(model.weights, card))


def test_a_model_of_another_vocabulary_size_is_refused():
    model = model_of(network())
    card = replace(model.card, vocabulary=(*VOCABULARY, "pat"))
    with pytest.raises(ModelError, match=r"classify\.weight' has shape .* 5 classes"):
        Network(Model(model.weights, card))
