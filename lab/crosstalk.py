"""Press matrices with crosstalk and dead lines, and count taxels left out.

    python -m lab.crosstalk play OUT.json           # all parts, by the eskin imported
    python -m lab.crosstalk play OUT.json --quick   # one seed of 40 s
    python -m lab.crosstalk compare OLD.json NEW.json

A matrix of 16 x 16 taxels of 10 bits, read 30 times a second, lies on a cylinder. Its
taxels read 4 to 9 % of full scale at rest and have gains of their own. Half of the
crosstalk of what each taxel measures is added to each other taxel of its row, the other
half to those of its column. Dead lines read zero: one column, then a row as well. Short
strokes, presses, circles, palms and rubs follow each other, 0.8 to 2 s apart. Size,
rate, bits and curve of the sensor are varied one at a time, with crosstalk of 5 % and
one dead line. `ur5` presses the preset skin of a UR5 in the same way.

Counts depend on the seed alone. Each result holds their digest, and only results of the
same counts are compared. Intervals are those of a binomial share of 95 %.
"""

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Literal, final

import numpy as np
import tyro
from jaxtyping import Bool, Float, Int
from scipy.special import betaincinv

from eskin import MountedSkin
from eskin.app import nominal_calibration
from eskin.design.placing import MatrixSpec, place_matrix
from eskin.robot import load_robot
from eskin.sim.constants import load_constants
from eskin.sim.sensor import FAMILIES, draw_flawed_build
from eskin.skin import load_skin
from eskin.touch import Calibration, Scan, TouchPipeline
from eskin.units import NS_PER_S
from lab.tables import format_head, format_row

URDF = """<robot name="arm"><link name="base"/><joint name="j" type="revolute">
<parent link="base"/><child link="forearm"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint><link name="forearm">
<collision><origin xyz="0 0 0.15"/><geometry><cylinder radius="0.045" length="0.3"/>
</geometry></collision></link></robot>"""
PITCH = 0.0045
"""Distance of the taxels of a matrix [m]."""
REST = (0.04, 0.09)
"""Range of readings at rest, by full scale."""
NOISE = 1.2 / 1023.0
"""Standard deviation of a reading, by full scale."""
GAIN = 0.3
"""Standard deviation of the logarithm of the gains of taxels."""
UNSTEADY = 0.01
"""The same of the pressure of a taxel from one reading to the next."""
HALF = 60.0
EXPONENT = 0.9
"""Pressure at which a divider reads half scale [kPa], and its exponent."""
SETTLING = 2.0
"""Time without touch at the start, after which taxels that are left out count [s]."""
LINGER = 0.75
"""Time after a touch from which none should be open [s]."""
Counted = dict[str, float | str]
Found = dict[str, list[Counted]]
"""What was counted with each seed, by the name of a condition."""


@dataclass(frozen=True)
class Condition:
    """A condition says what matrix is pressed."""

    crosstalk: float
    """Crosstalk, by what a taxel measures."""
    dead: int = 0
    """Number of dead lines: a column, then a row."""
    size: int = 16
    """Number of rows, and of columns."""
    rate: int = 30
    """Readings a second."""
    bits: int = 10
    """Resolution of the converter."""
    curve: str = "preset"
    """Family of the sensor, or `preset` for the one of the preset skins."""
    skin: Literal["matrix", "ur5"] = "matrix"
    """Skin that is pressed."""

    @property
    def full(self) -> int:
        """Return the largest count of the converter."""
        return 2**self.bits - 1


VARIED = Condition(0.05, 1)
PARTS: dict[str, dict[str, Condition]] = {
    "matrix": {
        f"crosstalk {crosstalk:.0%}, dead lines {dead}": Condition(crosstalk, dead)
        for crosstalk in (0.0, 0.02, 0.05, 0.1)
        for dead in (0, 1, 2)
    },
    "size": {f"{n} x {n}": replace(VARIED, size=n) for n in (8, 24)},
    "rate": {f"{rate} Hz": replace(VARIED, rate=rate) for rate in (12, 100)},
    "bits": {f"{bits} bits": replace(VARIED, bits=bits) for bits in (8, 12)},
    "curve": {family: replace(VARIED, curve=family) for family in FAMILIES},
    "ur5": {
        f"ur5, crosstalk {crosstalk:.0%}": Condition(
            crosstalk, rate=50, bits=12, skin="ur5"
        )
        for crosstalk in (0.0, 0.02, 0.05, 0.1)
    },
}
"""Conditions of each part, by their names."""


@lru_cache(maxsize=8)
def mount_matrix(size: int) -> MountedSkin:
    """Lay a square matrix on the forearm of a plain arm."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(URDF, "utf-8")
        robot = load_robot(path)
        skin, _ = place_matrix(robot, MatrixSpec("forearm", size, size, PITCH, "pad"))
    return MountedSkin(skin, robot)


def mount(condition: Condition) -> MountedSkin:
    """Return the skin of a condition on its robot."""
    if condition.skin == "ur5":
        return MountedSkin(load_skin("ur5"), load_robot("ur5"))
    return mount_matrix(condition.size)


def build_nominal(condition: Condition, mounted: MountedSkin) -> Calibration:
    """Return what the data sheet of the sensor says."""
    if condition.curve == "preset":
        return nominal_calibration(mounted.skin).with_full_scale(condition.full)
    family = FAMILIES[FAMILIES.index(condition.curve)]
    rng = np.random.default_rng(0)
    build = draw_flawed_build("", family, {}, mounted.skin, load_constants(), rng)
    calibration = build.calibration(mounted.skin).with_full_scale(condition.full)
    return replace(calibration, matrix=True)


@final
class Matrix:
    """A matrix turns pressure into counts.

    Attributes:
        dead: taxels of dead lines.
        calibration: data sheet, and the rest of each taxel.
    """

    def __init__(
        self, condition: Condition, mounted: MountedSkin, rng: np.random.Generator
    ) -> None:
        """Draw rest and gains."""
        skin = mounted.skin
        self.condition = condition
        self.rng = rng
        self.rest = condition.full * rng.uniform(*REST, skin.count)
        self.gain = np.exp(GAIN * rng.standard_normal(skin.count))
        lines = 1000 * skin.patch_index
        self.row = np.unique(lines + skin.rows, return_inverse=True)[1]
        self.column = np.unique(lines + skin.columns, return_inverse=True)[1]
        column, row = rng.integers(condition.size, size=2)
        self.dead = np.zeros(skin.count, dtype=bool)
        if condition.dead > 0:
            self.dead |= skin.columns == column
        if condition.dead > 1:
            self.dead |= skin.rows == row
        nominal = build_nominal(condition, mounted)
        rest = np.where(self.dead, 0.0, self.rest)
        self.nominal = nominal
        self.calibration = replace(nominal, rest=rest)

    def convert(
        self, pressure: Float[np.ndarray, "taxel"]
    ) -> Float[np.ndarray, "taxel"]:
        """Return the counts above rest of taxels at pressures [kPa]."""
        if self.condition.curve != "preset":
            return self.nominal.compute_counts(pressure)
        conductance = (pressure / HALF) ** EXPONENT
        return self.condition.full * conductance / (1.0 + conductance)

    def read(
        self, pressure: Float[np.ndarray, "taxel"] | None
    ) -> Int[np.ndarray, "taxel"]:
        """Return the counts of all taxels at a pressure [kPa], or at none."""
        full = self.condition.full
        above = np.zeros(len(self.rest))
        if pressure is not None:
            unsteady = 1.0 + UNSTEADY * self.rng.standard_normal(len(above))
            own = self.convert(pressure * self.gain * unsteady)
            own[self.dead] = 0.0
            along = np.bincount(self.row, own)[self.row] - own
            across = np.bincount(self.column, own)[self.column] - own
            above = own + 0.5 * self.condition.crosstalk * (along + across)
        noise = NOISE * full * self.rng.standard_normal(len(above))
        counts = np.round(self.rest + above * (1.0 - self.rest / full) + noise)
        counts[self.dead] = 0.0
        return np.clip(counts, 0, full).astype(np.int32)


Press = Callable[[float], Float[np.ndarray, "taxel"]]
"""Pressure on all taxels [kPa] at a time since the start of a touch [s]."""


def draw_matrix_press(
    condition: Condition, mounted: MountedSkin, rng: np.random.Generator
) -> tuple[float, Press]:
    """Draw a touch of a matrix: how long it takes [s], and its pressure."""
    skin = mounted.skin
    middle = (condition.size - 1) / 2
    across = (skin.columns - middle) * PITCH
    along = (skin.rows - middle) * PITCH
    unit = condition.size * PITCH
    x, y = rng.uniform(-0.25, 0.25, 2) * unit
    newtons = rng.uniform(3.0, 7.0)
    kind = int(rng.integers(5))
    width = 0.02 if kind == 3 else 0.005
    total = 5.0 * newtons if kind == 3 else newtons

    def press(seconds: float) -> Float[np.ndarray, "taxel"]:
        done = seconds / 1.4
        places = (
            ((-0.36 + 0.7 * done) * unit, y),
            (x, y),
            (0.28 * unit * np.cos(6.3 * done), 0.28 * unit * np.sin(6.3 * done)),
            (0.3 * x, 0.3 * y),
            (x + 0.25 * unit * np.sin(19.0 * done), y),
        )
        at_x, at_y = places[kind]
        squared = (across - at_x) ** 2 + (along - at_y) ** 2
        weight = np.exp(-0.5 * squared / width**2)
        return total * weight / (weight.sum() * PITCH**2) / 1000.0

    return (0.7, 1.2, 1.4, 1.6, 2.0)[kind], press


def draw_skin_press(
    mounted: MountedSkin, rng: np.random.Generator
) -> tuple[float, Press]:
    """Draw a touch of a skin of patches: how long it takes [s], and its pressure."""
    skin = mounted.skin
    poses = mounted.kinematics.poses(np.zeros(len(mounted.robot.joint_names)))
    pose = poses[mounted.taxel_link_index]
    places = np.einsum("nij,nj->ni", pose[:, :3, :3], skin.positions) + pose[:, :3, 3]
    taxel = int(rng.integers(skin.count))
    kind = int(rng.integers(4))
    newtons = rng.uniform(3.0, 8.0)
    same_link = mounted.taxel_link_index == mounted.taxel_link_index[taxel]
    width = 0.03 if kind == 3 else 0.006
    total = 6.0 * newtons if kind == 3 else newtons

    def press(seconds: float) -> Float[np.ndarray, "taxel"]:
        moved = 0.04 * np.sin(6.0 * seconds) if kind == 1 else 0.0
        centre = places[taxel] + np.array([0.0, 0.0, moved])
        distance = np.linalg.norm(places - centre, axis=1)
        weight = np.exp(-0.5 * (distance / width) ** 2) * same_link
        area = max(float((weight * skin.areas).sum()), 1e-9)
        return total * weight / area / 1000.0

    return (0.5, 0.9, 1.2, 2.0)[kind], press


def play_touches(
    condition: Condition, mounted: MountedSkin, seconds: float, matrix: Matrix
) -> Iterator[tuple[int, float, Int[np.ndarray, "taxel"]]]:
    """Yield number of the touch, time since it [s] and counts of each reading.

    Before the first touch its number is 0; while a touch lasts the time since it is 0.
    """
    rng = matrix.rng
    period = 1.0 / condition.rate
    for _ in range(round(SETTLING * condition.rate)):
        yield 0, np.inf, matrix.read(None)
    number = 0
    passed = SETTLING
    while passed < seconds:
        number += 1
        if condition.skin == "ur5":
            length, press = draw_skin_press(mounted, rng)
        else:
            length, press = draw_matrix_press(condition, mounted, rng)
        for n in range(int(length * condition.rate)):
            yield number, 0.0, matrix.read(press(n * period))
        pause = rng.uniform(0.8, 2.0)
        for n in range(int(pause * condition.rate)):
            yield number, (n + 1) * period, matrix.read(None)
        passed += length + pause


def play(condition: Condition, seconds: float, seed: int) -> Counted:
    """Press a matrix, and count what its front end leaves out and feels."""
    mounted = mount(condition)
    skin = mounted.skin
    rng = np.random.default_rng((seed, condition.size, condition.rate))
    matrix = Matrix(condition, mounted, rng)
    pipeline = TouchPipeline(mounted, matrix.calibration)
    q = np.zeros(len(mounted.robot.joint_names))
    received = np.ones(skin.count, dtype=bool)
    sound = ~matrix.dead
    digest = sha256()
    felt: set[int] = set()
    readings = blind = late = lingering = last = 0
    most = 0.0
    valid = received
    for number, since, counts in play_touches(condition, mounted, seconds, matrix):
        digest.update(counts.tobytes())
        readings += 1
        stamp = NS_PER_S + round(readings * NS_PER_S / condition.rate)
        state = pipeline.push_scan(Scan(stamp, counts, received, q))
        valid = state.reading.valid
        blind += find_worst_patch(valid, skin.patch_index) > 0.5
        if readings > SETTLING * condition.rate:
            most = max(most, 1.0 - float(valid[sound].mean()))
        if number and since == 0.0 and state.open:
            felt.add(number)
        if number and since > LINGER:
            late += 1
            lingering += bool(state.open)
        last = number
    dead = int(matrix.dead.sum())
    return {
        "readings": readings,
        "touches": last,
        "felt": len(felt),
        "blind": blind,
        "most left out": most,
        "dead": dead,
        "dead left out": int((matrix.dead & ~valid).sum()),
        "late": late,
        "lingering": lingering,
        "digest": digest.hexdigest()[:16],
    }


def find_worst_patch(
    valid: Bool[np.ndarray, "taxel"], patch: Int[np.ndarray, "taxel"]
) -> float:
    """Return the share of the taxels of a patch that are not valid, of the worst."""
    return float((np.bincount(patch, ~valid) / np.bincount(patch)).max())


def find_interval(part: float, whole: float) -> tuple[float, float]:
    """Return the exact 95 % interval of a share (Clopper and Pearson 1934)."""
    low = betaincinv(part, whole - part + 1, 0.025) if part else 0.0
    high = betaincinv(part + 1, whole - part, 0.975) if part < whole else 1.0
    return float(low), float(high)


def describe(every: Sequence[Counted]) -> list[str]:
    """Return the cells of a condition."""

    def add(name: str) -> int:
        return sum(int(one[name]) for one in every)

    felt = add("felt")
    touches = add("touches")
    low, high = find_interval(felt, touches)
    most = [float(one["most left out"]) for one in every]
    return [
        f"{felt} of {touches}: {felt / touches:.1%} ({low:.1%} to {high:.1%})",
        f"{add('blind') / add('readings'):.1%}",
        f"{max(most):.1%} (median {np.median(most):.1%})",
        f"{add('dead left out')} of {add('dead')}",
        f"{add('lingering') / max(add('late'), 1):.1%}",
    ]


HEADS = [
    "touches felt",
    "readings with over half of a patch left out",
    "most sound taxels left out at once, of all seeds",
    "taxels of dead lines left out at the end",
    f"open touches later than {LINGER:g} s after one",
]


def compare(files: dict[str, Found]) -> str:
    """Return a table of some files, one row a condition and file.

    Raises:
        ValueError: results of a condition are of other counts.
    """
    rows = [format_head(["condition", "seeds", "file", *HEADS])]
    for name in next(iter(files.values())):
        having = {stem: found[name] for stem, found in files.items() if name in found}
        digests = {tuple(one["digest"] for one in every) for every in having.values()}
        if len(digests) > 1:
            raise ValueError(
                f"'{name}' was played with other counts; allowed is one seed, duration "
                "and simulation; play both again"
            )
        for stem, every in having.items():
            rows.append(format_row([name, str(len(every)), stem, *describe(every)]))
    return "\n".join(rows)


@dataclass(frozen=True)
class Command:
    """Count what a front end leaves out of matrices with crosstalk."""

    part: tyro.conf.Positional[Literal["play", "compare"]]
    """`play OUT.json` or `compare A.json [B.json ...]`."""
    paths: tyro.conf.Positional[tuple[Path, ...]]
    """The files."""
    only: tuple[str, ...] = tuple(PARTS)
    """Parts to play."""
    seeds: int = 5
    """Number of seeds of each condition."""
    first: int = 0
    """First seed; the final one, which is opened once, is 7400."""
    seconds: float = 150.0
    """Simulated time of each [s]."""
    quick: bool = False
    """Play one seed of 40 s."""
    workers: int = 1
    """Number of processes."""


def main(args: list[str] | None = None) -> None:
    """Play the conditions, or compare files."""
    command = tyro.cli(Command, args=args, description=__doc__)
    if command.part == "compare":
        files = {path.stem: json.loads(path.read_text()) for path in command.paths}
        print(compare(files))
        return
    for part in command.only:
        if part not in PARTS:
            raise SystemExit(f"--only has '{part}'; allowed are {', '.join(PARTS)}")
    if command.quick:
        command = replace(command, seeds=1, seconds=40.0)
    [out] = command.paths
    chosen = {name: one for part in command.only for name, one in PARTS[part].items()}
    found: Found = {}
    with ProcessPoolExecutor(command.workers) as pool:
        for name, condition in chosen.items():
            number = command.seeds
            seeds = range(command.first, command.first + number)
            conditions = [condition] * number
            seconds = [command.seconds] * number
            found[name] = list(pool.map(play, conditions, seconds, seeds))
            out.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    print(compare({out.stem: found}))


if __name__ == "__main__":
    main()
