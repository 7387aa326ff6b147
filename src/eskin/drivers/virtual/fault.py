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
    """What was asked for: where, when and how much."""

    text: str
    """In the fault language."""
    patches: tuple[int, ...]
    """Where, as indices of the skin's patches."""
    taxels: Int[np.ndarray, "part"]
    """Where, as indices of the skin's taxels."""
    start: int
    """From when on, since the skin was started [ns]."""
    end: int
    """Until when [ns]."""
    amount: float
    """How much; what of depends on the kind."""
    unused: int
    """An address that no patch of the skin has."""


class OutgoingBytes(NamedTuple):
    """Bytes on their way."""

    patch: int
    """Who sends them, as an index of the skin's patches."""
    data: bytes
    """One packet, or some of the line where it is framed."""


class DeviceFault(ABC):
    """Something wrong with a skin; the same every time for one seed.

    Attributes:
        order: what was asked for.
        count: how often it has struck, in its `unit`.
    """

    default: ClassVar[float | None] = None
    """Amount unless given; None where it takes none."""
    least: ClassVar[float] = 0.0
    """Smallest amount."""
    most: ClassVar[float] = 1.0
    """Largest amount."""
    lasts: ClassVar[bool] = True
    """Whether it may end."""
    pair: ClassVar[bool] = False
    """Whether it is of two patches."""

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it.

        Args:
            order: what was asked for.
            rng: to draw from.
        """
        self.spec = order
        self.rng = rng
        self.count = 0

    @property
    @abstractmethod
    def unit(self) -> str:
        """What it counts."""

    def holds(self, at: int) -> bool:
        """Whether it is there at a time since the skin was started [ns]."""
        return self.spec.start <= at < self.spec.end

    def counters(self) -> dict[str, object]:
        """What was asked for, and how often it has struck."""
        return {"fault": self.spec.text, "count": self.count, "of": self.unit}


class ModuleFault(DeviceFault):
    """Something wrong with modules as a whole."""

    @abstractmethod
    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Change them before they make a scan.

        Args:
            patches: all of the skin.
            at: since the skin was started [ns].
        """


class TaxelFault(DeviceFault):
    """Something wrong with what taxels measure."""

    @property
    def unit(self) -> str:
        """What it counts."""
        return "counts"

    @abstractmethod
    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """What its taxels count in place of what they should."""


class PacketFault(DeviceFault):
    """Something wrong with packets on their way.

    Attributes:
        data: how many of those that it struck were data packets.
    """

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.data = 0

    @property
    def unit(self) -> str:
        """What it counts."""
        return "packets"

    def is_struck(self, packet: OutgoingBytes, at: int) -> bool:
        """Whether it strikes a packet, if chance wills; then it is counted."""
        if not self.holds(at) or packet.patch not in self.spec.patches:
            return False
        if self.spec.amount < 1.0 and self.rng.random() >= self.spec.amount:
            return False
        self.note(packet)
        return True

    def note(self, packet: OutgoingBytes) -> None:
        """Count a packet."""
        self.count += 1
        self.data += packet.data[1] == DATA

    @abstractmethod
    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """What becomes of packets.

        Args:
            packets: on their way.
            at: since the skin was started [ns]; `FOREVER` once, at the end, when
                nothing may be held back any more.
        """

    def counters(self) -> dict[str, object]:
        """Also how many were data packets."""
        return {**super().counters(), "data": self.data}


class LineFault(DeviceFault):
    """Something wrong with the line itself, framing included."""

    @abstractmethod
    def pass_on(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """What becomes of what is on the line.

        Args:
            chunks: on the line, in order.
            at: since the skin was started [ns].
        """
