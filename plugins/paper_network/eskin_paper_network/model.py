"""This module writes and reads model files of the paper's network."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import torch
from annotated_types import Interval
from pydantic import ConfigDict, TypeAdapter, ValidationError

from eskin.errors import ModelError
from eskin.files import describe_first_error
from eskin.live import Model, ModelCard, check_parameters
from eskin.recording import NONE
from eskin.skin import MountedSkin
from eskin_paper_network.neighbours import Distance
from eskin_paper_network.network import PaperNetwork, Pooling

RECOGNISER = "eskin-paper-network"
"""Name of this package, by which model files name their recogniser."""


@dataclass(frozen=True)
class PaperSettings:
    """These settings determine the network of a model file."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    k: Annotated[int, Interval(ge=1, le=64)] = 8
    """Number of neighbours of a taxel inside its patch."""
    pooling: Pooling = "max"
    """Pooling over the nodes of a reading."""
    distance: Distance = "kinematic"
    """Distance between taxels."""
    stride: Literal[1, 2, 4] = 1
    """Of so many readings of a window one is used; the window has 100 at 50 Hz."""
    knows_none: bool = False
    """Whether `none` is a class of the network; without it, its probability is 0."""


SETTINGS_ADAPTER = TypeAdapter(PaperSettings)


def save_paper_model(
    path: Path,
    network: PaperNetwork,
    vocabulary: tuple[str, ...],
    **entries: Any,  # noqa: ANN401
) -> Model:
    """Write a model file of a trained network, and return the model.

    Args:
        path: path of the file (.safetensors).
        network: the network.
        vocabulary: its classes, in the order of its logits.
        entries: further entries of the card, such as `decision` or `metrics`.
    """
    knows_none = NONE in vocabulary
    settings = PaperSettings(
        network.k, network.pooling, network.distance, network.stride, knows_none
    )
    card = ModelCard(
        vocabulary if knows_none else (NONE, *vocabulary),
        recogniser=RECOGNISER,
        settings=asdict(settings),
        **entries,
    )
    parameters = network.named_parameters()
    weights = {name: weight.detach().numpy() for name, weight in parameters}
    model = Model(weights, card)
    model.save(path)
    return model


def read_settings(card: ModelCard) -> PaperSettings:
    """Return the settings of a card, if they are within their limits.

    Raises:
        ModelError: naming the first that is not.
    """
    try:
        return SETTINGS_ADAPTER.validate_python(card.settings)
    except ValidationError as error:
        raise ModelError(
            f"model's settings: {describe_first_error(error)}; train it again with "
            f"this version of {RECOGNISER}"
        ) from None


def load_network(model: Model, mounted: MountedSkin) -> PaperNetwork:
    """Build the network of a model for a skin on its robot.

    Raises:
        ModelError: the card or the weights do not fit.
    """
    settings = read_settings(model.card)
    classes = len(model.card.vocabulary) - (not settings.knows_none)
    network = PaperNetwork(
        mounted,
        classes,
        settings.k,
        settings.pooling,
        settings.distance,
        settings.stride,
    )
    shapes = {name: tuple(w.shape) for name, w in network.named_parameters()}
    weights = check_parameters(model, shapes)
    network.load_state_dict(
        {name: torch.from_numpy(weight) for name, weight in weights.items()},
        strict=False,
    )
    return network.eval()
