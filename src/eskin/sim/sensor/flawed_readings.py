"""Flawed readings add the flaws of a build of a family to a sensor, step by step."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.sensor.build import SensorBuild
from eskin.sim.sensor.flaw_kernels import (
    Coupling,
    Drift,
    Release,
    ReleaseState,
    couple_levels,
    move_rest,
    repeat_readings,
)
from eskin.sim.sensor.flaws import Flaws, number_rows
from eskin.sim.sensor.kernels import SensorLayer, TaxelArrays
from eskin.sim.sensor.model import SensorSession, SensorStages
from eskin.sim.sensor.noise import NOISE_BLOCK, WORD_BITS
from eskin.skin import Skin

PAUSE = 4.0
"""About the time between two clips of a session; slower drift goes on [s]."""


Wrong = tuple[
    Int[np.ndarray, "value"], Int[np.ndarray, "value"], Float[np.ndarray, "value"]
]
"""Reading, taxel and error of each corrupt value, the error by full scale."""


@dataclass(frozen=True, eq=False)
class FlawBlock:
    """A flaw block holds the random numbers of some readings."""

    rest: Float[np.ndarray, "reading taxel"]
    """Shift of readings at rest, by full scale."""
    swinging: Bool[np.ndarray, "reading some"]
    """Which intermittent taxels have no contact."""
    again: Bool[np.ndarray, "reading patch"]
    """Which patches repeat their last reading."""
    corrupt: Wrong
    """Values that are wrong in one reading."""


@final
class FlawedReadings:
    """Flawed readings hold the state of the flaws of one build.

    As the noise of readings, they are drawn in blocks, so they do not depend on how
    many readings are asked for at a time.
    """

    def __init__(
        self,
        build: SensorBuild,
        flaws: Flaws,
        skin: Skin,
        session: SensorSession,
        stages: SensorStages,
        rng: np.random.Generator,
    ) -> None:
        """Begin before the first step."""
        self.flaws = flaws
        self.stages = stages
        self.rng = rng
        self.full = build.electronics.full_scale
        self.period = build.electronics.period
        self.step = build.electronics.step
        self.patch = skin.patch_index
        self.patches = len(skin.patches)
        self.count = skin.count
        part = stages.ghosting
        self.coupling = Coupling(
            flaws.neighbours * part, flaws.column_leak * part, flaws.row_leak * part
        )
        line = number_rows(skin)
        self.lines = int(line.max()) + 1
        keep = np.exp(-self.period / flaws.drift_times)
        size = flaws.drift * stages.drift
        shared = build.electronics.noise / self.full * np.sqrt(flaws.line_noise)
        warming = session.warming * flaws.offset_per_kelvin * self.period
        self.drift = Drift(
            keep,
            size * np.sqrt(1.0 - keep**2),
            (warming * stages.drift).astype(np.float32),
            line,
            (shared * flaws.noise_factor * stages.noise).astype(np.float32),
        )
        slow = rng.standard_normal((len(keep), self.count))
        if session.drift is not None:
            lasting = flaws.drift_times > PAUSE
            slow[lasting] = session.drift[lasting]
        self.slow = (size[:, None] * slow).astype(np.float32)
        self.offset = np.zeros(self.count, np.float32)
        working, swinging = flaws.swing_times
        share = swinging / (working + swinging)
        self.swings = rng.random(len(flaws.intermittent)) < share
        self.last = np.full(self.count, -1, np.int32)
        self.given = 0
        self.block = self.draw_block()

    def build_release(self, layer: SensorLayer) -> tuple[Release, ReleaseState]:
        """Build the lag of live taxels, and its state before the first step."""
        works = self.stages.creep
        release = Release(
            compute_part(self.step, self.flaws.rise * works),
            compute_part(self.step, self.flaws.fall * works),
            self.flaws.residue * works,
            layer.creep,
            layer.creep_part,
        )
        live = len(layer.load)
        return release, ReleaseState(
            np.zeros(live), np.zeros((live, len(layer.creep_part)))
        )

    def draw_block(self) -> FlawBlock:
        """Draw a block of readings."""
        rng = self.rng
        flaws = self.flaws
        words = rng.integers(
            2**WORD_BITS,
            size=(NOISE_BLOCK, len(flaws.drift), self.count // WORD_BITS + 1),
            dtype=np.uint64,
        )
        shared = rng.standard_normal((NOISE_BLOCK, self.lines), dtype=np.float32)
        rest = np.zeros((NOISE_BLOCK, self.count), np.float32)
        move_rest(self.drift, words, shared, self.slow, self.offset, rest)
        self.add_jumps(rest)
        return FlawBlock(
            rest, self.draw_swings(), self.draw_repeats(), self.draw_corrupt()
        )

    def add_jumps(self, rest: Float[np.ndarray, "reading taxel"]) -> None:
        """Add steps of single taxels that stay."""
        rng = self.rng
        rate = self.flaws.jumps * self.period * self.count
        median, deviation, max_size = self.flaws.jump_size
        for reading, number in enumerate(rng.poisson(rate, NOISE_BLOCK)):
            for taxel in rng.integers(self.count, size=number):
                size = median * deviation ** rng.standard_normal()
                sign = 1.0 if rng.random() < 0.5 else -1.0
                jump = sign * min(size, max_size) * self.stages.drift
                rest[reading:, taxel] += jump
                self.offset[taxel] += jump

    def draw_swings(self) -> Bool[np.ndarray, "reading some"]:
        """Draw which intermittent taxels have no contact."""
        working, swinging = self.flaws.swing_times
        chances = self.rng.random((NOISE_BLOCK, len(self.swings)))
        found = np.zeros(chances.shape, bool)
        for reading, chance in enumerate(chances):
            found[reading] = self.swings
            stay = 1.0 - self.period / swinging
            begin = self.period / working
            self.swings = chance < np.where(self.swings, stay, begin)
        return found & self.stages.faults

    def draw_repeats(self) -> Bool[np.ndarray, "reading patch"]:
        """Draw which patches repeat their last reading."""
        chances = self.rng.random((NOISE_BLOCK, self.patches))
        return (chances < self.flaws.repeated) & self.stages.faults

    def draw_corrupt(self) -> Wrong:
        """Draw the values that are wrong in one reading."""
        rng = self.rng
        share = self.flaws.corrupt * self.stages.faults
        number = int(rng.poisson(share * NOISE_BLOCK * self.count))
        reading = rng.integers(NOISE_BLOCK, size=number)
        taxel = rng.integers(self.count, size=number)
        sign = rng.choice([-1.0, 1.0], size=number)
        return reading, taxel, sign * rng.uniform(*self.flaws.corrupt_size, size=number)

    def take(self, readings: int) -> FlawBlock:
        """Return the numbers of the next readings, none beyond a block."""
        within = self.given % NOISE_BLOCK
        if self.given and within == 0:
            self.block = self.draw_block()
        self.given += readings
        part = slice(within, within + readings)
        block = self.block
        reading, taxel, size = block.corrupt
        inside = (reading >= part.start) & (reading < part.stop)
        return FlawBlock(
            block.rest[part],
            block.swinging[part],
            block.again[part],
            (reading[inside] - within, taxel[inside], size[inside]),
        )

    def add_to_levels(
        self,
        block: FlawBlock,
        arrays: TaxelArrays,
        level: Float[np.ndarray, "reading taxel"],
        shifts: Float[np.ndarray, "reading taxel"],
    ) -> None:
        """Add crosstalk, drift and lost contacts to levels and shifts, in place."""
        if any(self.coupling):
            couple_levels(self.coupling, arrays, level)
        shifts += block.rest
        taxels = self.flaws.intermittent
        if len(taxels):
            level[:, taxels] = np.where(
                block.swinging, self.flaws.swings, level[:, taxels]
            )

    def change_counts(
        self, block: FlawBlock, counts: Int[np.ndarray, "reading taxel"]
    ) -> None:
        """Make values corrupt and repeat readings, in place."""
        reading, taxel, size = block.corrupt
        wrong = counts[reading, taxel] + np.round(size * self.full).astype(np.int32)
        counts[reading, taxel] = np.clip(wrong, 0, self.full)
        if self.flaws.repeated:
            repeat_readings(block.again, self.patch, self.last, counts)


def compute_part(step: float, seconds: float) -> float:
    """Return the part of the way that an exponential goes in one step."""
    return float(1.0 - np.exp(-step / seconds)) if seconds > 0.0 else 1.0
