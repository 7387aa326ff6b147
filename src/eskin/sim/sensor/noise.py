"""The random numbers of every reading, drawn in blocks."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, UInt

BLOCK = 100
"""Readings whose noise is drawn, and held in memory, at a time."""

WORD = 64
"""Bits of a word of random steps."""

LEVELS = 2**16
"""Values that normal noise is told apart in; the largest are 4.3 deviations."""


@dataclass(frozen=True, eq=False)
class NoiseRows:
    """The random numbers of some readings."""

    late: Float[np.ndarray, "reading patch"]
    """How much later than usual a patch is scanned; standard normal."""
    signs: UInt[np.ndarray, "reading word"]
    """Each bit the direction of one step of a taxel's walk."""
    chances: UInt[np.ndarray, "reading taxel"]
    """From which a taxel's noise is looked up, all alike."""


@final
class Noise:
    """The same numbers however many readings are asked for at a time."""

    def __init__(
        self,
        patches: int,
        taxels: int,
        streams: tuple[np.random.Generator, np.random.Generator, np.random.Generator],
    ) -> None:
        """Begin before the first reading.

        Args:
            patches: of the skin.
            taxels: of the skin.
            streams: to draw from: scan times, steps of walks, noise.
        """
        self.patches, self.taxels = patches, taxels
        self.streams = streams
        self.drawn = self.draw()
        self.given = 0

    @property
    def left(self) -> int:
        """Readings that may be asked for at a time."""
        return BLOCK - self.given % BLOCK

    def rows(self, readings: int) -> NoiseRows:
        """The numbers of the next readings, no more than are `left`."""
        within = self.given % BLOCK
        if self.given and within == 0:
            self.drawn = self.draw()
        self.given += readings
        part = slice(within, within + readings)
        drawn = self.drawn
        return NoiseRows(drawn.late[part], drawn.signs[part], drawn.chances[part])

    def draw(self) -> NoiseRows:
        """Draw a block. Draws of 16 bits are packed, so part of one is not the same."""
        late, signs, chances = self.streams
        return NoiseRows(
            late.standard_normal((BLOCK, self.patches)),
            signs.integers(
                2**WORD, size=(BLOCK, self.taxels // WORD + 1), dtype=np.uint64
            ),
            chances.integers(LEVELS, size=(BLOCK, self.taxels), dtype=np.uint16),
        )
