"""This module defines the settings that a model file keeps beside its weights."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from eskin.graph import GraphConfig
from eskin.touch import PipelineConfig

Limits = Mapping[str, tuple[int | float, int | float]]
"""Smallest and largest value of each setting; infinite where there is no largest."""


def check_limits(settings: object, limits: Limits) -> None:
    """Refuse numbers that mean nothing.

    Raises:
        ValueError: naming the first setting that is not finite or not within.
    """
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if not (np.isfinite(value) and low <= value <= high):
            allowed = f"{low:g} to {high:g}" if high < np.inf else f"from {low:g}"
            raise ValueError(f"{name} is {value}; allowed is {allowed}; change it")


@dataclass(frozen=True)
class DecisionConfig:
    """How sure is sure."""

    threshold: float = 0.8
    """Probability from which a gesture is said while the touch goes on."""

    thresholds: Mapping[str, float] = field(default_factory=dict)
    """The same for single gestures, in place of `threshold`; above 1 waits for the
    touch to close."""

    lifted: float = 1.1
    """The same once there has been no contact for `lift_seconds`, where that is less:
    most of what there is to know of a touch is known then."""

    lift_seconds: float = 0.2
    """How long that is [s]; a second pat may still come."""

    hold_seconds: float = 0.06
    """How long it must stay above, and on a skin that is not calibrated how long
    another class must be likeliest until that is another touch [s]."""

    least: float = 0.3
    """Probability below which a touch that closes is unknown; 0 never abstains."""

    still: float = 0.02
    """Travel below which a touch has no direction [m]."""


SLOT_NS = 20_000_000
"""One slot of the temporal head's clock: 20 ms."""

LENGTH_CM = 3.0
"""Unit of length inside the encoder [cm]: about a contact's size, and well above the
spacing of taxels, so that a denser skin looks nearly alike."""

LEAST_SLOTS = 25
"""What the head's two convolutions need: 5 taps, each 4 slots on, of 9 slots."""

LIMITS = {
    "width": (1, np.inf),
    "layers": (0, np.inf),
    "channels": (1, np.inf),
    "dropout": (0.0, 0.9),
    "slots": (LEAST_SLOTS, np.inf),
}
"""Smallest and largest values of the settings."""


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the recogniser's network."""

    width: int = 8
    """Channels of a node."""

    layers: int = 2
    """Equivariant layers."""

    channels: int = 32
    """Channels of the temporal head."""

    dropout: float = 0.3
    """Share of features left out while training."""

    slots: int = 100
    """Slots of 20 ms that the head looks back: 2 s."""

    def __post_init__(self) -> None:
        """Refuse sizes that no network has."""
        check_limits(self, LIMITS)


FORMAT = "eskin-model-1"


@dataclass(frozen=True)
class ModelCard:
    """Everything beside the weights that recognition depends on, and their origin."""

    vocabulary: tuple[str, ...]
    """Classes in the order of the logits; `none` is one of them."""

    kind: Literal["pressure", "shear"] = "pressure"
    """What the skin must measure."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the network."""

    graph: GraphConfig = field(default_factory=GraphConfig)
    """How contacts become graphs."""

    pipeline: PipelineConfig = field(default_factory=PipelineConfig)
    """How counts become contacts."""

    decision: DecisionConfig = field(default_factory=DecisionConfig)
    """When it is sure enough to speak."""

    temperature: float = 1.0
    """Divides the logits, so that probabilities are calibrated."""

    training: dict[str, str] = field(default_factory=dict)
    """The training configuration, as text."""

    data_digest: str = ""
    """SHA-256 of the recordings trained on."""

    metrics: dict[str, float] = field(default_factory=dict)
    """What was measured at the end of training."""

    format: Literal["eskin-model-1"] = FORMAT
    """Version of this card."""

    @property
    def graph_used(self) -> GraphConfig:
        """The graphs that the network takes: a model for pressure knows no shear."""
        return self.graph if self.kind == "shear" else self.graph.without_shear()
