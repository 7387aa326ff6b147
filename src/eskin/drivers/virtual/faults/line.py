"""What a bad line does to bytes, whatever packets they are of."""

from typing import final

import numpy as np

from eskin.drivers.packet import MOST_BYTES
from eskin.drivers.virtual.faults.fault import LineFault, Order, Outgoing
from eskin.drivers.virtual.faults.packets import flipped
from eskin.units import NS_PER_S


@final
class Flip(LineFault):
    """A share of all bits is flipped, framing included."""

    default, most = 0.0001, 0.5

    @property
    def unit(self) -> str:
        """What it counts."""
        return "bits"

    def pass_on(self, chunks: list[Outgoing], at: int) -> list[Outgoing]:
        """All of them, with some bits flipped."""
        return [
            Outgoing(chunk.patch, self.noisy(chunk.data))
            if self.holds(at) and chunk.patch in self.order.patches
            else chunk
            for chunk in chunks
        ]

    def noisy(self, data: bytes) -> bytes:
        """The same with some bits flipped."""
        bits = 8 * len(data)
        flips = int(self.rng.binomial(bits, self.order.amount))
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

    def __init__(self, order: Order, rng: np.random.Generator) -> None:
        """Prepare it."""
        super().__init__(order, rng)
        self.last = 0

    def pass_on(self, chunks: list[Outgoing], at: int) -> list[Outgoing]:
        """All of them, and random bytes."""
        since, self.last = at - self.last, at
        if not self.holds(at):
            return chunks
        size = int(self.rng.poisson(self.order.amount * since / NS_PER_S))
        self.count += size
        flood = self.rng.bytes(size)
        source = int(self.rng.choice(self.order.patches))
        return chunks + [
            Outgoing(source, flood[first : first + MOST_BYTES])
            for first in range(0, size, MOST_BYTES)
        ]
