"""This module converts networks to models, and keeps training that was interrupted."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from eskin.errors import ModelError
from eskin.files import atomic_path
from eskin.model import Model, ModelCard, checked_weights
from eskin.nn import RecogniserNetwork


def to_model(network: RecogniserNetwork, card: ModelCard) -> Model:
    """The network's weights, for a file.

    Raises:
        ModelError: if they are not such as can be used, after training that diverged.
    """
    state = network.state_dict()
    weights = {name: w.detach().cpu().numpy() for name, w in state.items()}
    return Model(checked_weights(Model(weights, card)), card)


def to_network(model: Model) -> RecogniserNetwork:
    """The network of a model, ready to evaluate.

    Raises:
        ModelError: if the weights are not those of such a network.
    """
    card = model.card
    weights = checked_weights(model)
    network = RecogniserNetwork(
        card.network, len(card.vocabulary), card.kind == "shear"
    )
    network.load_state_dict({name: torch.as_tensor(w) for name, w in weights.items()})
    return network.eval()


@dataclass(frozen=True)
class Checkpoint:
    """Where a training stands."""

    facts: str
    """Names the data and the settings."""
    step: int
    """Steps that are done."""
    best: dict[str, Any]
    """The weights with the lowest validation loss, and that loss."""
    state: dict[str, Any]
    """Of the network, the optimiser, the cycle and the generators."""


def save_checkpoint(path: Path, stand: Checkpoint) -> None:
    """Write where training stands; whole or not at all."""
    with atomic_path(path) as part:
        torch.save(vars(stand), part)


def load_checkpoint(path: Path, facts: str) -> Checkpoint | None:
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
        stand = Checkpoint(**torch.load(path, weights_only=True))
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


class EarlyStopping:
    """Remembers the weights with the lowest validation loss."""

    def __init__(self, patience: int) -> None:
        """Start with nothing."""
        self.patience, self.waited = patience, 0
        self.loss = float("inf")
        self.weights: dict[str, Tensor] | None = None

    @property
    def should_stop(self) -> bool:
        """Whether it is time to stop."""
        return self.waited > self.patience

    def is_enough(self, network: nn.Module, loss: float) -> bool:
        """Take in an epoch; True when it is time to stop."""
        if loss < self.loss:
            self.loss, self.waited = loss, 0
            self.weights = {k: v.clone() for k, v in network.state_dict().items()}
        else:
            self.waited += 1
        return self.should_stop

    def restore(self, network: nn.Module) -> None:
        """Put the best weights back, if any were kept."""
        if self.weights is not None:
            network.load_state_dict(self.weights)


@dataclass(eq=False)
class TrainingState:
    """All that changes while training goes on."""

    network: RecogniserNetwork
    optimiser: torch.optim.Optimizer
    cycle: torch.optim.lr_scheduler.OneCycleLR
    best: EarlyStopping
    rngs: list[np.random.Generator]

    def keep(self, path: Path, facts: str, step: int) -> None:
        """Write where training stands after some steps."""
        state = {
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "cycle": self.cycle.state_dict(),
            "rngs": [dict(rng.bit_generator.state) for rng in self.rngs],
            "torch": torch.get_rng_state(),
        }
        save_checkpoint(path, Checkpoint(facts, step, vars(self.best), state))

    def go_on(self, path: Path, facts: str) -> int:
        """Take up where training was cut; return the steps that were done."""
        found = load_checkpoint(path, facts)
        if found is None:
            return 0
        self.network.load_state_dict(found.state["network"])
        self.optimiser.load_state_dict(found.state["optimiser"])
        self.cycle.load_state_dict(found.state["cycle"])
        for rng, state in zip(self.rngs, found.state["rngs"], strict=True):
            rng.bit_generator.state = state
        torch.set_rng_state(found.state["torch"])
        vars(self.best).update(found.best)
        return found.step
