"""Settings of the network, saved with its weights."""

from dataclasses import dataclass

import numpy as np

from eskin.model.limits import check_limits

SLOT_NS = 20_000_000
"""One slot of the temporal head's clock: 20 ms."""

LENGTH_CM = 3.0
"""Unit of length inside the encoder [cm]: about a contact's size, and well above the
spacing of taxels, so that a denser skin looks nearly alike."""

LEAST_SLOTS = 25
"""What the head's two convolutions need: 5 taps, each 4 slots on, of 9 slots."""

LIMITS = {
    "width": (1, np.inf),
    "layers": (0, np.inf),
    "channels": (1, np.inf),
    "dropout": (0.0, 0.9),
    "slots": (LEAST_SLOTS, np.inf),
}
"""Smallest and largest values of the settings."""


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the recogniser's network."""

    width: int = 8
    """Channels of a node."""

    layers: int = 2
    """Equivariant layers."""

    channels: int = 32
    """Channels of the temporal head."""

    dropout: float = 0.3
    """Share of features left out while training."""

    slots: int = 100
    """Slots of 20 ms that the head looks back: 2 s."""

    def __post_init__(self) -> None:
        """Refuse sizes that no network has."""
        check_limits(self, LIMITS)
