"""A build is one sensor as made: its laminate, its readout and its defects."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.constants import MM, Constants
from eskin.sim.sensor.velostat import Velostat, build_nominal_velostat, draw_velostat
from eskin.skin import Skin
from eskin.touch import Calibration


@dataclass(frozen=True, eq=False)
class Defects:
    """Defects are lasting faults of taxels and lines, and on the way to the host."""

    dead: Bool[np.ndarray, "taxel"]
    """Taxels, alone or in a dead row or column, that no longer respond."""
    stuck: Float[np.ndarray, "taxel"]
    """Reading of a stuck taxel, relative to full scale; NaN of the others."""
    lines: tuple[str, ...]
    """Dead rows and columns, such as `patch:row:3`."""
    dropped: float
    """Share of a patch's readings that do not arrive."""
    dropped_run: float
    """Mean length of a run of them [readings]."""


def build_intact_defects(skin: Skin, constants: Constants) -> Defects:
    """Return defects of a sensor in which nothing is broken."""
    whole = np.zeros(skin.count, dtype=bool)
    run = constants.value("sensor.dropped_run")
    return Defects(whole, np.full(skin.count, np.nan), (), 0.0, run)


def draw_defects(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Defects:
    """Draw the defects of a build of some kind."""
    share = constants.draw(f"sensor.defective.{kind}", rng)
    broken = rng.permutation(skin.count)[: round(share * skin.count)]
    is_stuck = rng.random(len(broken)) < constants.value("sensor.stuck")
    stuck = np.full(skin.count, np.nan)
    stuck[broken[is_stuck]] = rng.random(int(is_stuck.sum()))
    dead = np.zeros(skin.count, dtype=bool)
    dead[broken[~is_stuck]] = True
    lines = draw_lines(kind, skin, constants, rng)
    for line in lines:
        dead |= find_line_taxels(line, skin)
    return Defects(
        dead=dead,
        stuck=stuck,
        lines=lines,
        dropped=constants.value(f"sensor.dropped.{kind}"),
        dropped_run=constants.value("sensor.dropped_run"),
    )


def draw_lines(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> tuple[str, ...]:
    """Draw the dead rows and columns."""
    chance = constants.value(f"sensor.dead_line.{kind}")
    lines = [draw_line(index, skin, rng) for index in range(len(skin.patches))]
    hit = rng.random(len(lines)) < chance
    return tuple(line for line, is_hit in zip(lines, hit, strict=True) if is_hit)


def draw_line(index: int, skin: Skin, rng: np.random.Generator) -> str:
    """Draw a row or a column of a patch."""
    taxel = int(rng.choice(np.flatnonzero(skin.patch_index == index)))
    is_row = bool(rng.random() < 0.5)
    number = (skin.rows if is_row else skin.columns)[taxel]
    return f"{skin.patches[index].id}:{'row' if is_row else 'column'}:{number}"


def find_line_taxels(line: str, skin: Skin) -> Bool[np.ndarray, "taxel"]:
    """Find the taxels of a line that is named as in `Defects.lines`."""
    patch, what, number = line.rsplit(":", 2)
    inside = np.zeros(skin.count, dtype=bool)
    inside[skin.find_taxels(patch)] = True
    numbers = skin.rows if what == "row" else skin.columns
    return inside & (numbers == int(number))


@dataclass(frozen=True, eq=False)
class Electronics:
    """The electronics hold what is fixed of the readout."""

    bits: int
    """Resolution of the converter."""
    ghost: float
    """Part of each detour over three other taxels that a taxel reads."""
    ghost_least: float
    """Part below which ghosts are left out."""
    leak: float
    """Part of each other taxel of its row and column that a taxel reads."""
    base: Float[np.ndarray, "taxel"]
    """Reading of a free taxel, relative to full scale."""
    walk: float
    """Step of the baseline's random walk [counts]."""
    after: float
    """Standard deviation of the baseline's shift after a touch, relative to full
    scale."""
    after_whole: float
    """Signal relative to full scale from which a touch leaves the whole shift."""
    after_time: Float[np.ndarray, "taxel"]
    """Time constant in which the shift decays [s]."""
    noise: float
    """Standard deviation of a reading [counts]."""
    noise_relative: float
    """Standard deviation relative to the reading itself; variances add up."""
    phase: Float[np.ndarray, "patch"]
    """Age of a patch's scan when a reading is assembled [s]."""
    scan: float
    """Time to scan all rows of a patch [s]."""
    jitter: float
    """Standard deviation of a scan's time [s]."""
    period: float
    """Time between two readings [s]."""
    step: float
    """Time between two values of the incoming pressure [s]."""

    @property
    def full_scale(self) -> int:
        """Return the largest count of the converter."""
        return 2**self.bits - 1


def build_nominal_electronics(skin: Skin, constants: Constants) -> Electronics:
    """Build a readout without ghosts, drift and noise that reads all taxels at once."""
    whole = constants.value("sensor.noise_bits")
    return Electronics(
        bits=round(whole),
        ghost=0.0,
        ghost_least=constants.value("sensor.ghost_least"),
        leak=0.0,
        base=np.zeros(skin.count),
        walk=0.0,
        after=0.0,
        after_whole=constants.value("sensor.after_whole"),
        after_time=np.ones(skin.count),
        noise=0.0,
        noise_relative=0.0,
        phase=np.zeros(len(skin.patches)),
        scan=0.0,
        jitter=0.0,
        period=constants.value("sensor.period"),
        step=constants.value("time.step"),
    )


def draw_electronics(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Electronics:
    """Draw the readout of a build of some kind."""
    bits = int(constants.choose(f"sensor.bits.{kind}", rng))
    coarser = 2.0 ** (bits - constants.value("sensor.noise_bits"))
    draw = constants.draw
    return Electronics(
        bits=bits,
        ghost=draw(f"sensor.ghost.{kind}", rng),
        ghost_least=constants.value("sensor.ghost_least"),
        leak=draw(f"sensor.leak.{kind}", rng),
        base=np.array([draw("sensor.base", rng) for _ in range(skin.count)]),
        walk=constants.value("sensor.walk") * coarser,
        after=constants.value(f"sensor.after.{kind}"),
        after_whole=constants.value("sensor.after_whole"),
        after_time=np.array(
            [draw("sensor.after_time", rng) for _ in range(skin.count)]
        ),
        noise=draw(f"sensor.noise.{kind}", rng) * coarser,
        noise_relative=constants.value("sensor.noise_relative"),
        phase=np.array([draw("sensor.phase", rng) for _ in skin.patches]),
        scan=draw("sensor.scan", rng),
        jitter=draw("sensor.jitter", rng),
        period=constants.value("sensor.period"),
        step=constants.value("time.step"),
    )


@dataclass(frozen=True, eq=False)
class SensorBuild:
    """A build holds everything fixed of the skin on one robot."""

    name: str
    """Name of the build."""
    kind: str
    """`fresh` as in training, `shifted` with wider laws, or `nominal`."""
    velostat: Velostat
    """Laminate, from pressure to conductance."""
    electronics: Electronics
    """Readout, from conductance to counts."""
    defects: Defects
    """Defects of the build."""
    film_sigma: float
    """Standard deviation of the film's Gaussian spread of pressure [m]."""
    nominal_exponent: float
    """Exponent that its calibration assumes."""
    nominal_activation: float
    """Pressure that its calibration assumes to close a taxel [kPa]."""
    nominal_half: float
    """Pressure at which a nominal taxel reads half scale [kPa]."""

    def calibration(self, skin: Skin) -> Calibration:
        """Return the calibration of its user: converter and nominal taxel, no gains."""
        full_scale = self.electronics.full_scale
        return Calibration(
            np.full(skin.count, self.nominal_half / full_scale),
            full_scale,
            curve="divider",
            exponent=self.nominal_exponent,
            unfelt=self.nominal_activation,
            matrix=True,
        )


def draw_build(
    name: str,
    kind: Literal["fresh", "shifted"],
    skin: Skin,
    constants: Constants,
    rng: np.random.Generator,
) -> SensorBuild:
    """Draw the skin of one robot."""
    velostat = draw_velostat(kind, skin, constants, rng)
    return SensorBuild(
        name=name,
        kind=kind,
        velostat=velostat,
        electronics=draw_electronics(kind, skin, constants, rng),
        defects=draw_defects(kind, skin, constants, rng),
        film_sigma=constants.draw("film.sigma", rng) * MM,
        nominal_exponent=constants.value("sensor.nominal_exponent"),
        nominal_activation=constants.value("sensor.nominal_activation"),
        nominal_half=compute_nominal_half(velostat.half_pressure, constants),
    )


def build_nominal_sensor(skin: Skin, constants: Constants) -> SensorBuild:
    """Build a skin without scatter, noise and faults, to measure the chain with."""
    velostat = build_nominal_velostat(skin, constants)
    return SensorBuild(
        name="nominal",
        kind="nominal",
        velostat=velostat,
        electronics=build_nominal_electronics(skin, constants),
        defects=build_intact_defects(skin, constants),
        film_sigma=0.0,
        nominal_exponent=constants.value("sensor.nominal_exponent"),
        nominal_activation=constants.value("sensor.nominal_activation"),
        nominal_half=compute_nominal_half(velostat.half_pressure, constants),
    )


def compute_nominal_half(half_pressure: float, constants: Constants) -> float:
    """Return the pressure that calibration takes for half scale [kPa].

    With it a nominal taxel reads the true value of what is pressed for a time, with its
    play and creep.
    """
    seconds = constants.value("sensor.calibrated_at")
    exponent = constants.value("sensor.nominal_exponent")
    grown = (1.0 + compute_creep(seconds, constants)) ** (1.0 / exponent)
    return float(half_pressure / compute_play_remainder(constants) / grown)


def compute_play_remainder(constants: Constants) -> float:
    """Return the part of a load that only grew which the play operators pass on."""
    weights = constants.array("sensor.play_weights.fresh")
    return float(np.sum(weights * (1.0 - constants.array("sensor.play"))))


def compute_creep(seconds: float, constants: Constants) -> float:
    """Return the relative growth of conductance after a time under load."""
    risen = 1.0 - np.exp(-seconds / constants.array("sensor.creep_times"))
    return float(np.sum(constants.array("sensor.creep") * risen))
