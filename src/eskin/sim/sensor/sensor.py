"""The sensor turns pressures of touched taxels into counts of all."""

from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtri

from eskin.sim.sensor.build import SensorBuild
from eskin.sim.sensor.flaw_kernels import lag_conductance
from eskin.sim.sensor.flawed_readings import FlawedReadings
from eskin.sim.sensor.kernels import convert_to_counts, scan_arrays, update_conductance
from eskin.sim.sensor.model import (
    SensorSession,
    SensorStages,
    build_converter,
    build_layer_state,
    build_readout,
    build_sensor_layer,
    build_taxel_arrays,
    compute_free_load,
    compute_taxel_ages,
    draw_session,
)
from eskin.sim.sensor.noise import (
    NOISE_BLOCK,
    NOISE_LEVELS,
    ReadingLosses,
    ReadingNoise,
)
from eskin.sim.sensor.proximity import add_proximity
from eskin.skin import Skin

DRAWN_TOUCHES = 8
"""Touches of a taxel whose after-effects are drawn; later ones repeat them."""

MAX_JITTER_DEVIATIONS = 6.0
"""Deviations of a scan's time that are never exceeded."""

MAX_DELAY_PERIODS = 2
"""Periods within which a reading must be read."""


ROUNDING = 1e-9
"""Part of a reading by which its last step may be missing, by rounding."""


@final
class Sensor:
    """A sensor is one build that is pressed and read step by step.

    What is drawn does not depend on the pressure, nor on how many steps and readings
    are asked for at a time.

    Attributes:
        losses: draws which readings do not arrive.
        noise: draws the noise of the readings to come.
        readout: converter.
    """

    def __init__(
        self,
        build: SensorBuild,
        skin: Skin,
        rng: np.random.Generator,
        stages: SensorStages | None = None,
        session: SensorSession | None = None,
        live: Int[np.ndarray, "live"] | None = None,
    ) -> None:
        """Begin before the first step, untouched.

        All stages work, the session is drawn, and all taxels may conduct unless given;
        `live` taxels are sorted by patch.
        """
        stages = stages or SensorStages()
        seeds = rng.integers(2**63, size=6).tolist()
        streams = [np.random.Generator(np.random.SFC64(seed)) for seed in seeds]
        session = session or draw_session(build, streams[0])
        electronics = build.electronics
        if live is None:
            live = np.argsort(skin.patch_index, kind="stable")
        after = draw_after(build, skin.count, streams[1])
        ages = compute_taxel_ages(build, skin, stages)
        self.count = skin.count
        self.live = live
        self.layer = build_sensor_layer(live, build, session, stages, after)
        self.state = build_layer_state(self.layer)
        self.losses = ReadingLosses(
            build.defects, len(skin.patches), streams[2], stages
        )
        self.noise = ReadingNoise(
            len(skin.patches), skin.count, (streams[3], streams[4], streams[5])
        )
        self.arrays = build_taxel_arrays(live, ages, skin)
        self.readout = build_readout(build, stages)
        # Ghosts and leak that are strong enough to compute.
        parts = (electronics.ghost, electronics.leak)
        strong = [part * (part >= electronics.ghost_least) for part in parts]
        self.crosstalk = tuple(part * stages.ghosting for part in strong)
        self.converter = build_converter(build, stages)
        self.jitter = electronics.jitter * stages.skew
        self.step = electronics.step
        reach = (
            ages.max(initial=0.0) + MAX_JITTER_DEVIATIONS * self.jitter
        ) / self.step
        self.reach = int(np.ceil(reach)) + 1
        self.kept = self.reach + MAX_DELAY_PERIODS * round(
            electronics.period / self.step
        )
        self.flawed = None
        if build.flaws:
            seed = streams[0].spawn(1)[0]
            self.flawed = FlawedReadings(
                build, build.flaws, skin, session, stages, seed
            )
            self.release = self.flawed.build_release(self.layer)
        self.drift = np.zeros(skin.count, np.float32)
        self.conductance = np.zeros((0, len(live)), np.float32)
        self.shift = np.zeros_like(self.conductance)
        self.first = 0

    @property
    def steps(self) -> int:
        """Return the steps since the beginning."""
        return self.first + len(self.conductance)

    def simulate_steps(
        self,
        pressure: Float[np.ndarray, "time active"],
        taxels: Int[np.ndarray, "active"],
    ) -> None:
        """Simulate further steps.

        `pressure` is that of the active taxels after the film [kPa]; all others are
        free.
        """
        column = np.full(self.count, -1, dtype=np.int64)
        column[taxels] = np.arange(len(taxels))
        kept = min(self.kept, len(self.conductance))
        shape = (kept + len(pressure), len(self.live))
        conductance = np.zeros(shape, np.float32)
        shift = np.zeros(shape, np.float32)
        conductance[:kept] = self.conductance[len(self.conductance) - kept :]
        shift[:kept] = self.shift[len(self.shift) - kept :]
        self.first = self.steps - kept
        self.conductance = conductance
        self.shift = shift
        update_conductance(
            np.asarray(pressure, np.float64),
            column[self.live],
            self.layer,
            self.state,
            conductance[kept:],
            shift[kept:],
        )
        if self.flawed:
            lag_conductance(*self.release, conductance[kept:])

    def read(
        self, places: Float[np.ndarray, "reading"]
    ) -> Int[np.ndarray, "reading taxel"]:
        """Return the counts of the next readings, no more than `noise.remaining`.

        Args:
            places: steps since the beginning at which readings are assembled. What is
                scanned later than the last step there is, is scanned at that step.

        Raises:
            ValueError: a reading is so old that its scan is forgotten.
        """
        if self.first and places.min() - self.reach < self.first:
            raise ValueError(
                f"step {places.min():g} is to be read after step {self.steps - 1}; "
                f"allowed are {MAX_DELAY_PERIODS} periods; read more often"
            )
        noise = self.noise.draw_rows(len(places))
        shape = (len(places), self.count)
        level = np.zeros(shape, np.float32)
        shifts = np.zeros(shape, np.float32)
        scan_arrays(
            self.conductance,
            self.shift,
            self.arrays,
            places,
            noise.late * self.jitter,
            self.step,
            *self.crosstalk,
            self.converter,
            self.first,
            level,
            shifts,
        )
        block = None
        if self.flawed:
            block = self.flawed.take(len(places))
            self.flawed.add_to_levels(block, self.arrays, level, shifts)
        counts = np.zeros(shape, np.int32)
        convert_to_counts(
            level,
            shifts,
            noise.chances,
            noise.signs,
            compute_normal_quantiles(),
            self.drift,
            self.readout,
            counts,
        )
        if self.flawed and block:
            self.flawed.change_counts(block, counts)
        return counts


def draw_after(
    build: SensorBuild, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "touch taxel"]:
    """Draw the shifts of the baseline after each touch of each taxel."""
    shape = (DRAWN_TOUCHES, count)
    after = build.electronics.after * rng.standard_normal(shape)
    if build.flaws and build.flaws.after_tail:
        large = build.flaws.after_tail_size * rng.choice([-1.0, 1.0], shape)
        after = np.where(rng.random(shape) < build.flaws.after_tail, large, after)
    return after


@lru_cache(maxsize=1)
def compute_normal_quantiles() -> Float[np.ndarray, "chance"]:
    """Return equally likely values of the normal law, cached."""
    chances = (np.arange(NOISE_LEVELS) + 0.5) / NOISE_LEVELS
    return ndtri(chances).astype(np.float32)


def sense(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    build: SensorBuild,
    skin: Skin,
    rng: np.random.Generator,
    stages: SensorStages | None = None,
    session: SensorSession | None = None,
    lead: int = 0,
) -> tuple[Int[np.ndarray, "reading taxel"], Bool[np.ndarray, "reading taxel"]]:
    """Simulate what the skin counts, and which counts arrive.

    The same numbers are drawn whatever the stages and the pressure, so two calls with
    generators in the same state can be compared. Pressure after the film [kPa] is given
    at steps of `time.step`, `lead` of them before the first reading, in which creep
    builds up. All stages work, and the session is drawn, unless given.

    Raises:
        ValueError: pressure and taxels do not belong together.
    """
    if pressure.ndim != 2 or pressure.shape[1] != len(taxels):
        raise ValueError(
            f"pressure has shape {pressure.shape} for {len(taxels)} taxels; allowed is "
            "one column a taxel; pass the taxels that it is of"
        )
    if not np.isfinite(pressure).all():
        raise ValueError(
            "pressure is not finite everywhere; allowed are finite numbers [kPa]; "
            "correct the contact that it comes from"
        )
    if len(np.unique(taxels)) != len(taxels):
        raise ValueError(
            "taxels name some taxel twice; allowed is once; add their pressures"
        )
    if not 0 <= lead <= len(pressure):
        raise ValueError(
            f"lead is {lead} for {len(pressure)} steps; allowed is from 0 to all of "
            "them; pass a longer series"
        )
    stages = stages or SensorStages()
    if stages.proximity:
        pressure, taxels = add_proximity(pressure, taxels, build, skin)
    conducts = compute_free_load(build, stages) > 0.0
    conducts[taxels[pressure.max(axis=0, initial=0.0) > 0.0]] = True
    live = np.flatnonzero(conducts)
    live = live[np.argsort(skin.patch_index[live], kind="stable")]
    sensor = Sensor(build, skin, rng, stages, session, live)
    sensor.simulate_steps(pressure, taxels)
    ratio = build.electronics.period / build.electronics.step
    readings = int((len(pressure) - lead) / ratio + ROUNDING)
    places = lead + ratio * np.arange(readings, dtype=np.float64)
    counts = np.zeros((readings, skin.count), np.int32)
    for start in range(0, readings, NOISE_BLOCK):
        part = slice(start, start + NOISE_BLOCK)
        counts[part] = sensor.read(places[part])
    # An index would leave rows with gaps, for which the kernels were compiled anew.
    received = ~sensor.losses.draw_all(readings).take(skin.patch_index, axis=1)
    counts[~received] = 0
    return counts, received


def draw_reading_times(
    build: SensorBuild, readings: int, rng: np.random.Generator
) -> Float[np.ndarray, "reading"]:
    """Draw the times of readings since the first [s], with jitter of their stamps.

    They increase, and each is nearer to its nominal time than to any other.
    """
    period = build.electronics.period
    late = np.zeros(readings)
    if build.flaws:
        late += build.flaws.stamp_jitter * rng.standard_normal(readings)
    max_late = MAX_STAMP_JITTER * period
    return np.maximum(
        period * np.arange(readings) + np.clip(late, -max_late, max_late), 0.0
    )


MAX_STAMP_JITTER = 0.45
"""Part of a period by which a stamp is off at most."""
