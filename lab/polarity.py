"""Read simulated sensors whose counts rise, and the same whose counts fall.

    python -m lab.polarity
    python -m lab.polarity --builds 20

A person pokes a grid of taxels of each sensor family, then presses it for a
calibration. Nobody says which way counts go. Columns:

- told: touches after which the fault is told; `-` for never
- felt: share of the pokes that are felt before it is said which way counts go, and
  after
- force: what a press of 4 N reads with the calibration that is measured, median and
  range of the builds [N]
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import tyro
from jaxtyping import Float

from eskin.calibration import CalibrationGuide, GuideConfig
from eskin.calibration.fingertip import press_taxels
from eskin.calibration.guide import PLACES
from eskin.robot import load_robot
from eskin.sim import load_constants
from eskin.sim.sensor import FAMILIES, draw_build, sense
from eskin.sim.sensor.build import SensorBuild
from eskin.skin import MountedSkin, build_grid_skin
from eskin.skin.wiring import find_nearest_taxel
from eskin.touch import Calibration, Scan, TouchPipeline
from eskin.units import NS_PER_S
from lab.tables import format_head, format_row

SIDE = 10
PITCH = 0.01
REST = 8.0
PAUSE = 2.5
"""Time at rest before the first touch, and from one touch to the next [s]."""
POKE = 0.25
PRESS = 1.0
"""Durations of a poke and of a press [s]."""
FORCE = 4.0
"""Greatest force of a touch [N]."""
AREA = 160e-6
"""Area of the fingertip at that force [m2]."""
TOUCHES = 6
"""Number of pokes, and of presses."""
WIDTH = 5
"""Number of rows and of columns under a fingertip."""


@dataclass(frozen=True)
class Command:
    """Compare both polarities on all sensor families."""

    builds: int = 8
    """Number of builds of each family."""
    seed: int = 1
    """Seed of the builds and of their noise."""


@dataclass(frozen=True)
class Outcome:
    """An outcome holds what one build of one polarity has led to."""

    told: int | None
    """Number of touches begun when the fault is told; None for never."""
    unset: float
    """Share of the pokes that are felt with the calibration of a data sheet."""
    known: float
    """The same with the right polarity."""
    force: float
    """Force that presses read with the measured calibration [N]; NaN without one."""


def press_grid(
    seconds: float, step: float, mounted: MountedSkin
) -> tuple[Float[np.ndarray, "step taxel"], list[float]]:
    """Return pressures of touches on a grid [kPa], and when each begins [s]."""
    skin = mounted.skin
    begins = [REST + PAUSE * n for n in range(TOUCHES)]
    pressure = np.zeros((round((begins[-1] + PAUSE) / step), skin.count))
    tip = press_taxels(FORCE, np.array([AREA]), np.full((1, 2), 0.003), PITCH)[0]
    half = WIDTH // 2
    for number, begin in enumerate(begins):
        place = PLACES[number % len(PLACES)]
        centre = find_nearest_taxel(skin, skin.patches[0].id, place)
        rows, columns = (each - each[centre] for each in (skin.rows, skin.columns))
        under = np.maximum(abs(rows), abs(columns)) <= half
        image = np.where(
            under, tip[(rows + half) % WIDTH, (columns + half) % WIDTH], 0.0
        )
        first = round(begin / step)
        steps = round(seconds / step)
        course = np.sin(np.pi * (np.arange(steps) + 0.5) / steps) ** 0.5
        pressure[first : first + steps] = course[:, None] * image
    return pressure, begins


def play(
    pressure: Float[np.ndarray, "step taxel"],
    build: SensorBuild,
    mounted: MountedSkin,
    seed: int,
    falls: bool,
) -> Iterator[Scan]:
    """Yield the scans of a build under some pressures."""
    taxels = np.arange(mounted.skin.count)
    rng = np.random.default_rng(seed)
    counts, received = sense(pressure, taxels, build, mounted.skin, rng)
    if falls:
        counts = build.electronics.full_scale - counts
    period = build.electronics.period
    for n, (row, seen) in enumerate(zip(counts, received, strict=True)):
        stamp = round((n + 1) * period * NS_PER_S)
        yield Scan(stamp, row.astype(np.int32), seen, np.zeros(0))


def watch(
    scans: Iterator[Scan],
    begins: list[float],
    seconds: float,
    mounted: MountedSkin,
    calibration: Calibration,
) -> tuple[int | None, float, float]:
    """Return after how many touches a fault is told, the share felt, and their force.

    A touch is felt where a contact begins and ends with it; the force is the median of
    the greatest ones.
    """
    pipeline = TouchPipeline(mounted, calibration)
    told = None
    force = np.zeros(len(begins))
    for scan in scans:
        time = scan.stamp / NS_PER_S
        state = pipeline.push_scan(scan)
        passed = np.searchsorted(begins, time)
        if told is None and pipeline.front_end.polarity.faults:
            told = int(passed)
        inside = passed and time <= begins[passed - 1] + seconds
        if inside and state.contacts:
            now = max(contact.force for contact in state.contacts)
            force[passed - 1] = max(force[passed - 1], now)
    return told, float(np.mean(force > 0.0)), float(np.median(force))


def try_build(
    build: SensorBuild, mounted: MountedSkin, seed: int, falls: bool
) -> Outcome:
    """Poke and calibrate a build whose counts rise or fall."""
    sheet = build.calibration(mounted.skin)
    pokes, begins = press_grid(POKE, build.electronics.step, mounted)
    told, unset, _ = watch(
        play(pokes, build, mounted, seed, falls), begins, POKE, mounted, sheet
    )
    right = replace(sheet, falling=falls)
    _, known, _ = watch(
        play(pokes, build, mounted, seed, falls), begins, POKE, mounted, right
    )
    presses, begins = press_grid(PRESS, build.electronics.step, mounted)
    config = GuideConfig(presses=TOUCHES - 1, forces=(FORCE,))
    guide = CalibrationGuide(mounted, sheet, config)
    for scan in play(presses, build, mounted, seed, falls):
        guide.push(scan)
    force = np.nan
    if guide.rest is not None and guide.presses:
        measured = guide.finish().calibration
        if measured.falling == falls:
            scans = play(presses, build, mounted, seed, falls)
            force = watch(scans, begins, PRESS, mounted, measured)[2]
    return Outcome(told, unset, known, force)


def main() -> None:
    """Print the table."""
    command = tyro.cli(Command)
    skin = build_grid_skin(SIDE, SIDE, PITCH, calibrated=True)
    mounted = MountedSkin(skin, load_robot("table"))
    constants = load_constants()
    print(format_head(("family", "counts", "told", "felt", "force")))
    for family in FAMILIES:
        for falls in (False, True):
            outcomes = []
            for n in range(command.builds):
                rng = np.random.default_rng([command.seed, n])
                build = draw_build(f"{family}{n}", family, skin, constants, rng)
                outcomes.append(try_build(build, mounted, command.seed + n, falls))
            told = ["-" if each.told is None else each.told for each in outcomes]
            unset, known = (
                np.mean([getattr(each, name) for each in outcomes])
                for name in ("unset", "known")
            )
            force = np.array([each.force for each in outcomes])
            lost = int(np.isnan(force).sum())
            low, middle, high = np.nanquantile(force, (0.0, 0.5, 1.0))
            cells = (
                family,
                "fall" if falls else "rise",
                " ".join(map(str, told)),
                f"{unset:.0%}, {known:.0%}",
                f"{middle:.1f} ({low:.1f}-{high:.1f}), none in {lost}",
            )
            print(format_row(cells), flush=True)


if __name__ == "__main__":
    main()
