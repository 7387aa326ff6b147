"""Reading and writing model files: safetensors with one JSON card as metadata."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_json
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from eskin.errors import ModelError
from eskin.files import atomic_path
from eskin.model.card import ModelCard

CARD = "eskin"
SUFFIX = ".safetensors"

MODELS = {"ur5": "ur5", "ur5-blind": "ur5"}
"""Names that `load_model` knows, each with the preset skin that it was trained on. The
second never sees the pose: it is there to be compared with."""
CARDS = TypeAdapter(ModelCard)


@dataclass(frozen=True, eq=False)
class Model:
    """Weights and their card."""

    weights: Mapping[str, np.ndarray]
    """By the name of the network's parameter."""

    card: ModelCard
    """What they are for."""

    @property
    def digest(self) -> str:
        """SHA-256 over the weights, by name."""
        every = hashlib.sha256()
        for name in sorted(self.weights):
            every.update(name.encode() + self.weights[name].tobytes())
        return every.hexdigest()


def save_model(path: Path, model: Model) -> None:
    """Write a model file; whole or not at all."""
    # A metric may be NaN, which JSON has no number for.
    card = to_json(model.card, inf_nan_mode="strings").decode()
    weights = {name: np.asarray(w, order="C") for name, w in model.weights.items()}
    with atomic_path(path) as part:
        save_file(weights, part, metadata={CARD: card})


def load_model(name_or_path: str | Path) -> Model:
    """Read a model that comes with eskin, or a model file.

    Args:
        name_or_path: one of `MODELS`, or the path of a `.safetensors` file.

    Raises:
        ModelError: if it is missing, damaged, or not one of eskin's.
    """
    path = Path(name_or_path)
    if str(name_or_path) in MODELS:
        path = Path(str(resources.files("eskin.model") / "presets" / f"{path}{SUFFIX}"))
    if path.is_dir():
        raise ModelError(
            f"{path} is a folder, and no model file; allowed are {', '.join(MODELS)} "
            "and .safetensors files; name the model here, and recordings elsewhere"
        )
    try:
        with safe_open(path, framework="numpy") as file:
            card = read_card((file.metadata() or {}).get(CARD), path)
            weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise ModelError(
            f"{path}: no such model; allowed are {', '.join(MODELS)} and files; train "
            f"one with: eskin train DATA --out {path}"
        ) from None
    # A TypeError tells of numbers that numpy does not have, such as bfloat16.
    except (SafetensorError, OSError, TypeError) as error:
        raise ModelError(
            f"{path} is no model file ({error}); allowed is a .safetensors file "
            "written by eskin train; train it again"
        ) from None
    return Model(weights, card)


def read_card(text: str | None, path: Path) -> ModelCard:
    """Parse a card; every problem is named by its place in it."""
    if text is None:
        raise ModelError(
            f"{path} has no card '{CARD}' in its metadata; allowed are models written "
            "by eskin train; train it again"
        )
    try:
        return CARDS.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        what = f"card entry '{place}'" if place else "its card"
        raise ModelError(
            f"{path}: {what} is {first['input']!r:.80}: {first['msg']}; "
            "train the model again with this version of eskin"
        ) from None
