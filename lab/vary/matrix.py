"""Simulate a matrix of taxels of 10 bits with crosstalk, as most people build one.

A taxel takes a share of the counts of the others of its row, and of its column. Rest
and gain differ from taxel to taxel. Touches of a fingertip or a palm follow each other
with pauses.
"""

from dataclasses import dataclass, fields, replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.app import nominal_calibration
from eskin.robot import load_robot
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration
from eskin.units import NS_PER_S
from lab.flaws.scoring import TrueContact

SIDE = 16
PITCH = 0.0045
"""Rows and columns, and the distance of neighbouring taxels [m]."""
RATE = 30.0
FULL_SCALE = 1023
"""Scans a second, and the largest counts."""
REST = (40.0, 90.0)
GAIN_SIGMA = 0.3
NOISE = 1.2
GRAIN = 0.01
"""Range of the counts at rest, the spread of the gains and the noise, in counts and as
a share of the pressure."""
HALF_SCALE = 60.0
EXPONENT = 0.9
"""Pressure of half scale [kPa], and exponent of the conductance."""
TIP = 0.005
PALM = 0.02
"""Standard deviation of the pressure of a fingertip and of a palm over distance [m]."""
DEAD = 5
"""Column that is dead where one is."""
LOOSE = 18.0
"""Time for which a loose matrix moves before the first touch [s]."""
START = 2.0
"""Time before the first touch [s]."""
KINDS = ("poke", "double_pat", "stroke", "circle", "palm", "rub", "hold")
"""Touches, which are drawn with equal chance."""
FIRST_STAMP = 10**18
Pressures = Float[np.ndarray, "taxel"]


@dataclass(frozen=True)
class MatrixPlan:
    """A plan holds the flaws of a matrix, and the events on it."""

    crosstalk: float = 0.05
    """Share of the counts of a taxel that is shared out to its row and column, half to
    each taxel of either."""
    dead: bool = False
    """Whether a column is dead."""
    release: float = 0.0
    """Time constant with which a taxel falls when it is let go [s]."""
    creep: float = 0.0
    """Share of the pressure that stays after a touch, and falls in `creep_seconds`."""
    creep_seconds: float = 2.0
    falling: bool = False
    """Whether counts fall under pressure; the calibration does not tell."""
    events: bool = False
    """Whether a hand lies on it at the start, taxels fail and data is lost."""
    loose: bool = False
    """Whether rows and the whole patch move and return before the first touch."""
    drift: float = 0.0
    """Counts by which all taxels have drifted since they were calibrated."""
    rests: float = 0.0
    """Time for which a hand rests on it before the touches [s]; it eases meanwhile."""


@final
@dataclass(frozen=True, eq=False)
class Recorded:
    """The scans of a matrix, with the truth."""

    stamps: Int[np.ndarray, "scan"]
    counts: Int[np.ndarray, "scan taxel"]
    received: Bool[np.ndarray, "scan taxel"]
    truths: tuple[TrueContact, ...]
    sound: Bool[np.ndarray, "taxel"]
    """Taxels that are not faulty at any time."""
    rest: Float[np.ndarray, "taxel"]


def build_matrix_skin() -> MountedSkin:
    """Build the skin of the matrix."""
    skin = build_grid_skin(SIDE, SIDE, PITCH, calibrated=True)
    return MountedSkin(skin, load_robot("table"))


def build_calibration(
    plan: MatrixPlan, mounted: MountedSkin, rest: Float[np.ndarray, "taxel"] | None
) -> Calibration:
    """Build the nominal calibration, with counts at rest where they are known.

    How slowly the sensor releases is known too, to front ends that can be told.
    """
    calibration = nominal_calibration(mounted.skin).with_full_scale(FULL_SCALE)
    known = {one.name for one in fields(calibration)}
    if plan.release and "release_seconds" in known:
        calibration = replace(calibration, **{"release_seconds": plan.release})
    return replace(calibration, rest=rest)


@final
class Matrix:
    """A matrix is a simulated sensor that scans of touches are taken of; stateful."""

    def __init__(self, plan: MatrixPlan, mounted: MountedSkin, seed: int) -> None:
        """Draw the taxels."""
        self.plan = plan
        self.skin = mounted.skin
        self.rng = np.random.default_rng((seed, 31))
        count = self.skin.count
        self.rest = self.rng.uniform(*REST, count)
        self.gain = np.exp(GAIN_SIGMA * self.rng.standard_normal(count))
        self.sound = np.ones(count, bool)
        if plan.dead:
            self.sound &= self.skin.columns != DEAD
        self.shown = np.zeros(count)
        self.crept = np.zeros(count)
        self.counts: list[np.ndarray] = []
        self.received: list[np.ndarray] = []
        self.forces: list[float] = []
        self.centres: list[np.ndarray] = []
        self.kinds: list[tuple[int, str]] = []

    @property
    def seconds(self) -> float:
        """Time since the start [s]."""
        return len(self.counts) / RATE

    def compute_pressure(
        self, x: float, y: float, force: float, width: float
    ) -> Pressures:
        """Return the pressure of a force [N] about a place [kPa]."""
        place = np.array([x, y])
        squares = ((self.skin.positions[:, :2] - place) ** 2).sum(axis=1)
        weights = np.exp(-0.5 * squares / width**2)
        return force * weights / (weights * self.skin.areas).sum() / 1000.0

    def lag(self, pressure: Pressures) -> Pressures:
        """Return what the sensor shows of a pressure, after its release and creep."""
        plan = self.plan
        period = 1.0 / RATE
        falls = pressure < self.shown
        keep = np.exp(-period / plan.release) if plan.release else 0.0
        slow = pressure + keep * (self.shown - pressure)
        self.shown = np.where(falls, slow, pressure)
        self.crept *= np.exp(-period / plan.creep_seconds)
        self.crept = np.maximum(self.crept, plan.creep * self.shown)
        return np.maximum(self.shown, self.crept)

    def scan(self, pressure: Pressures | None = None, force: float = 0.0) -> None:
        """Take a scan under a pressure [kPa] of a force [N]."""
        plan = self.plan
        skin = self.skin
        pressure = np.zeros(skin.count) if pressure is None else pressure
        grain = 1.0 + GRAIN * self.rng.standard_normal(skin.count)
        shown = np.maximum(self.lag(pressure) * self.gain * grain, 0.0)
        conductance = (shown / HALF_SCALE) ** EXPONENT
        above = FULL_SCALE * conductance / (1.0 + conductance)
        rows = np.bincount(skin.rows, above)[skin.rows]
        columns = np.bincount(skin.columns, above)[skin.columns]
        above = above + 0.5 * plan.crosstalk * (rows + columns - 2.0 * above)
        counts = self.rest + above * (1.0 - self.rest / FULL_SCALE)
        counts += NOISE * self.rng.standard_normal(skin.count)
        if plan.dead:
            counts[skin.columns == DEAD] = 0.0
        if plan.loose:
            self.loosen(counts)
        if plan.falling:
            counts = FULL_SCALE - counts
        received = np.ones(skin.count, bool)
        if plan.events:
            received[:] = self.disturb(counts)
        self.counts.append(np.clip(np.round(counts), -1, FULL_SCALE).astype(np.int16))
        self.received.append(received)
        self.forces.append(force)
        centre = np.full(3, np.nan)
        if force > 0.0:
            centre = np.average(skin.positions, axis=0, weights=pressure)
        self.centres.append(centre)

    def loosen(self, counts: Float[np.ndarray, "taxel"]) -> None:
        """Move a row, or the whole patch, for half a second of every three."""
        turn, phase = divmod(self.seconds, 3.0)
        if self.seconds < LOOSE and 1.5 < phase < 2.0:
            moved = self.skin.rows == turn if turn % 2.0 else self.skin.rows >= 0
            counts[moved] += (-30.0, 90.0, -FULL_SCALE)[int(turn) % 3]

    def disturb(self, counts: Float[np.ndarray, "taxel"]) -> bool:
        """Let taxels and the plug fail; return whether data arrives."""
        t = self.seconds
        rng = self.rng
        skin = self.skin
        floating = (skin.rows == 12) & (t > 50.0)
        counts[floating] += 150.0 * rng.standard_normal(int(floating.sum()))
        single = {20: t > 15.0, 75: t > 25.0, 130: 35.0 < t < 37.0, 201: t > 20.0}
        for taxel, is_faulty in single.items():
            self.sound[taxel] = False
            if is_faulty:
                jump = 80.0 * (rng.random() < 0.5)
                stuck = {20: 200.0, 75: FULL_SCALE, 130: -1.0, 201: counts[201] + jump}
                counts[taxel] = stuck[taxel]
        self.sound &= skin.rows != 12
        if 80.0 < t % 100.0 < 80.15:
            counts[:] = 0.0
        if round(t * RATE) % 301 == 300:
            counts[rng.random(skin.count) < 0.9] = rng.uniform(0.0, FULL_SCALE)
        if rng.random() < 0.02:
            counts[rng.integers(skin.count)] = rng.uniform(0.0, FULL_SCALE)
        is_lost = t % 7.0 < 0.12 or rng.random() < 0.02
        return not (is_lost or 60.0 < t < 71.0 or 75.0 < t < 75.6)

    def wait(self, seconds: float) -> None:
        """Take scans without a touch."""
        for _ in range(round(seconds * RATE)):
            self.scan()

    def perform(self, kind: str) -> None:
        """Take the scans of a touch."""
        self.kinds.append((len(self.counts), kind))
        x, y = self.rng.uniform(-0.018, 0.018, 2)
        force = self.rng.uniform(3.0, 7.0)
        if kind == "double_pat":
            for _ in range(2):
                self.press([(x, y)] * 5, force)
                self.wait(self.rng.uniform(0.15, 0.3))
        elif kind == "poke":
            self.press([(x, y)] * round(self.rng.uniform(0.25, 0.6) * RATE), force)
        elif kind == "palm":
            self.press([(0.3 * x, 0.3 * y)] * round(1.5 * RATE), 5.0 * force, PALM)
        elif kind == "hold":
            self.press([(x, y)] * round(self.rng.uniform(3.0, 6.0) * RATE), force)
        else:
            u = np.linspace(0.0, 1.0, round(1.3 * RATE))
            stroke = [(0.05 * (one - 0.5), y) for one in u]
            circle = [(0.02 * np.cos(one), 0.02 * np.sin(one)) for one in 6.3 * u]
            rub = [(x + 0.018 * np.sin(one), y) for one in 19.0 * u]
            self.press({"stroke": stroke, "circle": circle, "rub": rub}[kind], force)

    def rest_hand(self, seconds: float) -> None:
        """Take the scans of fingers that rest, and ease to a third of their force."""
        self.kinds.append((len(self.counts), "rest"))
        steps = np.linspace(0.0, 1.0, round(seconds * RATE))
        for share in np.interp(steps, [0.0, 0.3, 0.4, 1.0], [1.0, 1.0, 0.33, 0.33]):
            force = 8.0 * share * (1.0 + 0.05 * self.rng.standard_normal())
            self.scan(self.compute_pressure(0.0, 0.0, force, 2.0 * TIP), force)
        self.wait(2.0)

    def press(
        self, path: list[tuple[float, float]], force: float, width: float = TIP
    ) -> None:
        """Take the scans of a pressure that moves along a path."""
        for n, (x, y) in enumerate(path):
            rise = min((n + 1) / 2.0, (len(path) - n) / 2.0, 1.0)
            now = force * rise * (1.0 + 0.1 * self.rng.standard_normal())
            now = max(now, 0.1)
            self.scan(self.compute_pressure(x, y, now, width), now)

    def build(self) -> Recorded:
        """Return the scans so far."""
        count = len(self.counts)
        stamps = FIRST_STAMP + np.round(np.arange(count) / RATE * NS_PER_S).astype(int)
        forces = np.array(self.forces)
        centres = np.array(self.centres)
        bounds = [start for start, _ in self.kinds] + [count]
        truths = tuple(
            TrueContact(kind, stamps[start:end], forces[start:end], centres[start:end])
            for (start, kind), end in zip(self.kinds, bounds[1:], strict=True)
        )
        return Recorded(
            stamps,
            np.array(self.counts),
            np.array(self.received),
            truths,
            self.sound,
            self.rest,
        )


def simulate(plan: MatrixPlan, seconds: float, seed: int) -> Recorded:
    """Simulate a matrix under touches for a time [s]."""
    matrix = Matrix(plan, build_matrix_skin(), seed)
    if plan.events:
        matrix.press([(0.0, 0.0)] * round(4.0 * RATE), 25.0, PALM)
        matrix.wait(4.0)
    matrix.wait(LOOSE if plan.loose else START)
    if plan.rests:
        matrix.rest_hand(plan.rests)
    while matrix.seconds < seconds:
        matrix.perform(str(matrix.rng.choice(KINDS)))
        matrix.wait(matrix.rng.uniform(0.8, 2.0))
    return matrix.build()
