"""A sensor that goes on: pressures in, readings out, its state carried."""

from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtri

from eskin.sim.sensor.arrays import arrays_of
from eskin.sim.sensor.build import Build
from eskin.sim.sensor.losses import Losses
from eskin.sim.sensor.noise import LEVELS, Noise
from eskin.sim.sensor.sensor_kernels import conduct, convert, scan
from eskin.sim.sensor.session import Session, draw_session
from eskin.sim.sensor.stages import Stages
from eskin.sim.sensor.working import (
    ages_of,
    crosstalk_of,
    film_of,
    memory_of,
    readout_of,
)
from eskin.skin import Skin

TOUCHES = 8
"""Touches of a taxel whose after-effects are drawn; later ones repeat them."""

SURELY = 6.0
"""Deviations of a scan's time that never occur."""

LATE = 2
"""Periods within which a reading must be read."""


@final
class Sensor:
    """One build as it is pressed and read, step by step.

    What is drawn does not depend on the pressures, nor on how many steps and readings
    are asked for at a time.

    Attributes:
        losses: which readings do not arrive.
        noise: of the readings to come.
        readout: the converter.
    """

    def __init__(
        self,
        build: Build,
        skin: Skin,
        rng: np.random.Generator,
        stages: Stages | None = None,
        session: Session | None = None,
        live: Int[np.ndarray, "live"] | None = None,
    ) -> None:
        """Begin before the first step, untouched.

        Args:
            build: the skin as built.
            skin: its taxels.
            rng: to draw from.
            stages: which stages work; all unless given.
            session: what has drifted since calibration; drawn unless given.
            live: taxels that may conduct, sorted by patch; all unless given.
        """
        stages = stages or Stages()
        streams = [np.random.Generator(np.random.SFC64(seed)) for seed in seeds(rng)]
        session = session or draw_session(build, streams[0])
        electronics = build.electronics
        if live is None:
            live = np.argsort(skin.patch_index, kind="stable")
        after = electronics.after * streams[1].standard_normal((TOUCHES, skin.count))
        ages = ages_of(build, skin, stages)
        self.count = skin.count
        self.live = live
        self.film = film_of(live, build, session, stages, after)
        self.memory = memory_of(self.film)
        self.losses = Losses(build.defects, len(skin.patches), streams[2], stages)
        self.noise = Noise(
            len(skin.patches), skin.count, (streams[3], streams[4], streams[5])
        )
        self.arrays = arrays_of(live, ages, skin)
        self.readout = readout_of(build, stages)
        self.crosstalk = crosstalk_of(build, stages)
        self.divides = stages.divider
        self.jitter = electronics.jitter * stages.skew
        self.step = electronics.step
        reach = (ages.max(initial=0.0) + SURELY * self.jitter) / self.step
        self.reach = int(np.ceil(reach)) + 1
        self.kept = self.reach + LATE * round(electronics.period / self.step)
        self.drift = np.zeros(skin.count, np.float32)
        self.conductance = np.zeros((0, len(live)), np.float32)
        self.shift = np.zeros_like(self.conductance)
        self.first = 0

    @property
    def steps(self) -> int:
        """Steps since the beginning."""
        return self.first + len(self.conductance)

    def push(
        self,
        pressure: Float[np.ndarray, "time active"],
        taxels: Int[np.ndarray, "active"],
    ) -> None:
        """Let further steps pass.

        Args:
            pressure: of the active taxels after the film [kPa].
            taxels: the active ones, each once; all others are free.
        """
        column = np.full(self.count, -1, dtype=np.int64)
        column[taxels] = np.arange(len(taxels))
        kept = min(self.kept, len(self.conductance))
        shape = (kept + len(pressure), len(self.live))
        conductance, shift = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        conductance[:kept] = self.conductance[len(self.conductance) - kept :]
        shift[:kept] = self.shift[len(self.shift) - kept :]
        self.first = self.steps - kept
        self.conductance, self.shift = conductance, shift
        conduct(
            np.asarray(pressure, np.float64),
            column[self.live],
            self.film,
            self.memory,
            conductance[kept:],
            shift[kept:],
        )

    def read(
        self, places: Float[np.ndarray, "reading"]
    ) -> Int[np.ndarray, "reading taxel"]:
        """Counts of the next readings, as many as `noise` has left at most.

        Args:
            places: steps since the beginning at which they are put together. What is
                scanned later than the last step there is, is scanned at that step.

        Raises:
            ValueError: one of them is over so long that what was scanned is forgotten.
        """
        if self.first and places.min() - self.reach < self.first:
            raise ValueError(
                f"step {places.min():g} is to be read after step {self.steps - 1}; "
                f"allowed are {LATE} periods; read more often"
            )
        noise = self.noise.rows(len(places))
        shape = (len(places), self.count)
        level, shifts = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        scan(
            self.conductance,
            self.shift,
            self.arrays,
            places,
            noise.late * self.jitter,
            self.step,
            *self.crosstalk,
            self.divides,
            self.first,
            level,
            shifts,
        )
        counts = np.zeros(shape, np.int32)
        convert(
            *(level, shifts, noise.chances, noise.signs, normal_quantiles()),
            *(self.drift, self.readout, counts),
        )
        return counts


def seeds(rng: np.random.Generator) -> list[int]:
    """A seed for each thing that is drawn."""
    return [int(seed) for seed in rng.integers(2**63, size=6)]


@lru_cache(maxsize=1)
def normal_quantiles() -> Float[np.ndarray, "chance"]:
    """Equally likely values of the normal law."""
    chances = (np.arange(LEVELS) + 0.5) / LEVELS
    return ndtri(chances).astype(np.float32)
