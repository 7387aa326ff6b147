"""This module implements the kinds of faults of a virtual skin."""

import zlib
from abc import abstractmethod
from collections import deque
from typing import final

import numpy as np
from jaxtyping import Int

from eskin.drivers.packet import CRC, DATA, MAX_PACKET_BYTES
from eskin.drivers.virtual.fault import (
    FOREVER,
    FaultSpec,
    LineFault,
    ModuleFault,
    OutgoingBytes,
    PacketFault,
    TaxelFault,
)
from eskin.drivers.virtual.patch import VirtualPatch
from eskin.units import NS_PER_S

MAX_FLIPPED_BITS = 3
"""Flipped in a packet; a CRC-32 always notices so few."""
ADDRESS = slice(2, 4)
"""Where the address stands in a packet."""
HOUR = 3600.0
"""[s]"""


@final
class Lose(PacketFault):
    """A share of packets does not arrive."""

    default = 0.1

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Those that are not lost."""
        return [packet for packet in packets if not self.is_struck(packet, at)]


@final
class Stall(PacketFault):
    """Modules go on but nothing of them arrives."""

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Nothing while it lasts."""
        return [packet for packet in packets if not self.is_struck(packet, at)]


@final
class Corrupt(PacketFault):
    """A share of packets arrives with one to three bits flipped."""

    default = 0.01

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All of them, some broken."""
        return [
            OutgoingBytes(packet.patch, self.broken(packet.data))
            if self.is_struck(packet, at)
            else packet
            for packet in packets
        ]

    def broken(self, data: bytes) -> bytes:
        """The same with some bits flipped."""
        flips = int(self.rng.integers(1, MAX_FLIPPED_BITS + 1))
        places = self.rng.choice(8 * len(data), flips, replace=False)
        return flipped(data, places)


@final
class Truncate(PacketFault):
    """A share of packets arrives without its end."""

    default = 0.1

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All of them, some cut."""
        return [
            OutgoingBytes(
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

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All of them, some twice."""
        out: list[OutgoingBytes] = []
        for packet in packets:
            out += [packet] * (2 if self.is_struck(packet, at) else 1)
        return out


@final
class Reorder(PacketFault):
    """A share of packets arrives after the next one of the same module."""

    default = 0.1

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.held: dict[int, OutgoingBytes] = {}

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All but those held back, and those held back before."""
        out: list[OutgoingBytes] = []
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

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.late = round(order.amount * NS_PER_S)
        self.held: deque[tuple[int, OutgoingBytes]] = deque()

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Those that are due, then those that are not delayed."""
        out: list[OutgoingBytes] = []
        while self.held and self.held[0][0] <= at:
            out.append(self.held.popleft()[1])
        for packet in packets:
            if self.holds(at) and packet.patch in self.spec.patches:
                self.note(packet)
                self.held.append((at + self.late, packet))
            else:
                out.append(packet)
        return out


@final
class WrongPatch(PacketFault):
    """A share of data packets arrives once more under an address of no patch."""

    default = 0.1

    def pass_on(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All of them, and more."""
        out: list[OutgoingBytes] = []
        for packet in packets:
            out.append(packet)
            if packet.data[1] == DATA and self.is_struck(packet, at):
                strange = readdressed(packet.data, self.spec.unused)
                out.append(OutgoingBytes(packet.patch, strange))
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


MONTH = 2.6e6
"""[s]"""


class ModuleAbsence(ModuleFault):
    """Modules that are away for a time, then power up."""

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.end = order.end
        self.is_away = False

    @property
    def unit(self) -> str:
        """What it counts."""
        return "departures"

    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Take modules away, or bring them back."""
        away = self.spec.start <= at < self.end
        if away == self.is_away:
            return
        self.is_away = away
        for index in self.spec.patches:
            patches[index].away += 1 if away else -1
            self.count += away
            if not away:
                self.bring_back(patches[index], at)

    @abstractmethod
    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up what is plugged in."""


@final
class Unplug(ModuleAbsence):
    """Modules are unplugged, and plugged in again where that ends."""

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up the same module."""
        patch.power_up(at)


@final
class Reboot(ModuleAbsence):
    """Modules start anew, and are away for the amount [s]."""

    default, most, lasts = 0.2, MONTH, False

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.end = order.start + round(order.amount * NS_PER_S)

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up the same module."""
        patch.power_up(at)


@final
class Replace(ModuleAbsence):
    """Other modules, with other serial numbers, after the amount [s]."""

    default, most, lasts = 0.2, MONTH, False

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.end = order.start + round(order.amount * NS_PER_S)

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up another module."""
        other = 1 + int(self.rng.integers(2**62))
        patch.serial_number = (patch.serial_number + other) % 2**64
        patch.power_up(at)


class InstantModuleFault(ModuleFault):
    """Something that happens to modules at one instant."""

    lasts = False

    @property
    def unit(self) -> str:
        """What it counts."""
        return "modules"

    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Let it happen, once."""
        if self.count == 0 and at >= self.spec.start:
            self.count = len(self.spec.patches)
            self.turn([patches[index] for index in self.spec.patches], at)

    @abstractmethod
    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Let it happen to modules."""


@final
class ClockJump(InstantModuleFault):
    """Clocks of modules jump by the amount [s]."""

    default, least, most = 10.0, -MONTH, MONTH

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Let clocks jump."""
        for patch in patches:
            patch.jump(self.spec.amount)


@final
class Wrap(InstantModuleFault):
    """Clocks and scan numbers of modules wrap after the amount [s]."""

    default, most = 1.0, 2**32 / 1e6

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Set clocks and scan numbers."""
        for patch in patches:
            patch.wrap_in(self.spec.amount, at)


@final
class Swap(InstantModuleFault):
    """Two modules have each other's address, as when cables are changed."""

    pair = True

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Change their addresses."""
        one, other = patches
        one.address, other.address = other.address, one.address


@final
class SameAddress(InstantModuleFault):
    """The second module has the first one's address as well as the first."""

    pair = True

    def turn(self, patches: list[VirtualPatch], at: int) -> None:
        """Copy the address."""
        patches[1].address = patches[0].address


LARGEST = 2**16 - 1
"""That fits a count."""


@final
class Noisy(TaxelFault):
    """Counts with normal noise, whose deviation is the amount [counts]."""

    default, most = 200.0, float(LARGEST)

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Counts with noise."""
        noise = np.rint(self.rng.normal(0.0, self.spec.amount, len(counts)))
        return np.clip(counts + noise.astype(counts.dtype), 0, LARGEST)


@final
class Stuck(TaxelFault):
    """The amount, whatever is felt [counts]."""

    default, most = 2000.0, float(LARGEST)

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """The same for all."""
        return np.full_like(counts, round(self.spec.amount))


@final
class Dead(TaxelFault):
    """Nothing, whatever is felt."""

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Zeros."""
        return np.zeros_like(counts)


@final
class Flip(LineFault):
    """A share of all bits is flipped, framing included."""

    default, most = 0.0001, 0.5

    @property
    def unit(self) -> str:
        """What it counts."""
        return "bits"

    def pass_on(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All of them, with some bits flipped."""
        return [
            OutgoingBytes(chunk.patch, self.noisy(chunk.data))
            if self.holds(at) and chunk.patch in self.spec.patches
            else chunk
            for chunk in chunks
        ]

    def noisy(self, data: bytes) -> bytes:
        """The same with some bits flipped."""
        bits = 8 * len(data)
        flips = int(self.rng.binomial(bits, self.spec.amount))
        self.count += flips
        return flipped(data, self.rng.choice(bits, flips, replace=False))


@final
class Garbage(LineFault):
    """Random bytes in between, as many a second as the amount."""

    default, most = 100_000.0, 1e8

    @property
    def unit(self) -> str:
        """What it counts."""
        return "bytes"

    def __init__(self, order: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.last = 0

    def pass_on(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """All of them, and random bytes."""
        since, self.last = at - self.last, at
        if not self.holds(at):
            return chunks
        size = int(self.rng.poisson(self.spec.amount * since / NS_PER_S))
        self.count += size
        flood = self.rng.bytes(size)
        source = int(self.rng.choice(self.spec.patches))
        return chunks + [
            OutgoingBytes(source, flood[first : first + MAX_PACKET_BYTES])
            for first in range(0, size, MAX_PACKET_BYTES)
        ]
