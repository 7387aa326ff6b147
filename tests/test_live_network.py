"""The numpy network against the torch one, with random weights."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from eskin.errors import ModelError
from eskin.graph import GraphBatch, join
from eskin.graph.history import HISTORY
from eskin.live import Network, Window
from eskin.live.layers import silu
from eskin.model import SLOT_NS, Model
from eskin.model.weights import network_shapes
from eskin.nn import network_input
from graph_scenes import with_bystanders
from live_scenes import VOCABULARY, model_of, network

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


def of_numpy(net, batch, stamps):
    """The same without torch."""
    live = Network(model_of(net))
    window = Window(net.config.slots, live.channels)
    for row, stamp in zip(live.features(batch), stamps.tolist(), strict=True):
        window.push(stamp, row)
    return live.logits(*window.view())


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("kind", ["pressure", "shear"])
@pytest.mark.parametrize("step", [0.1, 0.02, 0.005])
def test_numpy_gives_the_logits_of_torch_at_any_rate(sizes, kind, step):
    rng = np.random.default_rng(1)
    net = network(kind, **sizes)
    span = (net.config.slots - 1) * SLOT_NS * 1e-9
    times = np.arange(span, 0.0, -step)[::-1] - rng.uniform(0, step / 3)
    stamps = 10**18 + np.rint((times - times[0]) * 1e9).astype(np.int64)
    graphs = [random_graph(rng, int(rng.integers(0, 40))) for _ in stamps]
    batch = join(graphs)
    want = of_torch(net, batch, stamps)
    assert np.abs(want).max() > 0.3
    np.testing.assert_allclose(of_numpy(net, batch, stamps), want, atol=1e-4)


@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_a_window_of_untouched_and_empty_graphs_gives_the_logits_of_torch(kind):
    rng = np.random.default_rng(2)
    net = network(kind)
    stamps = 10**18 + SLOT_NS * np.array([0, 5, 6, 40])
    graphs = [random_graph(rng, n, touched=False) for n in (0, 3, 0, 12)]
    batch = join(graphs)
    want = of_torch(net, batch, stamps)
    np.testing.assert_allclose(of_numpy(net, batch, stamps), want, atol=1e-4)


def test_encoding_graphs_together_is_encoding_each_alone():
    rng = np.random.default_rng(3)
    live = Network(model_of(network("shear")))
    graphs = [random_graph(rng, n, touched=n != 7) for n in (5, 0, 30, 7, 0)]
    alone = np.concatenate([live.features(graph) for graph in graphs])
    np.testing.assert_allclose(live.features(join(graphs)), alone, atol=1e-5)


def test_nodes_that_nobody_active_hears_change_no_feature():
    rng = np.random.default_rng(7)
    live = Network(model_of(network("shear")))
    batch = join([random_graph(rng, n) for n in (12, 1, 30)])
    other = with_bystanders(batch, rng)
    np.testing.assert_allclose(live.features(other), live.features(batch), atol=1e-5)


def test_a_model_for_pressure_takes_no_notice_of_shear():
    rng = np.random.default_rng(4)
    live = Network(model_of(network("pressure")))
    graph = random_graph(rng, 20)
    without = replace(graph, shear=0 * graph.shear, shear_before=0 * graph.shear)
    assert np.array_equal(live.features(graph), live.features(without))


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_every_parameter_of_torch_has_its_shape_in_the_card(sizes, kind):
    net = network(kind, **sizes)
    shapes = {name: tuple(w.shape) for name, w in net.state_dict().items()}
    assert network_shapes(model_of(net).card) == shapes


def test_silu_neither_overflows_nor_differs_from_torch():
    x = np.array([-1e4, -100, -3, 0, 1e-3, 7, 1e4], np.float32)
    want = torch.nn.functional.silu(torch.tensor(x)).numpy()
    np.testing.assert_allclose(silu(x), want, rtol=1e-6, atol=1e-7)


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
