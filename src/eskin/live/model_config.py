"""This module defines the settings that a model file holds beside its weights."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from eskin.files import Name
from eskin.live.graph_builder import GraphConfig
from eskin.touch import PipelineConfig

Limits = Mapping[str, tuple[int | float, int | float]]
"""Smallest and largest value of each setting; infinite where there is no largest."""


def check_limits(settings: object, limits: Limits, prefix: str = "") -> None:
    """Refuse settings outside their limits.

    Args:
        settings: object whose attributes they are.
        limits: smallest and largest value of each, by its name.
        prefix: what stands before the name in a message, `--` for options.

    Raises:
        ValueError: naming the first setting that is not finite or not within.
    """
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if not (low <= value <= high and value != np.inf):
            allowed = f"{low:g} to {high:g}" if high < np.inf else f"from {low:g}"
            raise ValueError(
                f"{prefix}{name} is {value!s:.40}; allowed is {allowed}; change it"
            )


@dataclass(frozen=True)
class DecisionConfig:
    """These settings determine when a gesture is reported."""

    threshold: float = 0.8
    """Probability from which a gesture is reported while the touch is open."""
    thresholds: Mapping[str, float] = field(default_factory=dict)
    """Thresholds of single gestures, in place of `threshold`; above 1 waits for the
    touch to close."""
    lifted: float = 1.1
    """Threshold once there has been no contact for `lift_seconds`, if it is lower: most
    of the evidence has been seen by then."""
    lift_seconds: float = 0.2
    """Time without contact after which `lifted` applies [s]; a second pat may still
    come."""
    hold_seconds: float = 0.06
    """Time that a probability must stay above its threshold; on a skin that is not
    calibrated also the time that another class must be likeliest to count as another
    touch [s]."""
    least: float = 0.3
    """Probability below which a touch is unknown when it closes; 0 never abstains."""
    still: float = 0.02
    """Travel below which a touch has no direction [m]."""


SLOT_NS = 20_000_000
"""One slot of the temporal head's clock: 20 ms."""

LENGTH_CM = 3.0
"""Unit of length inside the encoder [cm]: about a contact's size, and well above the
spacing of taxels, so that a denser skin looks nearly alike."""

MIN_SLOTS = 25
"""Slots that the head's two convolutions need: 5 taps, 4 slots apart, of 9 slots."""

MAX_DEVIATIONS = 4.0
"""Standard deviations from the mean at which summary features are clipped."""

LIMITS = {
    "width": (0, np.inf),
    "layers": (0, np.inf),
    "channels": (1, np.inf),
    "dropout": (0.0, 0.9),
    "slots": (MIN_SLOTS, np.inf),
}
"""Smallest and largest values of the settings of `NetworkConfig`."""


@dataclass(frozen=True)
class NetworkConfig:
    """These settings determine the size of the recogniser's network."""

    width: int = 8
    """Number of channels of a node; without any, the summary alone is classified."""
    layers: int = 2
    """Number of equivariant layers."""
    channels: int = 32
    """Number of channels of a temporal head."""
    dropout: float = 0.3
    """Share of features dropped in training."""
    slots: int = 100
    """Number of slots of 20 ms in a window; 100 are 2 s."""

    def __post_init__(self) -> None:
        """Refuse sizes outside `LIMITS`."""
        check_limits(self, LIMITS)


FORMAT = "eskin-model-1"


@dataclass(frozen=True)
class ModelCard:
    """A card holds the settings of recognition and the origin of the weights."""

    vocabulary: tuple[Name, ...]
    """Classes in the order of the logits; `none` is one of them."""
    kind: Literal["pressure", "shear"] = "pressure"
    """Quantity that the skin must measure."""
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Size of the network."""
    graph: GraphConfig = field(default_factory=GraphConfig)
    """Settings of the contact graphs."""
    pipeline: PipelineConfig = field(default_factory=PipelineConfig)
    """Settings of the pipeline from counts to contacts."""
    decision: DecisionConfig = field(default_factory=DecisionConfig)
    """Settings that determine when a gesture is reported."""
    temperature: float = 1.0
    """Divisor of the logits that calibrates the probabilities."""
    training: dict[str, str] = field(default_factory=dict)
    """The training configuration, as text."""
    data_digest: str = ""
    """SHA-256 of the recordings trained on."""
    metrics: dict[str, float] = field(default_factory=dict)
    """Metrics measured at the end of training."""
    format: Literal["eskin-model-1"] = FORMAT
    """Version of this card."""

    @property
    def graph_used(self) -> GraphConfig:
        """Settings of the graphs that the network takes.

        They are without shear for pressure, and without neighbours for a summary.
        """
        return self.graph.restrict(self.kind == "shear", self.network.width > 0)
