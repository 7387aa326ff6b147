"""Packets that get lost, broken, late, doubled or mixed up on their way."""

import zlib
from collections import deque
from typing import final

import numpy as np

from eskin.drivers.packet import CRC, DATA
from eskin.drivers.virtual.faults.fault import FOREVER, Order, Outgoing, PacketFault
from eskin.units import NS_PER_S

MOST_BITS = 3
"""Flipped in a packet; a CRC-32 always notices so few."""
ADDRESS = slice(2, 4)
"""Where the address stands in a packet."""
HOUR = 3600.0
"""[s]"""


@final
class Lose(PacketFault):
    """A share of packets does not arrive."""

    default = 0.1

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """Those that are not lost."""
        return [packet for packet in packets if not self.is_struck(packet, at)]


@final
class Stall(PacketFault):
    """Modules go on but nothing of them arrives."""

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """Nothing while it lasts."""
        return [packet for packet in packets if not self.is_struck(packet, at)]


@final
class Corrupt(PacketFault):
    """A share of packets arrives with one to three bits flipped."""

    default = 0.01

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """All of them, some broken."""
        return [
            Outgoing(packet.patch, self.broken(packet.data))
            if self.is_struck(packet, at)
            else packet
            for packet in packets
        ]

    def broken(self, data: bytes) -> bytes:
        """The same with some bits flipped."""
        flips = int(self.rng.integers(1, MOST_BITS + 1))
        places = self.rng.choice(8 * len(data), flips, replace=False)
        return flipped(data, places)


@final
class Truncate(PacketFault):
    """A share of packets arrives without its end."""

    default = 0.1

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """All of them, some cut."""
        return [
            Outgoing(
                packet.patch,
                packet.data[: int(self.rng.integers(1, len(packet.data)))],
            )
            if self.is_struck(packet, at)
            else packet
            for packet in packets
        ]


@final
class Duplicate(PacketFault):
    """A share of packets arrives twice."""

    default = 0.1

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """All of them, some twice."""
        out: list[Outgoing] = []
        for packet in packets:
            out += [packet] * (2 if self.is_struck(packet, at) else 1)
        return out


@final
class Reorder(PacketFault):
    """A share of packets arrives after the next one of the same module."""

    default = 0.1

    def __init__(self, order: Order, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.held: dict[int, Outgoing] = {}

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """All but those held back, and those held back before."""
        out: list[Outgoing] = []
        for packet in packets:
            if packet.patch in self.held:
                out += [packet, self.held.pop(packet.patch)]
            elif self.is_struck(packet, at):
                self.held[packet.patch] = packet
            else:
                out.append(packet)
        if at == FOREVER:
            out += self.held.values()
            self.held.clear()
        return out


@final
class Delay(PacketFault):
    """Packets arrive late by the amount [s]."""

    default, most = 0.1, HOUR

    def __init__(self, order: Order, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.late = round(order.amount * NS_PER_S)
        self.held: deque[tuple[int, Outgoing]] = deque()

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """Those that are due, then those that are not delayed."""
        out: list[Outgoing] = []
        while self.held and self.held[0][0] <= at:
            out.append(self.held.popleft()[1])
        for packet in packets:
            if self.holds(at) and packet.patch in self.order.patches:
                self.note(packet)
                self.held.append((at + self.late, packet))
            else:
                out.append(packet)
        return out


@final
class WrongPatch(PacketFault):
    """A share of data packets arrives once more under an address of no patch."""

    default = 0.1

    def pass_on(self, packets: list[Outgoing], at: int) -> list[Outgoing]:
        """All of them, and more."""
        out: list[Outgoing] = []
        for packet in packets:
            out.append(packet)
            if packet.data[1] == DATA and self.is_struck(packet, at):
                strange = readdressed(packet.data, self.order.unused)
                out.append(Outgoing(packet.patch, strange))
        return out


def flipped(data: bytes, places: np.ndarray) -> bytes:
    """The same bytes with some bits flipped."""
    changed = bytearray(data)
    for place in places.tolist():
        changed[place // 8] ^= 1 << place % 8
    return bytes(changed)


def readdressed(data: bytes, address: int) -> bytes:
    """The same packet under another address."""
    body = bytearray(data[: -CRC.size])
    body[ADDRESS] = address.to_bytes(2, "little")
    return bytes(body) + CRC.pack(zlib.crc32(body))
