"""Model files: written whole, read back bit for bit, refused in one line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import save_file
from safetensors.torch import save_file as save_torch

from eskin.errors import ModelError
from eskin.graph import PRESSURE_SUMMARY, GraphConfig
from eskin.learn.checkpoint import to_model, to_network
from eskin.model import (
    DecisionConfig,
    Model,
    ModelCard,
    NetworkConfig,
    load_model,
    save_model,
)
from eskin.touch import ContactConfig, PipelineConfig
from helpers.graphs import logits, press_on_seam
from helpers.live import model_of, network

FEATURES = len(PRESSURE_SUMMARY)
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


def model() -> Model:
    rng = np.random.default_rng(0)
    weights = {
        "float32": rng.normal(size=(3, 4)).astype(np.float32),
        "float64": rng.normal(size=5),
        "turned": rng.normal(size=(3, 4)).astype(np.float32).T,
        "odd": np.array([np.nan, np.inf, -0.0, 1e-45], np.float32),
        "single": np.array(2.5, np.float32),
        "none": np.zeros((0, 3), np.float32),
        "whole": np.arange(4),
    }
    return Model(weights, CARD)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "model.safetensors"


def assert_equal_models(one: Model, other: Model) -> None:
    assert one.card == other.card
    assert set(one.weights) == set(other.weights)
    for name, weight in one.weights.items():
        found = other.weights[name]
        assert (found.dtype, found.shape) == (weight.dtype, weight.shape), name
        assert found.tobytes() == weight.tobytes(), name


def test_what_is_read_is_what_was_written_bit_for_bit(path):
    save_model(path, model())
    assert_equal_models(load_model(path), model())
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_the_same_model_makes_the_same_bytes(path):
    save_model(path, model())
    before = path.read_bytes()
    save_model(path, load_model(path))
    assert path.read_bytes() == before


def test_a_metric_that_is_no_number_does_not_make_the_model_unreadable(path):
    save_model(path, replace(model(), card=replace(CARD, metrics={"f1": np.nan})))
    assert np.isnan(load_model(path).card.metrics["f1"])
    with safe_open(path, framework="numpy") as file:
        card = file.metadata()["eskin"]
    assert json.loads(card, parse_constant=pytest.fail)["metrics"] == {"f1": "NaN"}


def test_folders_on_the_way_are_made(tmp_path):
    save_model(tmp_path / "a" / "b" / "m.safetensors", model())
    assert_equal_models(load_model(tmp_path / "a" / "b" / "m.safetensors"), model())


@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_a_network_read_from_a_file_gives_the_same_logits_to_the_last_bit(path, kind):
    net = network(kind, width=8, channels=8)
    card = ModelCard(("none", "a", "b", "c"), kind=kind, network=net.config)
    save_model(path, to_model(net, card))
    again = to_network(load_model(path))
    batch = press_on_seam(shear=True).graphs()
    assert np.array_equal(logits(again, batch), logits(net, batch))


def refusal(path) -> str:
    """The one line that says why a file is no model."""
    with pytest.raises(ModelError) as caught:
        load_model(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert len(message) < 600
    return message


def test_a_missing_file_is_named_with_the_way_to_make_one(path):
    assert "no such model; " in refusal(path)
    assert "train one with: eskin train DATA" in refusal(path)


def test_a_folder_is_no_model(tmp_path):
    assert "is a folder, and no model file; allowed are ur5" in refusal(tmp_path)


def test_a_file_cut_anywhere_is_refused(path):
    save_model(path, model())
    whole = path.read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    for length in (0, 1, 7, 8, 9, header // 2, header, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert "is no model file" in refusal(path)


def test_a_damaged_header_is_refused(path):
    save_model(path, model())
    whole = path.read_bytes()
    for place in (0, 8, 20):
        path.write_bytes(whole[:place] + b"\xff\x00\xff" + whole[place + 3 :])
        refusal(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no\nmodel\nat all\n" * 99])
def test_a_file_of_another_kind_is_refused(path, content):
    path.write_bytes(content)
    assert "is no model file" in refusal(path)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_safetensors_of_others_are_refused_for_want_of_a_card(path, dtype):
    for metadata in (None, {"format": "pt"}):
        save_torch({"w": torch.zeros(2, 2, dtype=dtype)}, path, metadata=metadata)
        assert "has no card 'eskin'; allowed" in refusal(path).replace(
            " in its metadata", ""
        )


def test_weights_of_numbers_that_numpy_does_not_have_are_refused(path):
    save_model(path, model())
    card = json.dumps({"vocabulary": ["none", "poke"]})
    weights = {"w": torch.zeros(2, dtype=torch.bfloat16)}
    save_torch(weights, path, metadata={"eskin": card})
    assert "is no model file (" in refusal(path)


def with_card(path, text: str) -> None:
    save_file({"w": np.zeros(2, np.float32)}, path, metadata={"eskin": text})


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"vocabulary": None}, "card entry 'vocabulary' is None"),
        ({"kind": "warmth"}, "card entry 'kind' is 'warmth'"),
        ({"format": "eskin-model-2"}, "card entry 'format' is 'eskin-model-2'"),
        ({"temperature": "warm"}, "card entry 'temperature' is 'warm'"),
        ({"network": {"width": "wide"}}, "card entry 'network.width' is 'wide'"),
        ({"graph": {"live": 1.5}}, "card entry 'graph.live' is 1.5"),
        (
            {"pipeline": {"contacts": {"on": []}}},
            r"card entry 'pipeline.contacts.on' is \[\]",
        ),
        ({"metrics": {"f1": None}}, "card entry 'metrics.f1' is None"),
    ],
)
def test_a_wrong_card_entry_is_named_by_its_place(path, entries, message):
    with_card(path, json.dumps({"vocabulary": ["none", "poke"], **entries}))
    with pytest.raises(ModelError, match=message):
        load_model(path)
    assert "train the model again" in refusal(path)


@pytest.mark.parametrize("text", ["", "{oops", "[]", '"card"', "{", "null", "x" * 9999])
def test_a_card_that_is_no_card_is_refused(path, text):
    with_card(path, text)
    assert "its card is" in refusal(path)


def test_entries_that_a_card_leaves_out_have_their_defaults(path):
    with_card(path, '{"vocabulary": ["none", "poke"]}')
    assert load_model(path).card == ModelCard(("none", "poke"))


def test_a_failed_save_leaves_the_old_model_and_nothing_else(path, monkeypatch):
    save_model(path, model())
    before = path.read_bytes()

    def fail(*_):
        raise OSError("no space left")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="no space"):
        save_model(path, replace(model(), card=replace(CARD, temperature=2.0)))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_a_save_that_breaks_off_leaves_nothing(path, monkeypatch):
    def half(weights, part, metadata):
        part.write_bytes(b"half a model")
        raise KeyboardInterrupt

    monkeypatch.setattr("eskin.model.file.save_file", half)
    with pytest.raises(KeyboardInterrupt):
        save_model(path, model())
    assert list(path.parent.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "weight", "message"),
    [
        (
            "summary_scale",
            np.full(FEATURES, np.nan, np.float32),
            "holds NaN or infinity",
        ),
        ("extra", np.zeros(1, np.float32), "a parameter 'extra'"),
        ("summary_mean", np.zeros(3, np.float32), rf"allowed is \({FEATURES},\)"),
    ],
)
def test_training_and_scoring_take_only_weights_that_fit_their_card(
    name, weight, message
):
    good = model_of(network())
    broken = replace(good, weights={**good.weights, name: weight})
    with pytest.raises(ModelError, match=message):
        to_network(broken)
    card = replace(good.card, vocabulary=("none", "poke", "poke", "grab"))
    with pytest.raises(ModelError, match="vocabulary is none, poke, poke"):
        to_network(replace(good, card=card))
    spoiled = network()
    with torch.no_grad():
        spoiled.graph_head.short.bias[0] = np.inf
    with pytest.raises(ModelError, match="holds NaN or infinity"):
        to_model(spoiled, good.card)
