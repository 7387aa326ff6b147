"""A model's weights, held to the shapes that its card implies."""

import numpy as np

from eskin.errors import ModelError
from eskin.graph import NODE_SCALARS, PRESSURE_SUMMARY, SHEAR_SUMMARY
from eskin.model.card import ModelCard
from eskin.model.file import Model
from eskin.recording.labels import NONE

EDGE_SCALARS = 6
SHORT, LONG = 9, 5  # taps of the head's two convolutions

Shapes = dict[str, tuple[int, ...]]
Weights = dict[str, np.ndarray]


def network_shapes(card: ModelCard) -> Shapes:
    """The shape of every parameter of the network, by its name in `eskin.nn`."""
    config, classes = card.network, len(card.vocabulary)
    features = len(PRESSURE_SUMMARY)
    if card.kind == "shear":
        features += len(SHEAR_SUMMARY)
    both = features + 2 * config.width
    return {
        "summary_mean": (features,),
        "summary_scale": (features,),
        **within("encoder", encoder_shapes(config.width, config.layers)),
        **within("summary_head", head_shapes(features, config.channels, classes)),
        **within("graph_head", head_shapes(both, config.channels, classes)),
    }


def encoder_shapes(width: int, layers: int) -> Shapes:
    """Shapes of `eskin.nn.Encoder`."""
    shapes = {
        **linear("embed", len(NODE_SCALARS), width),
        **vectors("norm", 2 * width),
    }
    for n in range(layers):
        shapes |= within(f"layers.{n}", layer_shapes(width, last=n == layers - 1))
    return shapes


def layer_shapes(width: int, last: bool) -> Shapes:
    """Shapes of `eskin.nn.EquivariantLayer`."""
    return {
        **vectors("norm", width),
        **linear("of_target", width, width),
        **linear("of_source", width, width, bias=False),
        **linear("of_edge", EDGE_SCALARS, width, bias=False),
        **linear("message", width, width),
        **({} if last else linear("move", width, 1, bias=False)),
        **linear("update_hidden", 2 * width, width),
        **linear("update_out", width, width),
    }


def head_shapes(inputs: int, channels: int, classes: int) -> Shapes:
    """Shapes of `eskin.nn.TemporalHead`."""
    return {
        **linear("project", inputs, channels),
        "short.conv.weight": (channels, channels, SHORT),
        "short.bias": (channels,),
        "long.conv.weight": (channels, channels, LONG),
        "long.bias": (channels,),
        **linear("classify", 12 * channels, classes),
    }


def within(name: str, shapes: Shapes) -> Shapes:
    """Shapes of a part, by their names in the whole."""
    return {f"{name}.{key}": shape for key, shape in shapes.items()}


def linear(name: str, inputs: int, outputs: int, bias: bool = True) -> Shapes:
    """Shapes of a linear layer."""
    weight: Shapes = {f"{name}.weight": (outputs, inputs)}
    return weight | {f"{name}.bias": (outputs,)} if bias else weight


def vectors(name: str, size: int) -> Shapes:
    """Shapes of a normalisation's scale and shift."""
    return {f"{name}.weight": (size,), f"{name}.bias": (size,)}


def checked_weights(model: Model) -> Weights:
    """The weights in float32, once they have been found to fit the card.

    Raises:
        ModelError: naming the first parameter that does not.
    """
    check_vocabulary(model.card)
    shapes = network_shapes(model.card)
    for name, shape in shapes.items():
        check_parameter(model, name, shape)
    unknown = sorted(set(model.weights) - set(shapes))
    if unknown:
        raise ModelError(
            f"model has a parameter '{unknown[0]}' that its card does not speak of; "
            f"allowed are {len(shapes)} such as '{next(iter(shapes))}'; train it again "
            "with this version of eskin"
        )
    return {name: weight.astype(np.float32) for name, weight in model.weights.items()}


def check_vocabulary(card: ModelCard) -> None:
    """Refuse a vocabulary that is no list of different gestures and `none`."""
    names = card.vocabulary
    if NONE not in names or len(set(names)) < max(len(names), 2):
        raise ModelError(
            f"model's vocabulary is {', '.join(names) or 'empty'}; allowed are "
            f"different gestures and '{NONE}'; train it again"
        )


def check_parameter(model: Model, name: str, shape: tuple[int, ...]) -> None:
    """Refuse a parameter that is missing, of another shape, or not finite."""
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
    if not np.isfinite(weight).all():
        raise ModelError(
            f"model's parameter '{name}' holds NaN or infinity; allowed are finite "
            "numbers; train it again, with a lower rate"
        )
