"""How the network is trained."""

from dataclasses import dataclass, field

import numpy as np

from eskin.graph import GraphConfig
from eskin.learn.augment import AugmentConfig
from eskin.model import NetworkConfig, check_limits

LIMITS = {
    "epochs": (1, np.inf),
    "steps": (1, np.inf),
    "batch": (1, np.inf),
    "encoded": (1, np.inf),
    "readings": (1, np.inf),
    "workers": (1, np.inf),
    "patience": (0, np.inf),
    "rate": (1e-9, 1.0),
    "decay": (0.0, np.inf),
    "smoothing": (0.0, 1.0),
    "validation": (0.0, 0.9),
}
"""Smallest and largest values of the settings."""


@dataclass(frozen=True)
class TrainConfig:
    """How the network is trained."""

    epochs: int = 10
    """Epochs of `steps` steps."""

    steps: int = 40
    """Steps an epoch."""

    batch: int = 64
    """Windows a step."""

    encoded: int = 32
    """Of these, windows whose graphs are encoded, which is what takes the time: the
    summary view sees all."""

    readings: int = 25
    """Of an encoded window, readings whose graphs are encoded, drawn anew each time."""

    rate: float = 3e-3
    """Highest learning rate of the cycle."""

    decay: float = 0.3
    """Weight decay."""

    smoothing: float = 0.1
    """Label smoothing."""

    patience: int = 5
    """Epochs without a better validation loss that are waited for; one more stops."""

    validation: float = 0.15
    """Share of the recordings held out to choose the epoch, in whole sessions; 0 trains
    to the end."""

    shear: bool = True
    """Whether shear is used where every skin measures it."""

    workers: int = 1
    """Parts of each batch that are made and differentiated at the same time, one a
    core; with dropout and more than one, no two trainings are the same to the bit."""

    graph: GraphConfig = field(default_factory=GraphConfig)
    """How contacts become graphs."""

    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """How training windows vary."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the network."""

    @property
    def graph_used(self) -> GraphConfig:
        """The graphs to train on: without shear, it touches no taxel either."""
        return self.graph if self.shear else self.graph.without_shear()

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, LIMITS)
