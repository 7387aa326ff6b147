"""The course of a training: what changes as it goes on, and the best so far."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from eskin.learn.stand import Stand, load_stand, save_stand
from eskin.nn import RecogniserNetwork


class Best:
    """Remembers the weights with the lowest validation loss."""

    def __init__(self, patience: int) -> None:
        """Start with nothing."""
        self.patience, self.waited = patience, 0
        self.loss = float("inf")
        self.weights: dict[str, Tensor] | None = None

    @property
    def has_waited(self) -> bool:
        """Whether it is time to stop."""
        return self.waited > self.patience

    def is_enough(self, network: nn.Module, loss: float) -> bool:
        """Take in an epoch; True when it is time to stop."""
        if loss < self.loss:
            self.loss, self.waited = loss, 0
            self.weights = {k: v.clone() for k, v in network.state_dict().items()}
        else:
            self.waited += 1
        return self.has_waited

    def restore(self, network: nn.Module) -> None:
        """Put the best weights back, if any were kept."""
        if self.weights is not None:
            network.load_state_dict(self.weights)


@dataclass(eq=False)
class Course:
    """All that changes while training goes on."""

    network: RecogniserNetwork
    optimiser: torch.optim.Optimizer
    cycle: torch.optim.lr_scheduler.OneCycleLR
    best: Best
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
        save_stand(path, Stand(facts, step, vars(self.best), state))

    def go_on(self, path: Path, facts: str) -> int:
        """Take up where training was cut; return the steps that were done."""
        found = load_stand(path, facts)
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
