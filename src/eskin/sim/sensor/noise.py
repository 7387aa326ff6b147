"""This module draws the random numbers of readings, and which readings are lost."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, UInt

from eskin.sim.sensor.faults import Defects
from eskin.sim.sensor.model import SensorStages

NOISE_BLOCK = 100
"""Readings whose noise is drawn, and held in memory, at a time."""

WORD_BITS = 64
"""Bits of a word of random steps."""

NOISE_LEVELS = 2**16
"""Number of distinct values of normal noise; the largest are 4.3 deviations."""


@dataclass(frozen=True, eq=False)
class NoiseRows:
    """These rows hold the random numbers of some readings."""

    late: Float[np.ndarray, "reading patch"]
    """Delay of a patch's scan beyond the usual; standard normal."""
    signs: UInt[np.ndarray, "reading word"]
    """Words of which each bit is the direction of one step of a taxel's walk."""
    chances: UInt[np.ndarray, "reading taxel"]
    """Uniform numbers by which a taxel's noise is looked up."""


@final
class ReadingNoise:
    """This class draws the same numbers however many readings a call asks for."""

    def __init__(
        self,
        patches: int,
        taxels: int,
        streams: tuple[np.random.Generator, np.random.Generator, np.random.Generator],
    ) -> None:
        """Begin before the first reading.

        `streams` draw scan times, steps of walks, and noise.
        """
        self.patches = patches
        self.taxels = taxels
        self.streams = streams
        self.drawn = self.draw()
        self.given = 0

    @property
    def remaining(self) -> int:
        """Return how many readings may be asked for at a time."""
        return NOISE_BLOCK - self.given % NOISE_BLOCK

    def draw_rows(self, readings: int) -> NoiseRows:
        """Return the numbers of the next readings, no more than `remaining`."""
        within = self.given % NOISE_BLOCK
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
            late.standard_normal((NOISE_BLOCK, self.patches)),
            signs.integers(
                2**WORD_BITS,
                size=(NOISE_BLOCK, self.taxels // WORD_BITS + 1),
                dtype=np.uint64,
            ),
            chances.integers(
                NOISE_LEVELS, size=(NOISE_BLOCK, self.taxels), dtype=np.uint16
            ),
        )


Lost = Bool[np.ndarray, "reading patch"]


@final
class ReadingLosses:
    """This class draws which readings of whole patches get lost, in runs."""

    def __init__(
        self,
        defects: Defects,
        patches: int,
        rng: np.random.Generator,
        stages: SensorStages,
    ) -> None:
        """Begin before the first reading."""
        self.share = defects.dropped
        self.run = defects.dropped_run
        self.works = stages.faults and self.share > 0.0
        self.patches = patches
        self.rng = rng
        self.gone = np.zeros(patches, dtype=bool)
        self.has_begun = False

    def draw_all(self, readings: int) -> Lost:
        """Draw which readings get lost among so many, after which there are no more."""
        chance = self.rng.random((readings + 1, self.patches))
        self.gone = chance[-1] < self.share
        self.has_begun = True
        return self.draw_losses(chance[:-1])

    def draw_next(self) -> Lost:
        """Draw which patches are lost in the next reading of a stream without end.

        The law is the same as of `draw_all`, and so are the draws but for the state
        before the first reading, which `draw_all` draws last.
        """
        if not self.has_begun:
            self.gone = self.rng.spawn(1)[0].random(self.patches) < self.share
            self.has_begun = True
        return self.draw_losses(self.rng.random((1, self.patches)))

    def draw_losses(self, chance: Float[np.ndarray, "reading patch"]) -> Lost:
        """Advance by some readings, for each of which a chance was drawn."""
        lost = np.zeros(chance.shape, dtype=bool)
        if self.works:
            begin = self.share / (1.0 - self.share) / self.run
            stay = 1.0 - 1.0 / self.run
            for reading in range(len(chance)):
                lost[reading] = self.gone
                self.gone = chance[reading] < np.where(self.gone, stay, begin)
        return lost
