"""This module reads, writes and checks model files: safetensors with a JSON card."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from eskin.errors import ModelError
from eskin.files import atomic_path, describe_first_error, open_file, shorten
from eskin.live.graph_features import NODE_SCALARS, PRESSURE_SUMMARY, SHEAR_SUMMARY
from eskin.live.model_config import (
    EDGE_SCALARS,
    ESKIN,
    LONG_TAPS,
    SHORT_TAPS,
    ModelCard,
)
from eskin.recording.records import NONE
from eskin.registry import RECOGNISERS, find_plugins

CARD = "eskin"
MODEL_SUFFIX = ".safetensors"
"""End of the name of a model file."""

MODELS = {"ur5": "ur5", "ur5-sim": "ur5", "ur5-groups": "ur5", "ur5-blind": "ur5"}
"""Names that `load_model` knows, each with the preset skin that it was trained on.
`ur5` has learned from simulated and recorded people, `ur5-sim` from simulated ones
alone; `ur5-groups` knows the 12 groups of gestures of SocialTouch; `ur5-blind` does not
use the pose."""
CARD_ADAPTER = TypeAdapter(ModelCard)

MAX_MODEL_BYTES = 64 << 20
"""Largest size of a model file [bytes]."""
MAX_HEADER_BYTES = 1 << 20
"""Largest size of its card and of the table of its parameters [bytes]."""
MAX_WEIGHT = 1e6
"""Largest magnitude of a parameter."""
HEADER_LENGTH = 8
"""Size of the length of the header, at the start of a file [bytes]."""


@dataclass(frozen=True, eq=False)
class Model:
    """A model holds weights and their card."""

    weights: Mapping[str, np.ndarray]
    """Weights by the names of the network's parameters."""
    card: ModelCard
    """Settings and origin of the weights."""

    def __repr__(self) -> str:
        """Describe the model in a line."""
        count = sum(weight.size for weight in self.weights.values())
        return (
            f"<Model of {self.card.kind} with {count:,} weights: "
            f"{', '.join(self.card.vocabulary)}>"
        )

    @property
    def digest(self) -> str:
        """Return the SHA-256 digest of the weights in the order of their names."""
        digest = hashlib.sha256()
        for name in sorted(self.weights):
            digest.update(name.encode() + self.weights[name].tobytes())
        return digest.hexdigest()

    def save(self, path: Path | str) -> None:
        """Write the model file, whole or not at all.

        Args:
            path: path of the file (.safetensors).
        """
        card = CARD_ADAPTER.dump_json(self.card, by_alias=True).decode()
        weights = {name: np.asarray(w, order="C") for name, w in self.weights.items()}
        with atomic_path(Path(path)) as part:
            save_file(weights, part, metadata={CARD: card})


def load_model(name_or_path: str | Path) -> Model:
    """Read a model that comes with eskin, or a model file.

    Args:
        name_or_path: one of `MODELS`, or the path of a `.safetensors` file.

    Raises:
        ModelError: if it is missing, damaged, not a model of eskin, or of a recogniser
            that no installed package registers.
    """
    path = Path(name_or_path)
    if str(name_or_path) in MODELS:
        presets = resources.files("eskin.live") / "presets"
        path = Path(str(presets / f"{path}{MODEL_SUFFIX}"))
    if path.is_dir():
        raise ModelError(
            f"{path} is a folder, and no model file; allowed are {', '.join(MODELS)} "
            "and .safetensors files; name the model here, and recordings elsewhere"
        )
    try:
        check_size(path)
        with safe_open(path, framework="numpy") as file:
            card = read_card((file.metadata() or {}).get(CARD), path)
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        for name, weight in weights.items():
            if weight.dtype.kind == "V":  # a type of another package, not of numpy
                raise TypeError(f"{name} is of {weight.dtype}")
    except FileNotFoundError:
        raise ModelError(
            f"{path}: no such model; allowed are {', '.join(MODELS)} and files; train "
            f"one with: eskin train DATA --out {path}"
        ) from None
    # A TypeError is raised for numbers that numpy does not have, such as bfloat16.
    except (SafetensorError, OSError, TypeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise ModelError(
            f"{path} is no model file ({reason}); allowed is a .safetensors file "
            "written by eskin train; train it again"
        ) from None
    check_recogniser(card.recogniser)
    return Model(weights, card)


def check_size(path: Path) -> None:
    """Raise an OSError or ModelError where a file is too large, or no regular file."""
    with open_file(path, MAX_MODEL_BYTES) as file:
        length = int.from_bytes(file.read(HEADER_LENGTH), "little")
    # The size of the file bounds the parameters, whatever shapes the header states.
    if MAX_HEADER_BYTES < length <= path.stat().st_size:
        raise ModelError(
            f"{path} has a header of {length:,} bytes; allowed are "
            f"{MAX_HEADER_BYTES:,}; train it again"
        )


def read_card(text: str | None, path: Path) -> ModelCard:
    """Parse a card and check its limits; an error names the entry that is wrong."""
    if text is None:
        raise ModelError(
            f"{path} has no card '{CARD}' in its metadata; allowed are models written "
            "by eskin train; train it again"
        )
    try:
        return CARD_ADAPTER.validate_json(text)
    except ValidationError as error:
        raise ModelError(
            f"{path}: its card: {describe_first_error(error)}; train the model again "
            "with this version of eskin"
        ) from None


def check_recogniser(name: str) -> None:
    """Refuse the name of a recogniser that no installed package registers.

    Raises:
        ModelError: naming the package to install.
    """
    if name == ESKIN:
        return
    found = find_plugins(RECOGNISERS)
    if name not in found:
        raise ModelError(
            f"model is of recogniser {shorten(name)}, which is not installed; allowed "
            f"are {', '.join(found)}; install the package of that name, if you trust it"
        )


OPEN_LAYER = "classify"
"""Name of the last layer of a head, which answers while a touch is open."""
CLOSING_LAYER = "close"
"""Name of the layer that a head may have beside it, fitted on windows that end with
their touches: it answers for a touch that closes."""

Shapes = dict[str, tuple[int, ...]]
Weights = dict[str, np.ndarray]


def network_shapes(card: ModelCard) -> Shapes:
    """Return the shape of every parameter of the network, by its name."""
    config = card.network
    classes = len(card.vocabulary)
    features = len(PRESSURE_SUMMARY)
    if card.kind == "shear":
        features += len(SHEAR_SUMMARY)
    shapes: Shapes = {"summary_mean": (features,), "summary_scale": (features,)}
    shapes |= prefix_names(
        "summary_head", head_shapes(features, config.channels, classes)
    )
    if config.width:
        both = features + 2 * config.width
        encoder = encoder_shapes(config.width, config.layers)
        shapes |= prefix_names("encoder", encoder)
        head = head_shapes(both, config.channels, classes)
        shapes |= prefix_names("graph_head", head)
    return shapes


def closing_shapes(card: ModelCard) -> Shapes:
    """Return the shapes of the closing layer, which a network may lack."""
    return {
        name.replace(f".{OPEN_LAYER}.", f".{CLOSING_LAYER}."): shape
        for name, shape in network_shapes(card).items()
        if f".{OPEN_LAYER}." in name
    }


def encoder_shapes(width: int, layers: int) -> Shapes:
    """Return the shapes of `eskin.learn.nn.Encoder`."""
    shapes = {
        **linear_shapes("embed", len(NODE_SCALARS), width),
        **norm_shapes("norm", 2 * width),
    }
    for n in range(layers):
        shapes |= prefix_names(f"layers.{n}", layer_shapes(width, last=n == layers - 1))
    return shapes


def layer_shapes(width: int, last: bool) -> Shapes:
    """Return the shapes of `eskin.learn.nn.EquivariantLayer`."""
    return {
        **norm_shapes("norm", width),
        **linear_shapes("of_target", width, width),
        **linear_shapes("of_source", width, width, bias=False),
        **linear_shapes("of_edge", EDGE_SCALARS, width, bias=False),
        **linear_shapes("message", width, width),
        **({} if last else linear_shapes("move", width, 1, bias=False)),
        **linear_shapes("update_hidden", 2 * width, width),
        **linear_shapes("update_out", width, width),
    }


def head_shapes(inputs: int, channels: int, classes: int) -> Shapes:
    """Return the shapes of `eskin.learn.nn.TemporalHead`."""
    return {
        **linear_shapes("project", inputs, channels),
        "short.conv.weight": (channels, channels, SHORT_TAPS),
        "short.bias": (channels,),
        "long.conv.weight": (channels, channels, LONG_TAPS),
        "long.bias": (channels,),
        **linear_shapes("classify", 12 * channels, classes),
    }


def prefix_names(name: str, shapes: Shapes) -> Shapes:
    """Return the shapes of a submodule, by their names in the whole network."""
    return {f"{name}.{key}": shape for key, shape in shapes.items()}


def linear_shapes(name: str, inputs: int, outputs: int, bias: bool = True) -> Shapes:
    """Return the shapes of a linear layer."""
    weight: Shapes = {f"{name}.weight": (outputs, inputs)}
    return weight | {f"{name}.bias": (outputs,)} if bias else weight


def norm_shapes(name: str, size: int) -> Shapes:
    """Return the shapes of the scale and shift of a normalisation."""
    return {f"{name}.weight": (size,), f"{name}.bias": (size,)}


def check_weights(model: Model) -> Weights:
    """Return the weights of eskin's own network in float32, if they fit the card.

    Raises:
        ModelError: the weights are of another recogniser, or do not fit.
    """
    name = model.card.recogniser
    if name != ESKIN:
        raise ModelError(
            f"model is of recogniser {shorten(name)}; allowed here are models of "
            "eskin's own; give one that eskin train has written"
        )
    shapes = network_shapes(model.card)
    if has_closing_layer(model.weights):
        shapes |= closing_shapes(model.card)
    return check_parameters(model, shapes)


def has_closing_layer(weights: Mapping[str, np.ndarray]) -> bool:
    """Tell whether there are weights of a closing layer."""
    return any(f".{CLOSING_LAYER}." in name for name in weights)


def check_parameters(model: Model, shapes: Shapes) -> Weights:
    """Return the weights in float32, if they have the shapes that a network needs.

    Args:
        model: weights and their card.
        shapes: shape of every parameter, by its name.

    Raises:
        ModelError: naming the first parameter that does not fit, or a vocabulary that
            is not of different gestures and `none`.
    """
    names = model.card.vocabulary
    if NONE not in names or len(set(names)) < max(len(names), 2):
        raise ModelError(
            f"model's vocabulary is {', '.join(names) or 'empty'}; allowed are "
            f"different gestures and '{NONE}'; train it again"
        )
    for name, shape in shapes.items():
        check_parameter(model, name, shape)
    unknown = sorted(set(model.weights) - set(shapes))
    if unknown:
        raise ModelError(
            f"model has a parameter '{unknown[0]}' that its card does not have; "
            f"allowed are {len(shapes)} such as '{next(iter(shapes))}'; train it again "
            "with this version of eskin"
        )
    return {name: weight.astype(np.float32) for name, weight in model.weights.items()}


def check_parameter(model: Model, name: str, shape: tuple[int, ...]) -> None:
    """Refuse a parameter that is missing, of another shape, not finite, or huge."""
    weight = model.weights.get(name)
    if weight is None:
        raise ModelError(
            f"model lacks parameter '{name}' of shape {shape}; allowed are all of its "
            "card's network; train it again with this version of eskin"
        )
    if weight.shape != shape:
        vocabulary = ", ".join(model.card.vocabulary)
        raise ModelError(
            f"model's parameter '{name}' has shape {weight.shape}; allowed is {shape} "
            f"for its card's network and its {len(model.card.vocabulary)} classes "
            f"({vocabulary}); train it again with this version of eskin"
        )
    if not (np.abs(weight) <= MAX_WEIGHT).all():
        raise ModelError(
            f"model's parameter '{name}' holds NaN, infinity or a huge number; allowed "
            f"are numbers up to {MAX_WEIGHT:g}; train it again, with a lower rate"
        )
