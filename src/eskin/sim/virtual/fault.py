"""This module defines the abstract faults of a virtual skin.

Times, also those named `at`, are counted from the start of the skin [ns].
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Int

from eskin.drivers.packet import DATA, read_kind
from eskin.sim.virtual.patch import VirtualPatch

FOREVER = 2**63 - 1
"""A time that never comes [ns]."""


@dataclass(frozen=True, eq=False)
class FaultSpec:
    """A parsed fault, which says where, when and how strong the fault is."""

    text: str
    """The spec in the fault language."""
    patches: tuple[int, ...]
    """Affected patches, as indices of the skin's patches."""
    taxels: Int[np.ndarray, "part"]
    """Affected taxels, as indices of the skin's taxels."""
    start: int
    """Start [ns]."""
    end: int
    """End [ns]."""
    amount: float
    """Strength; its unit depends on the kind."""
    unused: int
    """An address that no patch of the skin has."""


class OutgoingBytes(NamedTuple):
    """Bytes that are sent from a patch to a port."""

    patch: int
    """Sender, as an index of the skin's patches."""
    data: bytes
    """One packet, or some bytes of the line where it is framed."""


class DeviceFault(ABC):
    """Changes what a virtual skin sends, in the same way every time for one seed.

    Attributes:
        spec: where, when and how strong it is.
        count: how much it has changed so far, in its `unit`.
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
        """Prepare the fault; it draws all that is random from `rng`."""
        self.spec = spec
        self.rng = rng
        self.count = 0

    def is_active(self, at: int) -> bool:
        """Return whether the fault is active."""
        return self.spec.start <= at < self.spec.end

    def counters(self) -> dict[str, object]:
        """Return the spec and the count."""
        return {"fault": self.spec.text, "count": self.count, "of": self.unit}


class ModuleFault(DeviceFault):
    """Changes modules as a whole."""

    @abstractmethod
    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Change modules, given all patches of the skin, before they make a scan."""


class TaxelFault(DeviceFault):
    """Changes what taxels measure."""

    unit = "counts"

    @abstractmethod
    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Return the disturbed counts of its taxels."""


class PacketFault(DeviceFault):
    """Changes packets on their way.

    Attributes:
        data: number of data packets among those that it has affected.
    """

    unit = "packets"
    data = 0

    def select(self, packet: OutgoingBytes, at: int) -> bool:
        """Draw whether the fault affects a packet, and count the packet if so."""
        if not self.is_active(at) or packet.patch not in self.spec.patches:
            return False
        if self.spec.amount < 1.0 and self.rng.random() >= self.spec.amount:
            return False
        self.count_packet(packet)
        return True

    def count_packet(self, packet: OutgoingBytes) -> None:
        """Count an affected packet."""
        self.count += 1
        self.data += read_kind(packet.data) == DATA

    def transmit(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return the packets that are sent in place of these.

        At the end, `at` is `FOREVER` once, when no packet may be held back any more.
        """
        out: list[OutgoingBytes] = []
        for packet in packets:
            out += self.apply(packet) if self.select(packet, at) else [packet]
        return out

    def apply(self, packet: OutgoingBytes) -> list[OutgoingBytes]:
        """Return the packets in place of an affected packet; by default none."""
        return []

    def counters(self) -> dict[str, object]:
        """Return also the number of affected data packets."""
        return {**super().counters(), "data": self.data}


class LineFault(DeviceFault):
    """Changes the bytes on the line, framing included."""

    @abstractmethod
    def transmit(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return the bytes that are sent in place of these, in order."""
