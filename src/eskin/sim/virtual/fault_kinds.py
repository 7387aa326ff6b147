"""This module implements every kind of fault of a virtual skin.

Packets get lost, corrupted, late, duplicated or mixed up; modules go, come back, are
replaced or wired wrong; taxels measure wrong; the line flips bits or adds bytes.
"""

import zlib
from abc import abstractmethod
from collections import deque
from typing import final

import numpy as np
from jaxtyping import Int

from eskin.drivers.packet import CRC, DATA, MAX_COUNT, MAX_PACKET_BYTES, read_kind
from eskin.sim.virtual.fault import (
    FOREVER,
    DeviceFault,
    FaultSpec,
    LineFault,
    ModuleFault,
    OutgoingBytes,
    PacketFault,
    TaxelFault,
)
from eskin.sim.virtual.patch import VirtualPatch
from eskin.units import NS_PER_S

MAX_FLIPPED_BITS = 3
"""Largest number of flipped bits in a packet; a CRC-32 always detects so few."""
ADDRESS = slice(2, 4)
"""Bytes of a packet that hold the address."""
S_PER_HOUR = 3600.0
S_PER_MONTH = 2.6e6


@final
class Lose(PacketFault):
    """A share of packets does not arrive."""

    default = 0.1


@final
class Stall(PacketFault):
    """Modules continue to send but nothing arrives."""


@final
class Corrupt(PacketFault):
    """A share of packets arrives with one to three bits flipped."""

    default = 0.01

    def apply(self, packet: OutgoingBytes) -> list[OutgoingBytes]:
        """Return the packet with some bits flipped."""
        flips = int(self.rng.integers(1, MAX_FLIPPED_BITS + 1))
        places = self.rng.choice(8 * len(packet.data), flips, replace=False)
        return [OutgoingBytes(packet.patch, flip_bits(packet.data, places))]


@final
class Truncate(PacketFault):
    """A share of packets arrives without its end."""

    default = 0.1

    def apply(self, packet: OutgoingBytes) -> list[OutgoingBytes]:
        """Return the start of the packet."""
        size = int(self.rng.integers(1, len(packet.data)))
        return [OutgoingBytes(packet.patch, packet.data[:size])]


@final
class Duplicate(PacketFault):
    """A share of packets arrives twice."""

    default = 0.1

    def apply(self, packet: OutgoingBytes) -> list[OutgoingBytes]:
        """Return the packet twice."""
        return [packet, packet]


@final
class Reorder(PacketFault):
    """A share of packets arrives after the next one of the same module."""

    default = 0.1

    def __init__(self, spec: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare the fault."""
        super().__init__(spec, rng)
        self.held: dict[int, OutgoingBytes] = {}

    def transmit(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return all packets but those held back, and those held back before."""
        out: list[OutgoingBytes] = []
        for packet in packets:
            if packet.patch in self.held:
                out += [packet, self.held.pop(packet.patch)]
            elif self.select(packet, at):
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

    default = 0.1
    max_amount = S_PER_HOUR

    def __init__(self, spec: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare the fault."""
        super().__init__(spec, rng)
        self.delay = round(spec.amount * NS_PER_S)
        self.held: deque[tuple[int, OutgoingBytes]] = deque()

    def transmit(self, packets: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return the packets that are due, then those that are not delayed."""
        out: list[OutgoingBytes] = []
        while self.held and self.held[0][0] <= at:
            out.append(self.held.popleft()[1])
        for packet in packets:
            if self.is_active(at) and packet.patch in self.spec.patches:
                self.count_packet(packet)
                self.held.append((at + self.delay, packet))
            else:
                out.append(packet)
        return out


@final
class WrongPatch(PacketFault):
    """A share of data packets arrives once more under an address of no patch."""

    default = 0.1

    def select(self, packet: OutgoingBytes, at: int) -> bool:
        """Draw whether the fault affects a packet, which must be a data packet."""
        return read_kind(packet.data) == DATA and super().select(packet, at)

    def apply(self, packet: OutgoingBytes) -> list[OutgoingBytes]:
        """Return the packet, and the same under another address."""
        strange = replace_address(packet.data, self.spec.unused)
        return [packet, OutgoingBytes(packet.patch, strange)]


def flip_bits(data: bytes, places: np.ndarray) -> bytes:
    """Return the same bytes with some bits flipped."""
    changed = bytearray(data)
    for place in places.tolist():
        changed[place // 8] ^= 1 << place % 8
    return bytes(changed)


def replace_address(data: bytes, address: int) -> bytes:
    """Return the same packet under another address."""
    body = bytearray(data[: -CRC.size])
    body[ADDRESS] = address.to_bytes(2, "little")
    return bytes(body) + CRC.pack(zlib.crc32(body))


class ModuleAbsence(ModuleFault):
    """Modules are away until the end, or for the amount [s], then power up."""

    unit = "departures"

    def __init__(self, spec: FaultSpec, rng: np.random.Generator) -> None:
        """Prepare the fault."""
        super().__init__(spec, rng)
        duration = round(spec.amount * NS_PER_S)
        self.end = spec.end if self.has_end else spec.start + duration
        self.is_away = False

    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Take modules away, or bring them back."""
        away = self.spec.start <= at < self.end
        if away == self.is_away:
            return
        self.is_away = away
        for index in self.spec.patches:
            patches[index].absences += 1 if away else -1
            self.count += away
            if not away:
                self.bring_back(patches[index], at)

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up the same module."""
        patch.power_up(at)


@final
class Unplug(ModuleAbsence):
    """Modules are unplugged, and plugged in again at the end."""


@final
class Reboot(ModuleAbsence):
    """Modules reboot, and are away for the amount [s]."""

    default = 0.2
    max_amount = S_PER_MONTH
    has_end = False


@final
class Replace(ModuleAbsence):
    """Modules with other serial numbers take their place after the amount [s]."""

    default = 0.2
    max_amount = S_PER_MONTH
    has_end = False

    def bring_back(self, patch: VirtualPatch, at: int) -> None:
        """Power up another module."""
        other = 1 + int(self.rng.integers(2**62))
        patch.serial_number = (patch.serial_number + other) % 2**64
        patch.power_up(at)


class InstantModuleFault(ModuleFault):
    """Something happens to modules at one instant."""

    unit = "modules"
    has_end = False

    def change(self, patches: tuple[VirtualPatch, ...], at: int) -> None:
        """Change the affected modules once, when it is time."""
        if self.count == 0 and at >= self.spec.start:
            self.count = len(self.spec.patches)
            self.apply([patches[index] for index in self.spec.patches], at)

    @abstractmethod
    def apply(self, patches: list[VirtualPatch], at: int) -> None:
        """Change the affected modules."""


@final
class ClockJump(InstantModuleFault):
    """Clocks of modules are set forward by the amount [s]."""

    default = 10.0
    min_amount = -S_PER_MONTH
    max_amount = S_PER_MONTH

    def apply(self, patches: list[VirtualPatch], at: int) -> None:
        """Set the clocks."""
        for patch in patches:
            patch.shift_clock(self.spec.amount)


@final
class Wrap(InstantModuleFault):
    """Clocks and scan numbers of modules wrap after the amount [s]."""

    default = 1.0
    max_amount = 2**32 / 1e6

    def apply(self, patches: list[VirtualPatch], at: int) -> None:
        """Set clocks and scan numbers."""
        for patch in patches:
            patch.wrap_in(self.spec.amount, at)


@final
class Swap(InstantModuleFault):
    """Two modules swap their addresses, as when cables are swapped."""

    needs_pair = True

    def apply(self, patches: list[VirtualPatch], at: int) -> None:
        """Swap the addresses."""
        one, other = patches
        one.address, other.address = other.address, one.address


@final
class SameAddress(InstantModuleFault):
    """The second module has the address of the first one."""

    needs_pair = True

    def apply(self, patches: list[VirtualPatch], at: int) -> None:
        """Copy the address."""
        patches[1].address = patches[0].address


@final
class Noisy(TaxelFault):
    """Counts have normal noise, whose standard deviation is the amount [counts]."""

    default = 200.0
    max_amount = float(MAX_COUNT)

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Return counts with noise."""
        noise = np.rint(self.rng.normal(0.0, self.spec.amount, len(counts)))
        return np.clip(counts + noise.astype(counts.dtype), 0, MAX_COUNT)


@final
class Stuck(TaxelFault):
    """Counts stay at the amount, whatever the pressure is [counts]."""

    default = 2000.0
    max_amount = float(MAX_COUNT)

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Return the amount for all taxels."""
        return np.full_like(counts, round(self.spec.amount))


@final
class Dead(TaxelFault):
    """Counts stay at zero, whatever the pressure is."""

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Return zero for all taxels."""
        return np.zeros_like(counts)


@final
class Flip(LineFault):
    """A share of all bits is flipped, framing included."""

    unit = "bits"
    default = 0.0001
    max_amount = 0.5

    def transmit(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return all bytes, with some bits flipped."""
        return [
            OutgoingBytes(chunk.patch, self.flip(chunk.data))
            if self.is_active(at) and chunk.patch in self.spec.patches
            else chunk
            for chunk in chunks
        ]

    def flip(self, data: bytes) -> bytes:
        """Return the bytes with some bits flipped."""
        bits = 8 * len(data)
        flips = int(self.rng.binomial(bits, self.spec.amount))
        self.count += flips
        return flip_bits(data, self.rng.choice(bits, flips, replace=False))


@final
class Garbage(LineFault):
    """Random bytes are inserted, as many a second as the amount."""

    unit = "bytes"
    default = 100_000.0
    max_amount = 1e8
    last = 0
    """Time of the last bytes [ns]."""

    def transmit(self, chunks: list[OutgoingBytes], at: int) -> list[OutgoingBytes]:
        """Return all bytes, then some random ones."""
        since = at - self.last
        self.last = at
        if not self.is_active(at):
            return chunks
        size = int(self.rng.poisson(self.spec.amount * since / NS_PER_S))
        self.count += size
        flood = self.rng.bytes(size)
        source = int(self.rng.choice(self.spec.patches))
        return chunks + [
            OutgoingBytes(source, flood[first : first + MAX_PACKET_BYTES])
            for first in range(0, size, MAX_PACKET_BYTES)
        ]


FAULT_KINDS: dict[str, type[DeviceFault]] = {
    "unplug": Unplug,
    "replace": Replace,
    "reboot": Reboot,
    "stall": Stall,
    "lose": Lose,
    "corrupt": Corrupt,
    "truncate": Truncate,
    "duplicate": Duplicate,
    "reorder": Reorder,
    "delay": Delay,
    "wrong_patch": WrongPatch,
    "flip": Flip,
    "garbage": Garbage,
    "clock_jump": ClockJump,
    "wrap": Wrap,
    "swap": Swap,
    "same_address": SameAddress,
    "noisy": Noisy,
    "stuck": Stuck,
    "dead": Dead,
}
"""Every kind of fault by its name."""
