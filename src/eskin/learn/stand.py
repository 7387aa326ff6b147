"""What a training that was cut goes on from."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from eskin.errors import ModelError
from eskin.files import atomic_path


@dataclass(frozen=True)
class Stand:
    """Where a training stands."""

    facts: str
    """Names the data and the settings."""
    step: int
    """Steps that are done."""
    best: dict[str, Any]
    """The weights with the lowest validation loss, and that loss."""
    state: dict[str, Any]
    """Of the network, the optimiser, the cycle and the generators."""


def save_stand(path: Path, stand: Stand) -> None:
    """Write where training stands; whole or not at all."""
    with atomic_path(path) as part:
        torch.save(vars(stand), part)


def load_stand(path: Path, facts: str) -> Stand | None:
    """Where training stands; None where it has not begun.

    Args:
        path: of the file.
        facts: names the data and the settings that it must be of.

    Raises:
        ModelError: the file is damaged, or of another training.
    """
    if not path.exists():
        return None
    try:
        stand = Stand(**torch.load(path, weights_only=True))
    except Exception as error:
        raise ModelError(
            f"{path} cannot be read ({type(error).__name__}); allowed is what the same "
            "training left there when it was cut; remove it to start anew"
        ) from error
    if stand.facts != facts:
        raise ModelError(
            f"{path} is of a training with other data or settings; allowed is the same "
            "command as before; remove it to start anew, or give another --out"
        )
    return stand
