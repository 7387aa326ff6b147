"""Which readings of a patch do not arrive."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.sensor.defects import Defects
from eskin.sim.sensor.stages import Stages

Lost = Bool[np.ndarray, "reading patch"]


@final
class Losses:
    """Readings of whole patches that get lost, in runs."""

    def __init__(
        self, defects: Defects, patches: int, rng: np.random.Generator, stages: Stages
    ) -> None:
        """Begin before the first reading.

        Args:
            defects: how many get lost, and how long runs of them are.
            patches: of the skin.
            rng: to draw from.
            stages: whether there are faults.
        """
        self.share, self.run = defects.dropped, defects.dropped_run
        self.works = stages.faults and self.share > 0.0
        self.patches = patches
        self.rng = rng
        self.gone = np.zeros(patches, dtype=bool)
        self.has_begun = False

    def all(self, readings: int) -> Lost:
        """Which of so many readings get lost, where there are no more than those."""
        chance = self.rng.random((readings + 1, self.patches))
        self.gone, self.has_begun = chance[-1] < self.share, True
        return self.lost(chance[:-1])

    def next(self) -> Lost:
        """Which patches are lost in the next reading of a stream without end.

        The same law as of `all`, and the same draws but for the state before the first
        reading, which `all` draws last.
        """
        if not self.has_begun:
            self.gone = self.rng.spawn(1)[0].random(self.patches) < self.share
            self.has_begun = True
        return self.lost(self.rng.random((1, self.patches)))

    def lost(self, chance: Float[np.ndarray, "reading patch"]) -> Lost:
        """Go on by some readings, for each of which a chance was drawn."""
        lost = np.zeros(chance.shape, dtype=bool)
        if self.works:
            begin = self.share / (1.0 - self.share) / self.run
            stay = 1.0 - 1.0 / self.run
            for reading in range(len(chance)):
                lost[reading] = self.gone
                self.gone = chance[reading] < np.where(self.gone, stay, begin)
        return lost
