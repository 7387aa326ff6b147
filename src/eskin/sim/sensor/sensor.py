"""The sensor as a whole: pressures of touched taxels in, counts of all out."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtri

from eskin.sim.sensor.arrays import arrays_of, scan_ages
from eskin.sim.sensor.build import Build
from eskin.sim.sensor.sensor_kernels import Film, Readout, conduct, convert, scan
from eskin.sim.sensor.session import Session, draw_session
from eskin.skin import Skin

BLOCK = 100
"""Readings whose noise is held in memory at a time."""

WORD = 64
"""Bits of a word of random steps."""

LEVELS = 2**16
"""Values that normal noise is told apart in; the largest are 4.3 deviations."""

TOUCHES = 8
"""Touches of a taxel whose after-effects are drawn; later ones repeat them."""


@dataclass(frozen=True)
class Stages:
    """Which stages of the sensor work; one that does not passes on what it gets."""

    bending: bool = True
    """Bent laminate presses on itself."""
    threshold: bool = True
    """Small pressures do not close the gap."""
    hysteresis: bool = True
    """Load lags behind pressure."""
    power: bool = True
    """Conductance is a power of load."""
    creep: bool = True
    """Conductance grows under lasting load and is slow to forget it."""
    gain: bool = True
    """Taxels, patches and sessions differ."""
    ghosting: bool = True
    """A taxel reads others of its patch."""
    divider: bool = True
    """A divider stands before the converter."""
    drift: bool = True
    """Temperature, wandering baselines, and shifts of them after a touch."""
    noise: bool = True
    """Readings are noisy."""
    faults: bool = True
    """Taxels and lines are broken, readings do not arrive."""
    skew: bool = True
    """Patches and rows are scanned one after the other."""


def sense(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    build: Build,
    skin: Skin,
    rng: np.random.Generator,
    stages: Stages | None = None,
    session: Session | None = None,
    lead: int = 0,
) -> tuple[Int[np.ndarray, "reading taxel"], Bool[np.ndarray, "reading taxel"]]:
    """What the skin counts, and what of it arrives.

    The same numbers are drawn whatever the stages and the pressures, so two calls with
    generators in the same state can be compared.

    Args:
        pressure: of the active taxels after the film, at steps of `time.step` [kPa].
        taxels: the active ones, as indices of the skin, each once.
        build: the skin as built.
        skin: its taxels.
        rng: to draw from.
        stages: which stages work; all unless given.
        session: what has drifted since calibration; drawn unless given.
        lead: steps before the first reading, in which creep builds up.

    Raises:
        ValueError: pressures and taxels do not belong together.
    """
    check(pressure, taxels, lead)
    stages = stages or Stages()
    streams = [np.random.Generator(np.random.SFC64(seed)) for seed in seeds(rng)]
    session = session or draw_session(build, streams[0])
    electronics = build.electronics
    live, column = live_taxels(pressure, taxels, build, skin, stages)
    after = electronics.after * streams[1].standard_normal((TOUCHES, skin.count))
    film = film_of(live, build, session, stages, after)
    conductance = np.zeros((len(pressure), len(live)), np.float32)
    shift = np.zeros_like(conductance)
    conduct(np.asarray(pressure, np.float64), column, film, conductance, shift)
    ratio = round(electronics.period / electronics.step)
    readings = (len(pressure) - lead) // ratio
    received = arrivals(readings, build, skin, streams[2], stages)
    counts = np.zeros((readings, skin.count), np.int32)
    arrays = arrays_of(live, ages_of(build, skin, stages), skin)
    readout = readout_of(build, stages)
    drift = np.zeros(skin.count, np.float32)
    ghost, leak = crosstalk_of(build, stages)
    for part in blocks(readings):
        size = (part.stop - part.start, skin.count)
        late = streams[3].standard_normal((size[0], len(skin.patches)))
        level, shifts = np.zeros(size, np.float32), np.zeros(size, np.float32)
        scan(
            conductance,
            shift,
            arrays,
            lead + ratio * np.arange(part.start, part.stop, dtype=np.float64),
            late * electronics.jitter * stages.skew,
            electronics.step,
            ghost,
            leak,
            stages.divider,
            level,
            shifts,
        )
        words = (size[0], skin.count // WORD + 1)
        signs = streams[4].integers(2**WORD, size=words, dtype=np.uint64)
        chances = streams[5].integers(LEVELS, size=size, dtype=np.uint16)
        quantiles = normal_quantiles()
        convert(level, shifts, chances, signs, quantiles, drift, readout, counts[part])
    counts[~received] = 0
    return counts, received


def check(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    lead: int,
) -> None:
    """Refuse what does not belong together."""
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


def seeds(rng: np.random.Generator) -> list[int]:
    """A seed for each thing that is drawn."""
    return [int(seed) for seed in rng.integers(2**63, size=6)]


@lru_cache(maxsize=1)
def normal_quantiles() -> Float[np.ndarray, "chance"]:
    """Equally likely values of the normal law."""
    chances = (np.arange(LEVELS) + 0.5) / LEVELS
    return ndtri(chances).astype(np.float32)


def blocks(readings: int) -> Iterator[slice]:
    """All readings in parts that fit into memory."""
    for start in range(0, readings, BLOCK):
        yield slice(start, min(start + BLOCK, readings))


def live_taxels(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    build: Build,
    skin: Skin,
    stages: Stages,
) -> tuple[Int[np.ndarray, "live"], Int[np.ndarray, "live"]]:
    """Taxels that ever conduct, sorted by patch, and their columns of `pressure`."""
    column = np.full(skin.count, -1, dtype=np.int64)
    pressed = pressure.max(axis=0, initial=0.0) > 0.0
    column[taxels[pressed]] = np.flatnonzero(pressed)
    rest = load_of(build, stages) > 0.0
    live = np.flatnonzero((column >= 0) | rest)
    live = live[np.argsort(skin.patch_index[live], kind="stable")]
    return live, column[live]


def load_of(build: Build, stages: Stages) -> Float[np.ndarray, "taxel"]:
    """Load of free taxels less what closes the gap, by the half-scale pressure."""
    velostat = build.velostat
    bend = velostat.bend * stages.bending
    return (bend - velostat.activation * stages.threshold) / velostat.half_pressure


def film_of(
    live: Int[np.ndarray, "live"],
    build: Build,
    session: Session,
    stages: Stages,
    after: Float[np.ndarray, "touch taxel"],
) -> Film:
    """The laminate under the live taxels, with the stages that work."""
    velostat, electronics = build.velostat, build.electronics
    gain = np.ones(len(live))
    if stages.gain:
        gain = (velostat.gain * session.gain)[live]
    if stages.drift:
        gain = gain * (1.0 + velostat.temperature_gain * session.warmer)
    plain = np.array([0.0]), np.array([1.0])
    play = (velostat.play, velostat.play_weights) if stages.hysteresis else plain
    step = electronics.step
    return Film(
        load=load_of(build, stages)[live],
        half_pressure=velostat.half_pressure,
        exponent=velostat.exponent[live] if stages.power else np.ones(len(live)),
        gain=gain,
        play=play[0],
        play_weights=play[1],
        play_least=velostat.play_least,
        creep=velostat.creep[live] * stages.creep,
        creep_part=1.0 - np.exp(-step / velostat.creep_times),
        recovery_keep=np.exp(-step / velostat.recovery_times),
        recovery_share=velostat.recovery_share,
        after=after[:, live] * stages.drift,
        after_whole=electronics.after_whole,
        after_keep=np.exp(-step / electronics.after_time[live]),
    )


def readout_of(build: Build, stages: Stages) -> Readout:
    """The converter, with the stages that work."""
    electronics, defects = build.electronics, build.defects
    full = electronics.full_scale
    stuck = np.where(np.isnan(defects.stuck), -1.0, np.round(full * defects.stuck))
    feels = np.where(defects.dead & stages.faults, 0.0, 1.0)
    return Readout(
        full=float(full),
        base=(electronics.base * full).astype(np.float32),
        walk=electronics.walk * stages.drift,
        noise=electronics.noise * stages.noise,
        noise_relative=electronics.noise_relative * stages.noise,
        feels=feels.astype(np.float32),
        stuck=(stuck if stages.faults else np.full(len(stuck), -1.0)).astype(np.int32),
    )


def crosstalk_of(build: Build, stages: Stages) -> tuple[float, float]:
    """Ghosts and leak that are worth computing."""
    electronics = build.electronics
    parts = (electronics.ghost, electronics.leak)
    ghost, leak = (part * (part >= electronics.ghost_least) for part in parts)
    return ghost * stages.ghosting, leak * stages.ghosting


def ages_of(build: Build, skin: Skin, stages: Stages) -> Float[np.ndarray, "taxel"]:
    """When taxels are scanned before their reading is put together [s]."""
    if not stages.skew:
        return np.zeros(skin.count)
    return scan_ages(build.electronics.phase, build.electronics.scan, skin)


def arrivals(
    readings: int, build: Build, skin: Skin, rng: np.random.Generator, stages: Stages
) -> Bool[np.ndarray, "reading taxel"]:
    """Which taxels' readings arrive; those of a patch get lost together, in runs."""
    share, run = build.defects.dropped, build.defects.dropped_run
    chance = rng.random((readings + 1, len(skin.patches)))
    lost = np.zeros((readings, len(skin.patches)), dtype=bool)
    if stages.faults and share > 0.0:
        begin, stay = share / (1.0 - share) / run, 1.0 - 1.0 / run
        gone = chance[-1] < share
        for reading in range(readings):
            lost[reading] = gone
            gone = chance[reading] < np.where(gone, stay, begin)
    return ~lost[:, skin.patch_index]
