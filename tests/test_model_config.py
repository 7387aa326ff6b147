"""Sizes of the network that cannot be are refused, wherever they come from."""

import json

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from eskin.errors import ModelError
from eskin.learn.augment import AugmentConfig
from eskin.model import MIN_SLOTS, NetworkConfig, load_model
from eskin.nn.head import TemporalHead


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("width", 0),
        ("layers", -1),
        ("channels", 0),
        ("dropout", -0.1),
        ("dropout", 1.0),
        ("dropout", float("nan")),
        ("slots", MIN_SLOTS - 1),
    ],
)
def test_a_size_that_no_network_has_is_refused_by_name(entry, value, tmp_path):
    with pytest.raises(ValueError, match=f"{entry} is {value}; allowed is"):
        NetworkConfig(**{entry: value})
    card = {"vocabulary": ["none", "poke"], "network": {entry: value}}
    path = tmp_path / "m.safetensors"
    text = json.dumps(card).replace("NaN", '"NaN"')
    save_file({"w": np.zeros(1, np.float32)}, path, metadata={"eskin": text})
    with pytest.raises(ModelError, match=f"'network'.*{entry} is {value}"):
        load_model(path)


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("gain", -0.1),
        ("gain", float("inf")),
        ("taxel_gain", float("nan")),
        ("dead", 1.1),
        ("offset", -1.0),
        ("shear_gain", float("inf")),
        ("crop", 1.5),
    ],
)
def test_a_variation_that_means_nothing_is_refused_by_name(entry, value):
    with pytest.raises(ValueError, match=f"{entry} is {value}; allowed is"):
        AugmentConfig(**{entry: value})


def test_the_head_needs_the_least_slots_and_no_more():
    head = TemporalHead(3, 2, 4, 0.0)

    def classify(slots):
        return head(torch.zeros(1, slots, 3), torch.ones(1, slots))

    assert classify(MIN_SLOTS).shape == (1, 4)
    with pytest.raises(RuntimeError):
        classify(MIN_SLOTS - 1)
