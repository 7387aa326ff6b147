"""Settings of the network, saved with its weights."""

from dataclasses import dataclass

SLOT_NS = 20_000_000
"""One slot of the temporal head's clock: 20 ms."""

LENGTH_CM = 3.0
"""Unit of length inside the encoder [cm]: about a contact's size, and well above the
spacing of taxels, so that a denser skin looks nearly alike."""


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
