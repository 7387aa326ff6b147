"""Tests of model files: written whole, read back bit for bit, refused in one line."""

import json
from dataclasses import fields, is_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import save_file
from safetensors.torch import save_file as save_torch

from eskin.errors import ModelError
from eskin.learn.checkpoint import to_model, to_network
from eskin.live import (
    PRESSURE_SUMMARY,
    DecisionConfig,
    GraphConfig,
    Model,
    ModelCard,
    Network,
    NetworkConfig,
    check_limits,
    load_model,
)
from eskin.live.model_config import MIN_SLOTS, read_limits
from eskin.touch import ContactConfig, PipelineConfig
from helpers.graphs import logits, press_on_seam
from helpers.live import VOCABULARY, model_of, network, with_closing_layer

CARD = ModelCard(
    ("none", "poke", "Strich – ä"),
    kind="shear",
    network=NetworkConfig(width=8, layers=1, channels=4, dropout=0.1, slots=50),
    graph=GraphConfig(fixed=6, live=2, live_reach=0.02),
    pipeline=PipelineConfig(contacts=ContactConfig(on=5.0, off=4.0)),
    decision=DecisionConfig(0.7, {"poke": 0.4, "Strich – ä": 2.0}, least=0.2),
    temperature=1.7,
    training={"seed": "3", "rate": "0.001"},
    data_digest="ab12",
    metrics={"accuracy": 0.1 + 0.2, "worst": float("inf")},
)
RNG = np.random.default_rng(0)
MODEL = Model(
    {
        "float32": RNG.normal(size=(3, 4)).astype(np.float32),
        "float64": RNG.normal(size=5),
        "transposed": RNG.normal(size=(3, 4)).astype(np.float32).T,
        "special": np.array([np.nan, np.inf, -0.0, 1e-45], np.float32),
        "scalar": np.array(2.5, np.float32),
        "empty": np.zeros((0, 3), np.float32),
        "integers": np.arange(4),
    },
    CARD,
)
MINIMAL = {"vocabulary": ["none", "poke"]}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "model.safetensors"


@pytest.fixture
def saved(path):
    MODEL.save(path)
    return path


def test_model_is_read_as_it_was_written(tmp_path):
    """Bit for bit, in a folder that is made, and in the same bytes each time."""
    path = tmp_path / "a" / "b" / "m.safetensors"
    MODEL.save(path)
    found = load_model(path)
    content = path.read_bytes()
    assert found.card == MODEL.card
    assert found.weights.keys() == MODEL.weights.keys()
    for name, weight in MODEL.weights.items():
        other = found.weights[name]
        assert (other.dtype, other.shape) == (weight.dtype, weight.shape), name
        assert other.tobytes() == weight.tobytes(), name
    found.save(path)
    assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


def test_metric_may_be_nan(path):
    replace(MODEL, card=replace(CARD, metrics={"f1": np.nan})).save(path)
    assert np.isnan(load_model(path).card.metrics["f1"])
    with safe_open(path, framework="numpy") as file:
        card = file.metadata()["eskin"]
    assert json.loads(card, parse_constant=pytest.fail)["metrics"] == {"f1": "NaN"}


@pytest.mark.parametrize("kind", ["pressure", "shear"])
@pytest.mark.parametrize("width", [8, 0])
def test_network_read_from_a_file_gives_the_same_logits(path, kind, width):
    net = network(kind, width=width, channels=8)
    to_model(net, ModelCard(VOCABULARY, kind=kind, network=net.config)).save(path)
    batch = press_on_seam(shear=True).graphs()
    found = logits(to_network(load_model(path)), batch)
    assert np.array_equal(found, logits(net, batch))


def test_entries_that_a_card_lacks_have_defaults(path):
    write_card(path, json.dumps(MINIMAL | {"graph": {}}))
    card = load_model(path).card
    assert card == ModelCard(("none", "poke"))
    assert card.graph.posed


def assert_refused(path, *parts):
    """Check that a file is refused in one line that names it and has some parts."""
    with pytest.raises(ModelError) as caught:
        load_model(path)
    message = str(caught.value)
    assert all(part in message for part in (str(path), *parts)), message
    assert "\n" not in message
    assert len(message) < 600


def test_missing_file_and_folder_are_refused(path):
    assert_refused(path, "ur5", "eskin train DATA")
    assert_refused(path.parent, "folder", "ur5")


def test_file_of_another_kind_incomplete_or_damaged_is_refused(saved):
    whole = saved.read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    lengths = (0, 1, 7, 8, 9, header // 2, header, len(whole) - 1)
    others = (b"PK\x03\x04", b"no\nmodel\nat all\n" * 99)
    for content in (*others, *(whole[:length] for length in lengths)):
        saved.write_bytes(content)
        assert_refused(saved, "no model file")
    for place in (0, 8, 20):
        saved.write_bytes(whole[:place] + b"\xff\x00\xff" + whole[place + 3 :])
        assert_refused(saved)


@pytest.mark.parametrize(
    ("dtype", "metadata", "part"),
    [
        (torch.float32, None, "no card 'eskin'"),
        (torch.bfloat16, {"format": "pt"}, "no card 'eskin'"),
        (torch.bfloat16, {"eskin": json.dumps(MINIMAL)}, "no model file"),
    ],
)
def test_other_safetensors_are_refused(path, dtype, metadata, part):
    """Without a card, or with numbers that numpy does not have."""
    save_torch({"w": torch.zeros(2, 2, dtype=dtype)}, path, metadata=metadata)
    assert_refused(path, part)


def write_card(path, text: str) -> None:
    save_file({"w": np.zeros(2, np.float32)}, path, metadata={"eskin": text})


@pytest.mark.parametrize(
    ("entries", "place", "value"),
    [
        ({"vocabulary": None}, "vocabulary", "None"),
        ({"kind": "warmth"}, "kind", "'warmth'"),
        ({"format": "eskin-model-2"}, "format", "'eskin-model-2'"),
        ({"temperature": "warm"}, "temperature", "'warm'"),
        ({"network": {"width": "wide"}}, "network.width", "'wide'"),
        ({"network": {"dropout": "NaN"}}, "network.dropout", "'NaN'"),
        ({"graph": {"live": 1.5}}, "graph.live", "1.5"),
        ({"pipeline": {"contacts": {"on": []}}}, "pipeline.contacts.on", "[]"),
        ({"metrics": {"f1": None}}, "metrics.f1", "None"),
    ],
)
def test_invalid_card_entry_is_named(path, entries, place, value):
    write_card(path, json.dumps(MINIMAL | entries))
    assert_refused(path, f"its card: {place}: got {value}, allowed is ")


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("pipeline.calibration.tare_rank", 1e12),
        ("pipeline.calibration.tare_rank", -1e6),
        ("pipeline.calibration.tare_samples", 10**9),
        ("pipeline.calibration.drift_seconds", 0.0),
        ("pipeline.contacts.reach", 1e9),
        ("pipeline.touches.near", float("nan")),
        ("graph.fixed", 10**9),
        ("graph.live", -1),
        ("network.layers", 10**9),
        ("network.slots", 10**9),
        ("decision.hold_seconds", 1e300),
        ("decision.thresholds.poke", -1.0),
        ("temperature", 0.0),
        ("network.width", "9" * 400),
    ],
)
def test_number_of_a_card_beyond_its_limits_is_refused(path, place, value):
    *outer, name = place.split(".")
    entries = {name: value}
    for part in reversed(outer):
        entries = {part: entries}
    write_card(path, json.dumps(MINIMAL | entries))
    assert_refused(path, f"its card: {place}: got ", "allowed is")


def test_every_number_of_a_card_has_limits():
    def check(part):
        limits = read_limits(type(part))
        for field in fields(part):
            value = getattr(part, field.name)
            if is_dataclass(value):
                check(value)
            elif isinstance(value, float | int) and not isinstance(value, bool):
                low, high = limits[field.name]
                assert low <= value <= high, field.name

    check(ModelCard(("none", "poke")))


def test_model_of_too_many_bytes_is_refused(path):
    write_card(path, json.dumps(MINIMAL | {"training": {"a": "a" * 2**20}}))
    assert_refused(path, "header", "1,048,576")
    with path.open("wb") as file:
        file.truncate(2**27)
    assert_refused(path, "134,217,728")


@pytest.mark.parametrize("text", ["", "{oops", "[]", '"card"', "{", "null", "x" * 9999])
def test_invalid_card_is_refused(path, text):
    write_card(path, text)
    assert_refused(path, "card")


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("width", -1),
        ("layers", -1),
        ("channels", 0),
        ("dropout", -0.1),
        ("dropout", float("nan")),
        ("slots", MIN_SLOTS - 1),
    ],
)
def test_invalid_size_of_a_network_is_refused(entry, value):
    with pytest.raises(ValueError, match=f"{entry} is {value}"):
        NetworkConfig(**{entry: value})


@pytest.mark.parametrize("value", [float("inf"), float("nan"), -0.1])
def test_setting_must_be_finite_and_within_its_limits(value):
    with pytest.raises(ValueError, match=f"gain is {value}.*from 0"):
        check_limits(SimpleNamespace(gain=value), {"gain": (0.0, np.inf)})


FEATURES = len(PRESSURE_SUMMARY)
CLASSIFY = "summary_head.classify.bias"


@pytest.mark.parametrize(
    ("weights", "card", "parts"),
    [
        ({"encoder.embed.weight": None}, {}, ["lacks", "'encoder.embed.weight'"]),
        ({CLASSIFY: np.zeros(7)}, {}, [CLASSIFY, "(7,)", "(4,)", *VOCABULARY]),
        ({"summary_mean": np.zeros(3)}, {}, ["(3,)", f"({FEATURES},)"]),
        ({"summary_mean": np.full(FEATURES, np.nan)}, {}, ["'summary_mean'", "NaN"]),
        ({"extra": np.zeros(1)}, {}, ["'extra'"]),
        ({}, {"vocabulary": (*VOCABULARY, "pat")}, ["classify.weight", "5 classes"]),
        ({}, {"vocabulary": ("poke", "stroke", "grab", "pat")}, ["poke", "'none'"]),
        ({}, {"vocabulary": ("none", "poke", "poke", "grab")}, ["none, poke, poke"]),
        ({}, {"vocabulary": ()}, ["vocabulary", "empty"]),
        ({}, {"vocabulary": ("none",)}, ["vocabulary", "none"]),
    ],
)
@pytest.mark.parametrize("use", [Network, to_network])
def test_weights_that_do_not_fit_their_card_are_refused(use, weights, card, parts):
    good = model_of(network())
    changed = {name: w for name, w in (good.weights | weights).items() if w is not None}
    with pytest.raises(ModelError) as caught:
        use(Model(changed, replace(good.card, **card)))
    message = str(caught.value)
    assert all(part in message for part in parts), message
    assert "\n" not in message


CLOSING = "graph_head.close.weight"


@pytest.mark.parametrize(
    ("weight", "parts"),
    [
        (np.zeros((4, 7)), [CLOSING, "(4, 7)", "allowed is"]),
        (None, ["lacks", CLOSING]),
        (np.full(1, np.nan), [CLOSING, "(1,)"]),
    ],
)
@pytest.mark.parametrize("use", [Network, to_network])
def test_closing_layer_that_does_not_fit_is_refused(use, weight, parts):
    model = with_closing_layer(model_of(network()))
    use(model)
    changed = dict(model.weights) | {CLOSING: weight}
    if weight is None:
        del changed[CLOSING]
    with pytest.raises(ModelError) as caught:
        use(replace(model, weights=changed))
    message = str(caught.value)
    assert all(part in message for part in parts), message
    assert "\n" not in message


def test_network_with_infinite_weights_is_no_model():
    net = network()
    with torch.no_grad():
        net.graph_head.short.bias[0] = np.inf
    with pytest.raises(ModelError, match=r"graph_head\.short\.bias.*infinity"):
        to_model(net, model_of(net).card)
