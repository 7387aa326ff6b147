"""This module converts networks to model files, and resumes interrupted training."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from eskin.errors import ModelError
from eskin.files import atomic_path
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.processes import ALONE, Processes
from eskin.live import (
    Model,
    ModelCard,
    check_weights,
)
from eskin.live.model_file import has_closing_layer


def to_model(network: RecogniserNetwork, card: ModelCard) -> Model:
    """Return a network's weights as a model, ready to be saved.

    Raises:
        ModelError: if the weights cannot be used, such as after training diverged.
    """
    state = network.state_dict()
    weights = {name: w.detach().cpu().numpy() for name, w in state.items()}
    return Model(check_weights(Model(weights, card)), card)


def to_network(model: Model) -> RecogniserNetwork:
    """Return the network of a model, ready to evaluate.

    Raises:
        ModelError: if the weights are of another network.
    """
    card = model.card
    weights = check_weights(model)
    network = RecogniserNetwork(
        card.network, len(card.vocabulary), card.kind == "shear"
    )
    if has_closing_layer(weights):
        network.add_closing_layer()
    network.load_state_dict({name: torch.as_tensor(w) for name, w in weights.items()})
    return network.eval()


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint holds the state from which interrupted training resumes."""

    facts: str
    """Description of the data and the settings."""
    step: int
    """Number of steps done."""
    best: dict[str, Any]
    """Weights with the lowest validation loss, and that loss."""
    state: dict[str, Any]
    """State of the network, the optimiser, the schedule and the generators."""


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint, whole or not at all."""
    with atomic_path(path) as part:
        torch.save(vars(checkpoint), part)


def load_checkpoint(path: Path, facts: str) -> Checkpoint | None:
    """Return the checkpoint of a file; None where there is no file.

    Args:
        path: path of the file.
        facts: description of data and settings that it must have.

    Raises:
        ModelError: if the file is damaged, or of another training.
    """
    if not path.exists():
        return None
    try:
        checkpoint = Checkpoint(**torch.load(path, weights_only=True))
    except Exception as error:
        raise ModelError(
            f"{path} cannot be read ({type(error).__name__}); allowed is a checkpoint "
            "of the same training; remove it to start anew"
        ) from error
    if checkpoint.facts != facts:
        raise ModelError(
            f"{path} is of a training with other data or settings; allowed is the same "
            "command as before; remove it to start anew, or give another --out"
        )
    return checkpoint


class EarlyStopping:
    """Early stopping keeps the weights with the lowest validation loss."""

    def __init__(self, patience: int) -> None:
        """Start without weights."""
        self.patience = patience
        self.waited = 0
        self.loss = float("inf")
        self.weights: dict[str, Tensor] | None = None

    @property
    def should_stop(self) -> bool:
        """Tell whether the loss has not improved for too long."""
        return self.waited > self.patience

    def update(self, network: nn.Module, loss: float) -> bool:
        """Compare the loss of an epoch with the best; tell whether to stop."""
        if loss < self.loss:
            self.loss = loss
            self.waited = 0
            self.weights = {k: v.clone() for k, v in network.state_dict().items()}
        else:
            self.waited += 1
        return self.should_stop

    def restore(self, network: nn.Module) -> None:
        """Load the best weights into a network, if any were kept."""
        if self.weights is not None:
            network.load_state_dict(self.weights)


@dataclass(eq=False)
class TrainingState:
    """A training state holds all that changes during training."""

    network: RecogniserNetwork
    optimiser: torch.optim.Optimizer
    schedule: torch.optim.lr_scheduler.OneCycleLR
    best: EarlyStopping
    rngs: list[np.random.Generator]
    processes: Processes = ALONE
    """Processes that train together; the first one writes and reads checkpoints."""

    def save(self, path: Path, facts: str, step: int) -> None:
        """Write a checkpoint after some steps."""
        rngs = [dict(rng.bit_generator.state) for rng in self.rngs]
        states = self.processes.gather((rngs, torch.get_rng_state()))
        state = {
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "cycle": self.schedule.state_dict(),
            "rngs": [rngs for rngs, _ in states],
            "torch": [state for _, state in states],
        }
        if self.processes.is_first:
            facts = f"{facts} {self.processes.count}"
            checkpoint = Checkpoint(facts, step, vars(self.best), state)
            save_checkpoint(path, checkpoint)

    def resume(self, path: Path, facts: str) -> int:
        """Load a checkpoint if there is one, and return the steps done.

        Raises:
            ModelError: if it is damaged, of another training, or of another number of
                processes.
        """
        first = self.processes.is_first
        count = self.processes.count
        found = load_checkpoint(path, f"{facts} {count}") if first else None
        found = self.processes.broadcast(found)
        if found is None:
            return 0
        self.network.load_state_dict(found.state["network"])
        self.optimiser.load_state_dict(found.state["optimiser"])
        self.schedule.load_state_dict(found.state["cycle"])
        rank = self.processes.rank
        for rng, state in zip(self.rngs, found.state["rngs"][rank], strict=True):
            rng.bit_generator.state = state
        torch.set_rng_state(found.state["torch"][rank])
        vars(self.best).update(found.best)
        return found.step
