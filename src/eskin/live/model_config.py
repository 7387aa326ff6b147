"""This module defines the settings that a model file holds beside its weights."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_type_hints

import numpy as np
from annotated_types import Interval, MaxLen
from pydantic import AfterValidator, ConfigDict, Field

from eskin.files import Name, NotNegative, Pause, Share
from eskin.live.graph_builder import GraphConfig
from eskin.recording.records import check_gesture_names
from eskin.touch import PipelineConfig

Limits = Mapping[str, tuple[Any, Any]]
"""Smallest and largest value of each setting; infinite where there is no largest."""


def check_limits(
    settings: object, limits: Limits | None = None, prefix: str = ""
) -> None:
    """Refuse settings outside their limits.

    Args:
        settings: object whose attributes they are.
        limits: smallest and largest value of each, by its name; None for those in the
            types of a dataclass, each an `Interval`.
        prefix: what stands before the name in a message, `--` for options.

    Raises:
        ValueError: naming the first setting that is not finite or not within.
    """
    limits = read_limits(type(settings)) if limits is None else limits
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if not (low <= value <= high and value != np.inf):
            allowed = f"{low:g} to {high:g}" if high < np.inf else f"from {low:g}"
            raise ValueError(f"{prefix}{name} is {value!s:.40}; allowed is {allowed}")


@cache
def read_limits(kind: type) -> Limits:
    """Return the limits of the fields of a dataclass that have some in their types."""
    return {
        name: (part.ge, part.le)
        for name, hint in get_type_hints(kind, include_extras=True).items()
        for part in getattr(hint, "__metadata__", ())
        if isinstance(part, Interval)
    }


Entries = TypeVar("Entries")
Few = Annotated[Entries, MaxLen(1000)]
"""Entries of a card of which there may not be many."""


def check_vocabulary(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the classes of a model, which have names that gestures may have."""
    check_gesture_names(names)
    return names


@dataclass(frozen=True)
class DecisionConfig:
    """These settings determine when a gesture is reported."""

    threshold: NotNegative = 0.8
    """Probability from which a gesture is reported while the touch is open."""
    thresholds: Few[Mapping[str, NotNegative]] = field(default_factory=dict)
    """Thresholds of single gestures, in place of `threshold`; above 1 waits for the
    touch to close."""
    lifted: NotNegative = 1.1
    """Threshold once there has been no contact for `lift_seconds`, if it is lower: most
    of the touch has been seen by then."""
    lift_seconds: Pause = 0.2
    """Time without contact after which `lifted` applies [s]; a second pat may still
    come."""
    dwell_seconds: Annotated[Pause, Field(alias="hold_seconds")] = 0.06
    """Time that a probability must stay above its threshold; on a skin that is not
    calibrated also the time that another class must be likeliest to count as another
    touch [s]."""
    brief_seconds: Pause = 0.3
    """Time from first to latest contact up to which a touch may be the first of several
    pats, and waits for its closing [s]."""
    least: NotNegative = 0.3
    """Probability below which a touch is unknown when it closes; 0 never abstains."""
    deliberate: Share = 0.0
    """Probability that it is any gesture at all, instead of `none`, below which a touch
    whose likeliest class is a gesture is unknown when it closes."""
    min_travel: Annotated[float, Interval(ge=0.0, le=10.0), Field(alias="still")] = 0.02
    """Travel from which a touch has a direction [m]."""


SLOT_NS = 20_000_000
"""One slot of the temporal head's clock: 20 ms."""

LENGTH_CM = 3.0
"""Unit of length inside the encoder [cm]: about a contact's size, and well above the
spacing of taxels, so that a denser skin looks nearly alike."""

MIN_SLOTS = 25
"""Slots that the head's two convolutions need: 5 taps, 4 slots apart, of 9 slots."""

MAX_DEVIATIONS = 4.0
"""Standard deviations from the mean at which summary features are clipped."""

EDGE_SCALARS = 6
"""Number of invariants of an edge."""

SHORT_TAPS = 9
LONG_TAPS = 5
"""Taps of the head's two convolutions."""

SHORT_STRIDE = 4
LONG_STRIDE = 2
"""Strides of the two convolutions, each in steps of its own input."""


@dataclass(frozen=True)
class NetworkConfig:
    """These settings determine the size of the recogniser's network."""

    width: Annotated[int, Interval(ge=0, le=256)] = 8
    """Number of channels of a node; without any, the summary alone is classified."""
    layers: Annotated[int, Interval(ge=0, le=16)] = 2
    """Number of equivariant layers."""
    channels: Annotated[int, Interval(ge=1, le=256)] = 32
    """Number of channels of a temporal head."""
    dropout: Annotated[float, Interval(ge=0.0, le=0.9)] = 0.3
    """Share of features dropped in training."""
    slots: Annotated[int, Interval(ge=MIN_SLOTS, le=1000)] = 100
    """Number of slots of 20 ms in a window; 100 are 2 s."""

    def __post_init__(self) -> None:
        """Refuse sizes outside their limits."""
        check_limits(self)


FORMAT = "eskin-model-1"
ESKIN = "eskin"
"""Name of the recogniser that comes with eskin."""


@dataclass(frozen=True)
class ModelCard:
    """A card holds the settings of recognition and the origin of the weights."""

    # A metric may be NaN, for which JSON has no number.
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(ser_json_inf_nan="strings")

    vocabulary: Annotated[Few[tuple[str, ...]], AfterValidator(check_vocabulary)]
    """Classes in the order of the logits; `none` is one of them."""
    kind: Literal["pressure", "shear"] = "pressure"
    """Quantity that the skin must measure."""
    recogniser: Name = ESKIN
    """Recogniser that the weights are of: the package that registers it."""
    settings: Few[dict[str, bool | int | float | str]] = field(default_factory=dict)
    """Settings of a recogniser of another package, which checks them."""
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Size of the network of eskin."""
    graph: GraphConfig = field(default_factory=GraphConfig)
    """Settings of the contact graphs."""
    pipeline: PipelineConfig = field(default_factory=PipelineConfig)
    """Settings of the pipeline from counts to contacts."""
    decision: DecisionConfig = field(default_factory=DecisionConfig)
    """Settings that determine when a gesture is reported."""
    temperature: Annotated[float, Interval(ge=0.01, le=100.0)] = 1.0
    """Divisor of the logits that calibrates the probabilities."""
    training: Few[dict[str, str]] = field(default_factory=dict)
    """The training configuration, as text."""
    data_digest: str = ""
    """SHA-256 of the recordings trained on."""
    metrics: Few[dict[str, float]] = field(default_factory=dict)
    """Metrics measured at the end of training."""
    format: Literal["eskin-model-1"] = FORMAT
    """Version of this card."""

    @property
    def graph_used(self) -> GraphConfig:
        """Settings of the graphs that the network takes.

        They are without shear for pressure, and without neighbours for a summary.
        """
        return self.graph.restrict(self.kind == "shear", self.network.width > 0)
