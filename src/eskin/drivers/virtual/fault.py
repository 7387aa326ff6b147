"""This module defines the abstract faults of a virtual skin."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Int

from eskin.drivers.packet import DATA
from eskin.drivers.virtual.patch import VirtualPatch

FOREVER = 2**63 - 1
"""A time that never comes [ns]."""


@dataclass(frozen=True, eq=False)
class FaultSpec:
    """A fault spec describes where, when and how strong a fault is."""

    text: str
    """The spec in the fault language."""
    patches: tuple[int, ...]
    """Affected patches, as indices of the skin's patches."""
    taxels: Int[np.ndarray, "part"]
    """Affected taxels, as indices of the skin's taxels."""
    start: int
    """Start, since the skin was started [ns]."""
    end: int
    """End, since the skin was started [ns]."""
    amount: float
    """Strength; its unit depends on the kind."""
    unused: int
    """An address that no patch of the skin has."""


class OutgoingBytes(NamedTuple):
    """Outgoing bytes are on their way from a patch to a port."""

    patch: int
    """Sender, as an index of the skin's patches."""
    data: bytes
    """One packet, or some bytes of the line where it is framed."""


class DeviceFault(ABC):
    """Changes what a virtual skin sends, in the same way every time for one seed.

    Attributes:
        spec: where, when and how strong it is.
        count: how often it has struck, in its `unit`.
    """

    default: ClassVar[float | None] = None
    """Amount unless given; None for a kind without amount."""
    min_amount: ClassVar[float] = 0.0
    """Smallest amount."""
    max_amount: ClassVar[float] = 1.0
    """Largest amount."""
    unit: ClassVar[str]
    """Name of what `count` counts."""
    has_end: ClassVar[bool] = True
    """Whether the fault may end."""
    needs_pair: ClassVar[bool] = False
    """Whether the fault affects two patches."""

    def __init__(self, spec: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare the fault.

        Args:
            spec: where, when and how strong it is.
            rng: random generator that it draws from.
        """
        self.spec = spec
        self.rng = rng
        self.count = 0

    def is_active(self, at: int) -> bool:
        """Return whether it is active at a time since the skin was started [ns]."""
        return self.spec.start <= at < self.spec.end

    def counters(self) -> dict[str, object]:
        """Return the spec and how often it has struck."""
        return {"fault": self.spec.text, "count": self.count, "of": self.unit}


class ModuleFault(DeviceFault):
    """Changes modules as a whole."""

    @abstractmethod
    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Change modules before they make a scan.

        Args:
            patches: all patches of the skin.
            at: time since the skin was started [ns].
        """


class TaxelFault(DeviceFault):
    """Changes what taxels measure."""

    unit = "counts"

    @abstractmethod
    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Return the disturbed counts of its taxels."""


class PacketFault(DeviceFault):
    """Changes packets on their way.

    Attributes:
        data: how many of the packets that it struck were data packets.
    """

    unit = "packets"

    def __init__(self, spec: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare the fault."""
        super().__init__(spec, rng)
        self.data = 0

    def strikes(self, packet: OutgoingBytes, at: int) -> bool:
        """Draw whether it strikes a packet, and count the packet if it does."""
        if not self.is_active(at) or packet.patch not in self.spec.patches:
            return False
        if self.spec.amount < 1.0 and self.rng.random() >= self.spec.amount:
            return False
        self.count_packet(packet)
        return True

    def count_packet(self, packet: OutgoingBytes) -> None:
        """Count a packet that it struck."""
        self.count += 1
        self.data += packet.data[1] == DATA

    def transmit(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return what becomes of packets: by default, of each one by itself.

        Args:
            packets: packets on their way.
            at: time since the skin was started [ns]; `FOREVER` once, at the end, when
                nothing may be held back any more.
        """
        out: list[OutgoingBytes] = []
        for packet in packets:
            out += self.strike(packet) if self.strikes(packet, at) else [packet]
        return out

    def strike(self, packet: OutgoingBytes) -> list[OutgoingBytes]:
        """Return what becomes of a packet that it strikes: by default, nothing."""
        return []

    def counters(self) -> dict[str, object]:
        """Return also how many were data packets."""
        return {**super().counters(), "data": self.data}


class LineFault(DeviceFault):
    """Changes the bytes on the line, framing included."""

    @abstractmethod
    def transmit(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return what becomes of the bytes on the line.

        Args:
            chunks: bytes on the line, in order.
            at: time since the skin was started [ns].
        """
