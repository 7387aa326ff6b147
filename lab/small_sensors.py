"""Test weights on small sensors drawn at random, and on strokes on a phone.

    python -m lab.small_sensors --seed 1
    python -m lab.small_sensors phone --people P10 P12 P15 P18

`drawn` makes touches by formula: round pads that press, slide and rest on flat grids
with other cells, rates, gains and lags each time. Nothing of the simulator or of the
training is in it. A seed is opened once: what was looked at is no test any more.
`phone` plays people of CapFingerId. Answers of each kind are counted twice: forced, the
likeliest class of the touch of the greatest force, and live, what is detected.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from jaxtyping import Float

from eskin import Model, Reading, Recognizer, load_model
from eskin.recording import NONE
from eskin.robot import load_robot
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration
from eskin.units import NS_PER_S
from lab.public_sets import SETS, read_trials
from lab.tables import format_head, format_row
from lab.transfer import FINEST, build_scans

STEP = 0.01
"""Time between two computed pressures [s]."""

REST_BEFORE, REST_AFTER = 1.5, 1.8
"""Time without touch before and after each [s]."""

FULL_SCALE = 100.0
"""Nominal pressure at full scale [kPa]."""

READ_PERIOD = 0.02
"""Period at which slower sensors are read [s]."""

Series = Float[np.ndarray, "time"]
Places = Float[np.ndarray, "time pad 2"]


@dataclass(frozen=True)
class Command:
    """Test weights on sensors that they have not met."""

    part: tyro.conf.Positional[Literal["drawn", "phone"]] = "drawn"
    """Touches by formula, or people of CapFingerId."""
    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    seed: int = 1
    """Seed of the draw."""
    draws: int = 40
    """Touches of each kind that are drawn."""
    people: tuple[str, ...] = ()
    """People of the phone; all unless given."""


@dataclass(frozen=True, eq=False)
class DrawnTouch:
    """A touch is what pads do in some seconds, with the answer that it should get."""

    truth: str
    """Right answer."""
    force: Series
    """Force at each step [N]."""
    places: Places
    """Centres of the pads, from the middle of the sensor [m]."""
    radius: float
    """Radius of a pad [m]."""


def main() -> None:
    """Test the weights and print the table."""
    command = tyro.cli(Command)
    model = load_model(command.model)
    if command.part == "phone":
        found = answer_phone(model, command.people)
    else:
        found = answer_drawn(model, command.seed, command.draws)
    print(format_table(found))


def answer_drawn(
    model: Model, seed: int, draws: int
) -> Iterator[tuple[str, str, str, str]]:
    """Yield the kind, the right, the forced and the live answer of each drawn touch."""
    for index, (kind, draw) in enumerate(KINDS.items()):
        for number in range(draws):
            rng = np.random.default_rng([seed, index, number])
            binary = kind.startswith("binary")
            rows, columns, pitch = draw_grid(rng, binary)
            touch = draw(rng, pitch, (rows * pitch, columns * pitch))
            pressure = press(touch, rows, columns, pitch)
            times, read = read_sensor(pressure, rng, binary)
            skin = build_grid_skin(rows, columns, pitch, calibrated=True)
            mounted = MountedSkin(skin, load_robot("table"))
            nominal = Calibration.uniform(skin.count, FINEST, FULL_SCALE)
            recognizer = Recognizer(model, mounted, nominal)
            yield kind, touch.truth, *answer(recognizer, times, read)


def answer_phone(
    model: Model, people: tuple[str, ...]
) -> Iterator[tuple[str, str, str, str]]:
    """Yield the same for the touches of people on the phone."""
    public = SETS["phone"]
    pitch, scale = public.pitch_mm / 1000, public.full_scale_kpa
    skin = build_grid_skin(public.rows, public.columns, pitch, calibrated=True)
    mounted = MountedSkin(skin, load_robot("table"))
    calibration = Calibration.uniform(skin.count, FINEST, scale)
    trials = read_trials(public, public.folder, people)
    for group in public.groups:
        for trial in trials:
            if trial.gesture in group.gestures:
                recognizer = Recognizer(model, mounted, calibration)
                found = [
                    d for scan in build_scans(trial) for d in recognizer.push(scan)
                ]
                found += recognizer.finish()
                yield group.name, group.truth or NONE, *choose(found)


def draw_grid(rng: np.random.Generator, binary: bool) -> tuple[int, int, float]:
    """Draw rows, columns and pitch [m] of a sensor."""
    pitch = rng.uniform(0.025, 0.045) if binary else np.exp(rng.uniform(-5.5, -3.4))
    rows, columns = (max(2, round(each / pitch)) for each in rng.uniform(0.06, 0.16, 2))
    return rows, columns, float(pitch)


def press(touch: DrawnTouch, rows: int, columns: int, pitch: float) -> np.ndarray:
    """Return the mean pressure of every cell at every step [kPa]: paraboloids."""
    finer = max(1, round(pitch / 0.003))
    small = pitch / finer
    x = (np.arange(columns * finer) + 0.5) * small - columns * pitch / 2
    y = (np.arange(rows * finer) + 0.5) * small - rows * pitch / 2
    peak = 2 * touch.force / (np.pi * touch.radius**2) / touch.places.shape[1] / 1000
    out = np.zeros((len(peak), rows, columns))
    for number, (top, pads) in enumerate(zip(peak, touch.places, strict=True)):
        for u, v in pads:
            away = ((x - u) ** 2 + (y[:, None] - v) ** 2) / touch.radius**2
            load = top * np.clip(1 - away, 0, None)
            out[number] += load.reshape(rows, finer, columns, finer).mean((1, 3))
    return out.reshape(len(peak), -1)


def read_sensor(
    pressure: np.ndarray, rng: np.random.Generator, binary: bool
) -> tuple[Series, np.ndarray]:
    """Return times of readings [s] and what they show [kPa] on a sensor drawn anew."""
    before, after = (round(rest / STEP) for rest in (REST_BEFORE, REST_AFTER))
    pressure = np.pad(pressure, ((before, after), (0, 0)))
    if binary:
        values = np.where(pressure > 0.02 * pressure.max(), 40.0, 0.0)
    else:
        values = pressure * np.exp(rng.uniform(np.log(3), np.log(40))) / pressure.max()
        if rng.random() < 0.5:
            kept = np.exp(-STEP / rng.uniform(0.1, 0.5))
            for k in range(1, len(values)):
                values[k] = np.maximum(values[k], kept * values[k - 1])
    rate, mode = rng.uniform(11, 48), rng.integers(3)
    known = np.arange(0, len(values) * STEP - STEP, 1 / rate)
    values = values[np.rint(known / STEP).astype(int)]
    if mode == 0:
        return known, values
    times = np.arange(0, known[-1], READ_PERIOD)
    at = np.searchsorted(known, times, side="right") - 1
    part = ((times - known[at]) * rate)[:, None] * (mode == 1)
    return times, (1 - part) * values[at] + part * values[at + 1]


def answer(recognizer: Recognizer, times: Series, read: np.ndarray) -> tuple[str, str]:
    """Return the forced and the live answer of a recogniser."""
    found, valid = [], np.ones(read.shape[1], dtype=np.bool_)
    for time, row in zip(times, read.astype(np.float32), strict=True):
        stamp = NS_PER_S + round(float(time) * NS_PER_S)
        reading = Reading(stamp=stamp, pressure=row, valid=valid, q=np.zeros(0))
        found += recognizer.push(reading)
    return choose([*found, *recognizer.finish()])


def choose(found: Sequence) -> tuple[str, str]:
    """Return the forced and the live answer among detections."""
    best = max(found, key=lambda each: each.peak_force, default=None)
    if best is None:
        return "nothing", "nothing"
    return best.likeliest or best.gesture, best.gesture


def hold(steps: int, share: float = 0.12) -> Series:
    """Return a force that rises, stays and falls."""
    u = np.linspace(0, 1, steps)
    return np.minimum(1, np.minimum(u, 1 - u) / share)


def spread(rng: np.random.Generator, pads: int, apart: float) -> np.ndarray:
    """Draw where the pads of a finger or a hand lie from their middle [m]."""
    return rng.uniform(-apart, apart, (pads, 2)) * (pads > 1)


def stay(
    rng: np.random.Generator, truth: str, force: Series, size: Sequence, hand: bool
) -> DrawnTouch:
    """Return a touch by a fingertip, or a hand, that stays where it is."""
    middle = rng.uniform(-0.25, 0.25, 2) * np.array(size)[::-1]
    pads = spread(rng, 4 if hand else 1, 0.03)
    places = np.broadcast_to(middle + pads, (len(force), *pads.shape))
    radius = rng.uniform(0.012, 0.02) if hand else rng.uniform(0.0045, 0.008)
    return DrawnTouch(truth, force, places, radius)


def poke(rng: np.random.Generator, pitch: float, size: Sequence) -> DrawnTouch:
    """Draw a poke of 0.1 to 0.7 s."""
    steps = round(float(np.exp(rng.uniform(np.log(0.1), np.log(0.7)))) / STEP)
    force = np.sin(np.pi * np.linspace(0, 1, steps)) ** 0.5
    return stay(rng, "poke", force, size, hand=False)


def pats(rng: np.random.Generator, pitch: float, size: Sequence) -> DrawnTouch:
    """Draw two pats of a hand or of fingertips within 0.4 to 0.9 s."""
    each = round(rng.uniform(0.12, 0.26) / STEP)
    force = np.sin(np.pi * np.linspace(0, 1, each)) ** 0.5
    gap = np.zeros(round(rng.uniform(0.14, 0.36) / STEP))
    force = np.concatenate([force, gap, rng.uniform(0.7, 1.2) * force])
    return stay(rng, "double_pat", force, size, hand=rng.random() < 0.6)


def stroke(rng: np.random.Generator, pitch: float, size: Sequence) -> DrawnTouch:
    """Draw a stroke over 28 mm or more, and over more than two cells."""
    u = np.linspace(0, 1, round(rng.uniform(0.28, 1.3) / STEP))
    return slide(rng, u, pitch, size)


def halting(rng: np.random.Generator, pitch: float, size: Sequence) -> DrawnTouch:
    """Draw a stroke that rests before it slides and after."""
    first, move, last = (round(s / STEP) for s in rng.uniform(0.2, 0.5, 3))
    u = np.concatenate([np.zeros(first), np.linspace(0, 1, move), np.ones(last)])
    return slide(rng, u, pitch, size)


def slide(
    rng: np.random.Generator, u: Series, pitch: float, size: Sequence
) -> DrawnTouch:
    """Return a touch whose place moves from end to end by `u`, from 0 to 1."""
    reach = float(np.max(size))
    length = rng.uniform(max(0.028, 2.2 * pitch), max(0.04, 2.6 * pitch, 0.9 * reach))
    turned = np.array(size)[1] < np.array(size)[0]
    away = rng.uniform(-0.2, 0.2) + (np.pi / 2 if turned else 0.0)
    way = np.array([np.cos(away), np.sin(away)]) * rng.choice([-1, 1])
    hand = rng.random() < 0.4
    pads = spread(rng, 3 if hand else 1, 0.02)
    middle = way * ((u - 0.5) * length)[:, None]
    radius = rng.uniform(0.01, 0.018) if hand else rng.uniform(0.0045, 0.008)
    return DrawnTouch("stroke", hold(len(u)), middle[:, None] + pads, radius)


def held(rng: np.random.Generator, pitch: float, size: Sequence) -> DrawnTouch:
    """Draw a fingertip that is held for 1.4 to 2.4 s."""
    force = hold(round(rng.uniform(1.4, 2.4) / STEP), 0.08)
    return stay(rng, NONE, force, size, hand=False)


def resting(rng: np.random.Generator, pitch: float, size: Sequence) -> DrawnTouch:
    """Draw a hand that rests for 0.9 to 2.4 s."""
    force = hold(round(rng.uniform(0.9, 2.4) / STEP), 0.15)
    return stay(rng, NONE, force, size, hand=True)


KINDS: dict[str, Callable[[np.random.Generator, float, Sequence], DrawnTouch]] = {
    "fingertip pokes": poke,
    "two pats": pats,
    "stroke": stroke,
    "stroke that rests before and after": halting,
    "fingertip held (guard)": held,
    "hand rests (guard)": resting,
    "binary: two pats": pats,
    "binary: stroke": stroke,
    "binary: hand rests (guard)": resting,
}
"""Kinds of touches; binary ones on sensors that are on or off."""


def format_table(found: Iterable[tuple[str, str, str, str]]) -> str:
    """Format the shares of right answers by kind, with 95 % intervals (Wilson)."""
    rows = [format_head(("kind", "truth", "n", "forced", "live", "live answers"))]
    for kind, group in groupby(found, key=lambda each: each[0]):
        answers = list(group)
        truth = answers[0][1]
        live = [each[3] for each in answers]
        counts = sorted({(live.count(name), name) for name in live}, reverse=True)
        cells = [kind, truth, str(len(answers))]
        cells += [format_share([a[k] == truth for a in answers]) for k in (2, 3)]
        rows.append(format_row([*cells, ", ".join(f"{n} {a}" for a, n in counts[:3])]))
    return "\n".join(rows)


def format_share(right: Sequence[bool]) -> str:
    """Format a share with its 95 % interval (Wilson)."""
    n, p, z = len(right), float(np.mean(right)), 1.96
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + (z / (2 * n)) ** 2) / (1 + z**2 / n)
    return f"{p:.0%} [{middle - half:.0%}, {middle + half:.0%}]"


if __name__ == "__main__":
    main()
