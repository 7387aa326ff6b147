"""Test weights on small sensors drawn at random, on bumps, and on strokes on a phone.

    python -m lab.small_sensors --seed 1
    python -m lab.small_sensors rests --seed 1
    python -m lab.small_sensors phone --people P10 P12 P15 P18

All but `phone` make touches by formula: round pads that press, slide and rest on flat
devices with other cells, rates, gains and lags each time, and bodies that strike (see
`lab.bumps`). Nothing of the simulator or of the training is in it. A seed is opened
once: what was looked at is no test any more.

- `drawn`: all gestures, and rests, on grids.
- `rests`: hands, arms and bodies that rest on devices of 1 to 12 large cells.
- `caresses`: strokes, pats and pokes on the same devices.
- `travel`: pokes that slide 10 to 15 mm and strokes of 30 mm or more on fine grids.
- `beats`: two or three pats of a hand that moves between them and hardly lifts.
- `taps`: pokes of 40 to 100 ms.
- `bumps`: spheres and forearms that strike the skin `ur5`, or grids.

`phone` plays people of CapFingerId. The forced answer is the likeliest class of the
touch of the greatest force. The live answer is every gesture that is detected, of any
touch; without one, what is detected of the touch of the greatest force.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from jaxtyping import Float

from eskin import Model, Reading, Recognizer, load_model
from eskin.learn.metrics import bound_share
from eskin.live import UNKNOWN
from eskin.recording import NONE
from eskin.robot import load_robot
from eskin.skin import (
    MountedSkin,
    Patch,
    Plane,
    Skin,
    TaxelGrid,
    build_grid_skin,
    build_skin,
    load_skin,
)
from eskin.touch import Calibration
from eskin.transforms import make_transform
from eskin.units import NS_PER_S
from lab.bumps import (
    Ball,
    PressedEllipse,
    PushingBody,
    press_sphere,
    press_taxels,
    push_ellipse,
    strike,
)
from lab.public_sets import SETS, read_trials
from lab.tables import format_head, format_row
from lab.transfer import FINEST, build_scans

STEP = 0.01
"""Time between two computed pressures [s]."""

REST_BEFORE = 1.5
REST_AFTER = 1.8
"""Time without touch before and after each [s]."""

FULL_SCALE = 100.0
"""Nominal pressure at full scale [kPa]."""

READ_PERIOD = 0.02
"""Period at which slower sensors are read [s]."""

SHOWN = 1.0
"""Pressure from which a reading shows a touch [kPa]."""

TOUCHED = 0.1
"""Share of the greatest pressure from which a cell counts as touched."""

Part = Literal[
    "drawn", "rests", "caresses", "travel", "beats", "taps", "bumps", "phone"
]
Series = Float[np.ndarray, "time"]
Forces = Float[np.ndarray, "time pad"]
Places = Float[np.ndarray, "time pad 2"]
Answer = tuple[str, str, str, str]
"""Row, right, forced and live answer."""


@dataclass(frozen=True)
class Command:
    """Test weights on sensors that they have not met."""

    part: tyro.conf.Positional[Part] = "drawn"
    """Touches by formula, or people of CapFingerId."""
    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    seed: int = 1
    """Seed of the draw."""
    draws: int = 40
    """Touches of each row that are drawn."""
    people: tuple[str, ...] = ()
    """People of the phone; all unless given."""


@dataclass(frozen=True, eq=False)
class FlatDevice:
    """A device is a flat skin of square cells."""

    skin: Skin
    """Skin, in the plane z = 0 of link `table`."""
    side: float
    """Side of a cell [m]."""
    pitch: float
    """Distance of the centres of neighbouring cells, at least the side [m]."""

    @property
    def centres(self) -> Float[np.ndarray, "cell 2"]:
        """Return the centre of each cell [m]."""
        return self.skin.positions[:, :2]

    @property
    def size(self) -> tuple[float, float]:
        """Return height and width [m]."""
        width, height = np.ptp(self.centres, axis=0) + self.side
        return float(height), float(width)


@dataclass(frozen=True)
class CellReadout:
    """A readout says from what the electronics of a device are drawn."""

    binary: bool = False
    """Whether cells are on or off."""
    rates: tuple[float, float] = (11.0, 48.0)
    """Lowest and highest rate [Hz]."""
    lags: tuple[float, float] = (0.1, 0.5)
    """Shortest and longest time constant of release of cells that lag [s]."""
    lagging: float = 0.5
    """Share of the devices whose cells lag; never binary ones."""


@dataclass(frozen=True, eq=False)
class DrawnTouch:
    """A touch is what pads do in some seconds."""

    force: Forces
    """Pressure in the middle of each pad, over a pressure that is the same for all."""
    places: Places
    """Centres of the pads, from the middle of the device [m]."""
    radius: float
    """Radius of a pad [m]."""
    stays: bool = False
    """Whether the recording ends with the touch."""


@dataclass(frozen=True, eq=False)
class TouchReadings:
    """A recording of one touch holds readings."""

    mounted: MountedSkin
    """Skin on its robot."""
    q: Float[np.ndarray, "joint"]
    """Joint positions [rad]."""
    times: Series
    """Times of the readings [s]."""
    pressure: Float[np.ndarray, "reading taxel"]
    """Readings [kPa]."""


@dataclass(frozen=True)
class Row:
    """A row of a table draws touches that have one right answer."""

    truth: str
    """Right answer."""
    draw: Callable[[np.random.Generator], TouchReadings]
    """Draws the readings of a touch."""


def main() -> None:
    """Test the weights and print the table."""
    command = tyro.cli(Command)
    model = load_model(command.model)
    if command.part == "phone":
        found = answer_phone(model, command.people)
    else:
        found = answer_part(model, command.part, command.seed, command.draws)
    print(format_table(found))


def answer_part(model: Model, part: Part, seed: int, draws: int) -> Iterator[Answer]:
    """Yield the answers to each touch of a part, row by row."""
    first = 100 * list(PARTS).index(part)
    for index, (name, row) in enumerate(PARTS[part].items(), first):
        for number in range(draws):
            trial = row.draw(np.random.default_rng([seed, index, number]))
            skin = trial.mounted.skin
            nominal = Calibration.uniform(skin.count, FINEST, FULL_SCALE)
            recognizer = Recognizer(model, trial.mounted, nominal)
            yield name, row.truth, *answer(recognizer, trial)


def answer_phone(model: Model, people: tuple[str, ...]) -> Iterator[Answer]:
    """Yield the answers to the touches of people on the phone."""
    public = SETS["phone"]
    pitch = public.pitch_mm / 1000
    scale = public.full_scale_kpa
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


def answer(recognizer: Recognizer, trial: TouchReadings) -> tuple[str, str]:
    """Return the forced and the live answer of a recogniser."""
    found = []
    valid = np.ones(trial.pressure.shape[1], dtype=np.bool_)
    rows = trial.pressure.astype(np.float32)
    for time, row in zip(trial.times, rows, strict=True):
        stamp = NS_PER_S + round(float(time) * NS_PER_S)
        reading = Reading(stamp=stamp, pressure=row, valid=valid, q=trial.q)
        found += recognizer.push(reading)
    return choose([*found, *recognizer.finish()])


def choose(found: Sequence) -> tuple[str, str]:
    """Return the forced and the live answer among detections."""
    best = max(found, key=lambda each: each.peak_force, default=None)
    if best is None:
        return NONE, NONE
    gestures = sorted({each.gesture for each in found} - {NONE, UNKNOWN})
    live = " and ".join(gestures) or best.gesture
    return best.likeliest or best.gesture, live


def draw_touch(
    rng: np.random.Generator,
    device: Callable[[np.random.Generator], FlatDevice],
    touch: Callable[[np.random.Generator, FlatDevice], DrawnTouch],
    readout: CellReadout,
    accept: Callable[[np.ndarray, FlatDevice], bool],
) -> TouchReadings:
    """Draw a touch on a device until the readings are accepted."""
    while True:
        drawn = device(rng)
        pressed = touch(rng, drawn)
        pressure = press(pressed, drawn)
        after = 0.0 if pressed.stays else REST_AFTER
        times, read = read_sensor(pressure, rng, readout, after)
        if accept(read, drawn):
            mounted = MountedSkin(drawn.skin, load_robot("table"))
            return TouchReadings(mounted, np.zeros(0), times, read)


def press(touch: DrawnTouch, device: FlatDevice) -> np.ndarray:
    """Return the mean pressure on every cell at every step, relative: paraboloids."""
    finer = max(1, round(device.side / 0.003))
    steps = ((np.arange(finer) + 0.5) / finer - 0.5) * device.side
    x = device.centres[:, 0, None, None] + steps
    y = device.centres[:, 1, None, None] + steps[:, None]
    out = np.zeros((len(touch.force), device.skin.count))
    for row, forces, places in zip(out, touch.force, touch.places, strict=True):
        for force, (u, v) in zip(forces, places, strict=True):
            away = ((x - u) ** 2 + (y - v) ** 2) / touch.radius**2
            row += force * np.clip(1 - away, 0, None).mean((1, 2))
    return out


def read_sensor(
    pressure: np.ndarray,
    rng: np.random.Generator,
    readout: CellReadout,
    after: float = REST_AFTER,
) -> tuple[Series, np.ndarray]:
    """Return times of readings [s] and what they show [kPa] on a sensor drawn anew."""
    rests = round(REST_BEFORE / STEP), round(after / STEP)
    pressure = np.pad(pressure, (rests, (0, 0)))
    top = max(pressure.max(), 1e-9)
    if readout.binary:
        values = np.where(pressure > 0.02 * top, 40.0, 0.0)
    else:
        values = pressure * np.exp(rng.uniform(np.log(3), np.log(40))) / top
        if rng.random() < readout.lagging:
            kept = np.exp(-STEP / rng.uniform(*readout.lags))
            for k in range(1, len(values)):
                values[k] = np.maximum(values[k], kept * values[k - 1])
    rate = rng.uniform(*readout.rates)
    mode = rng.integers(3)
    known = np.arange(0, len(values) * STEP - STEP, 1 / rate)
    values = values[np.rint(known / STEP).astype(int)]
    if mode == 0:
        return known, values
    times = np.arange(0, known[-1], READ_PERIOD)
    at = np.searchsorted(known, times, side="right") - 1
    part = ((times - known[at]) * rate)[:, None] * (mode == 1)
    return times, (1 - part) * values[at] + part * values[at + 1]


def draw_grid(rng: np.random.Generator, binary: bool) -> FlatDevice:
    """Draw a grid of 4 to 33 mm cells, or of 25 to 45 mm if binary."""
    pitch = rng.uniform(0.025, 0.045) if binary else np.exp(rng.uniform(-5.5, -3.4))
    rows, columns = (max(2, round(each / pitch)) for each in rng.uniform(0.06, 0.16, 2))
    return build_device(rows, columns, float(pitch))


def draw_cells(
    rng: np.random.Generator,
    finest: float,
    coarsest: float,
    least: float = 0.06,
    most: float = 0.11,
) -> FlatDevice:
    """Draw a grid of cells between two sizes, and of sides between two lengths [m]."""
    pitch = float(np.exp(rng.uniform(np.log(finest), np.log(coarsest))))
    sides = rng.uniform(least, most, 2)
    rows, columns = (max(2, round(each / pitch)) for each in sides)
    return build_device(rows, columns, pitch)


def draw_pads(rng: np.random.Generator, apart: bool, least: int = 1) -> FlatDevice:
    """Draw a device of at most 12 large cells, side by side or apart.

    Cells that lie apart are patches of their own, or a grid whose pitch exceeds them.
    """
    least = max(least, 2) if apart else least
    count = int(np.exp(rng.uniform(np.log(least), np.log(12.99))))
    rows = int(rng.integers(1, min(3, count) + 1))
    columns = max(count // rows, 1)
    if rng.random() < 0.5:
        rows, columns = columns, rows
    side = rng.uniform(0.025, 0.09)
    if not apart:
        return build_device(rows, columns, side)
    pitch = rng.uniform(max(0.06, 1.1 * side), 0.16)
    if rng.random() < 0.5:
        return build_device(rows, columns, pitch, side)
    cell = TaxelGrid(1, 1, side, side)
    placed = []
    for number in range(rows * columns):
        row, column = divmod(number, columns)
        place = np.array([column - (columns - 1) / 2, row - (rows - 1) / 2, 0]) * pitch
        patch = Patch(f"pad {number + 1}", "table", number + 1, 1, 1)
        placed.append((patch, cell, Plane(make_transform(np.eye(3), place))))
    return FlatDevice(build_skin("pads", placed), side, pitch)


def build_device(
    rows: int, columns: int, pitch: float, side: float | None = None
) -> FlatDevice:
    """Build a grid whose cells have a side [m]; the pitch unless given."""
    skin = build_grid_skin(rows, columns, pitch, calibrated=True)
    return FlatDevice(skin, side or pitch, pitch)


def accept_any(read: np.ndarray, device: FlatDevice) -> bool:
    """Accept all readings."""
    return True


def accept_shown(read: np.ndarray, device: FlatDevice) -> bool:
    """Accept readings of which one shows a touch."""
    return bool(read.max() >= SHOWN)


def find_touched(read: np.ndarray) -> np.ndarray:
    """Return which cells each reading shows as touched."""
    return read >= max(SHOWN, TOUCHED * read.max())


def accept_few(read: np.ndarray, device: FlatDevice) -> bool:
    """Accept readings that show two to four cells."""
    return 2 <= find_touched(read).any(0).sum() <= 4


def accept_passing(read: np.ndarray, device: FlatDevice) -> bool:
    """Accept readings that show two or more cells and move by half a pitch."""
    touched = find_touched(read)
    if touched.any(0).sum() < 2:
        return False
    first, last = np.flatnonzero(touched.any(1))[[0, -1]]
    weights = read[[first, last]] * touched[[first, last]]
    centres = weights @ device.centres / weights.sum(1, keepdims=True)
    return bool(np.linalg.norm(centres[1] - centres[0]) >= 0.5 * device.pitch)


def hold(steps: int, share: float = 0.12) -> Series:
    """Return a force that rises, stays and falls."""
    u = np.linspace(0, 1, steps)
    return np.minimum(1, np.minimum(u, 1 - u) / share)


def spread(rng: np.random.Generator, pads: int, apart: float) -> np.ndarray:
    """Draw where the pads of a finger or a hand lie from their middle [m]."""
    return rng.uniform(-apart, apart, (pads, 2)) * (pads > 1)


def share(force: Series, pads: int) -> Forces:
    """Return a force that is the same under all pads."""
    return np.repeat(force[:, None], pads, axis=1)


def stay(
    rng: np.random.Generator, device: FlatDevice, force: Series, hand: bool
) -> DrawnTouch:
    """Return a touch by a fingertip, or a hand, that stays where it is."""
    middle = rng.uniform(-0.25, 0.25, 2) * np.array(device.size)[::-1]
    pads = spread(rng, 4 if hand else 1, 0.03)
    places = np.broadcast_to(middle + pads, (len(force), *pads.shape))
    radius = rng.uniform(0.012, 0.02) if hand else rng.uniform(0.0045, 0.008)
    return DrawnTouch(share(force, len(pads)), places, radius)


def poke(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a poke of 0.1 to 0.7 s."""
    steps = round(float(np.exp(rng.uniform(np.log(0.1), np.log(0.7)))) / STEP)
    force = np.sin(np.pi * np.linspace(0, 1, steps)) ** 0.5
    return stay(rng, device, force, hand=False)


def pats(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw two pats of a hand or of fingertips within 0.4 to 0.9 s."""
    each = round(rng.uniform(0.12, 0.26) / STEP)
    force = np.sin(np.pi * np.linspace(0, 1, each)) ** 0.5
    gap = np.zeros(round(rng.uniform(0.14, 0.36) / STEP))
    force = np.concatenate([force, gap, rng.uniform(0.7, 1.2) * force])
    return stay(rng, device, force, hand=rng.random() < 0.6)


def stroke(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a stroke over 28 mm or more, and over more than two cells."""
    u = np.linspace(0, 1, round(rng.uniform(0.28, 1.3) / STEP))
    return slide(rng, u, device)


def halting(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a stroke that rests before it slides and after."""
    first, move, last = (round(s / STEP) for s in rng.uniform(0.2, 0.5, 3))
    u = np.concatenate([np.zeros(first), np.linspace(0, 1, move), np.ones(last)])
    return slide(rng, u, device)


def slide(rng: np.random.Generator, u: Series, device: FlatDevice) -> DrawnTouch:
    """Return a touch whose place moves from end to end by `u`, from 0 to 1."""
    pitch = device.pitch
    size = device.size
    reach = float(np.max(size))
    length = rng.uniform(max(0.028, 2.2 * pitch), max(0.04, 2.6 * pitch, 0.9 * reach))
    turned = np.array(size)[1] < np.array(size)[0]
    away = rng.uniform(-0.2, 0.2) + (np.pi / 2 if turned else 0.0)
    way = np.array([np.cos(away), np.sin(away)]) * rng.choice([-1, 1])
    hand = rng.random() < 0.4
    pads = spread(rng, 3 if hand else 1, 0.02)
    middle = way * ((u - 0.5) * length)[:, None]
    radius = rng.uniform(0.01, 0.018) if hand else rng.uniform(0.0045, 0.008)
    return DrawnTouch(share(hold(len(u)), len(pads)), middle[:, None] + pads, radius)


def held(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a fingertip that is held for 1.4 to 2.4 s."""
    force = hold(round(rng.uniform(1.4, 2.4) / STEP), 0.08)
    return stay(rng, device, force, hand=False)


def resting(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a hand that rests for 0.9 to 2.4 s."""
    force = hold(round(rng.uniform(0.9, 2.4) / STEP), 0.15)
    return stay(rng, device, force, hand=True)


def cover(rng: np.random.Generator, device: FlatDevice) -> tuple[np.ndarray, float]:
    """Draw one to four neighbouring cells that a hand, an arm or a body lies on.

    Returns the centre of a pad inside each [m], and the radius of the pads [m].
    """
    centres = device.centres
    away = np.linalg.norm(centres - centres[rng.integers(len(centres))], axis=1)
    nearest = np.argsort(away)[: rng.integers(1, 5)]
    cells = nearest[away[nearest] <= rng.choice([0.18, 0.35])]
    radius = float(np.clip(rng.uniform(0.25, 0.5) * device.side, 0.01, 0.03))
    room = max(device.side / 2 - radius, 0.0)
    return centres[cells] + rng.uniform(-room, room, (len(cells), 2)), radius


def rest(
    rng: np.random.Generator, device: FlatDevice, shortest: float, longest: float
) -> DrawnTouch:
    """Draw a rest of some seconds whose pads begin and end within 0 to 80 ms.

    One in four stays until the recording ends.
    """
    pads, radius = cover(rng, device)
    seconds = np.exp(rng.uniform(np.log(shortest), np.log(longest)))
    uneven = rng.uniform(0, 0.08)
    first = rng.uniform(0, uneven, len(pads))
    last = seconds - rng.uniform(0, uneven, len(pads))
    stays = rng.random() < 0.25
    times = (np.arange(round(seconds / STEP)) + 0.5)[:, None] * STEP
    ramp = rng.uniform(0.03, 0.15)
    fall = np.inf if stays else (last - times) / ramp
    force = np.clip(np.minimum((times - first) / ramp, fall), 0, 1)
    sway = np.sin(2 * np.pi * rng.uniform(0.3, 2) * times + rng.uniform(0, 6))
    force *= rng.uniform(0.4, 1, len(pads)) * (1 + 0.1 * sway)
    drift = times[:, None] / seconds * rng.uniform(-0.003, 0.003, 2)
    return DrawnTouch(force, pads + drift, radius, stays)


def caress(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a stroke of a hand along a device, over 60 mm and a pitch or more."""
    extent = np.array(device.size)[::-1]
    axis = int(np.argmax(extent))
    shortest = max(0.06, device.pitch)
    length = rng.uniform(shortest, max(shortest, extent[axis]))
    seconds = min(length / rng.uniform(0.12, 0.5), 2.5)
    u = np.linspace(-0.5, 0.5, round(seconds / STEP)) * rng.choice([-1, 1])
    middle = device.centres[rng.integers(len(device.centres))].copy()
    slack = max(extent[axis] - length, 0.0) / 2
    middle[axis] = rng.uniform(-slack, slack)
    way = np.eye(2)[axis] * length
    pads = spread(rng, 5, 0.03)
    places = (middle + u[:, None] * way)[:, None] + pads
    return DrawnTouch(share(hold(len(u)), 5), places, rng.uniform(0.012, 0.02))


def beat(times: np.ndarray, first: np.ndarray | float, seconds: float) -> np.ndarray:
    """Return the force of a beat that begins at a time [s]."""
    return np.sin(np.pi * np.clip((times - first) / seconds, 0, 1)) ** 0.5


def pat_cells(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw two pats of a hand whose pads begin within 30 ms, on one to four cells."""
    pads, radius = cover(rng, device)
    seconds = rng.uniform(0.12, 0.26)
    second = seconds + rng.uniform(0.14, 0.36)
    first = rng.uniform(0, 0.03, len(pads))
    times = np.arange(round((second + seconds + 0.03) / STEP))[:, None] * STEP
    force = beat(times, first, seconds)
    force = force + rng.uniform(0.7, 1.2) * beat(times, first + second, seconds)
    places = np.broadcast_to(pads, (len(times), *pads.shape))
    return DrawnTouch(force * rng.uniform(0.5, 1, len(pads)), places, radius)


def poke_cell(rng: np.random.Generator, device: FlatDevice) -> DrawnTouch:
    """Draw a poke of a fingertip of 0.1 to 0.6 s inside one cell."""
    seconds = np.exp(rng.uniform(np.log(0.1), np.log(0.6)))
    radius = rng.uniform(0.0045, 0.008)
    room = device.side / 2 - radius
    place = rng.choice(device.centres) + rng.uniform(-room, room, 2)
    times = np.arange(round(seconds / STEP)) * STEP
    places = np.broadcast_to(place, (len(times), 1, 2))
    return DrawnTouch(share(beat(times, 0.0, seconds), 1), places, radius)


def travel(
    rng: np.random.Generator,
    device: FlatDevice,
    lengths: tuple[float, float],
    seconds: tuple[float, float],
    poked: bool,
) -> DrawnTouch:
    """Draw a fingertip that presses for a time [s] while it slides a length [m]."""
    length = rng.uniform(*lengths)
    time = np.exp(rng.uniform(*np.log(seconds)))
    u = np.linspace(0, 1, round(time / STEP))
    away = rng.uniform(0, 2 * np.pi)
    way = np.array([np.cos(away), np.sin(away)]) * length
    room = np.clip(np.array(device.size)[::-1] - np.abs(way), 0, None) / 2
    middle = rng.uniform(-0.8, 0.8, 2) * room
    places = middle + (u[:, None] - 0.5) * way
    force = np.sin(np.pi * u) ** 0.5 if poked else hold(len(u))
    return DrawnTouch(share(force, 1), places[:, None], rng.uniform(0.0045, 0.008))


def beats(rng: np.random.Generator, device: FlatDevice, count: int) -> DrawnTouch:
    """Draw beats of a hand that moves by up to a cell between them.

    Each is 0.1 to 0.25 s long and begins 0.3 to 0.7 s after the one before; between
    them 0 to 5 % of the force remains.
    """
    seconds = rng.uniform(0.1, 0.25, count)
    first = rng.uniform(0, 0.05) + np.cumsum(np.r_[0, rng.uniform(0.3, 0.7, count - 1)])
    times = np.arange(round((first[-1] + seconds[-1]) / STEP)) * STEP
    force = np.zeros(len(times))
    for start, length in zip(first, seconds, strict=True):
        force += rng.uniform(0.7, 1) * beat(times, start, length)
    between = (times > first[0]) & (times < first[-1])
    force = np.maximum(force, rng.uniform(0, 0.05) * between)
    moves = rng.uniform(0, device.pitch, (count, 1))
    turns = rng.uniform(0, 2 * np.pi, (count, 1))
    steps = moves * np.hstack([np.cos(turns), np.sin(turns)])
    centres = np.cumsum(steps, axis=0)
    spot = rng.uniform(-0.25, 0.25, 2) * np.array(device.size)[::-1]
    centres += spot - centres.mean(0)
    knots = np.column_stack([first, first + seconds]).ravel()
    middle = np.column_stack(
        [np.interp(times, knots, np.repeat(c, 2)) for c in centres.T]
    )
    pads = spread(rng, int(rng.integers(2, 4)), 0.6 * device.pitch)
    places = middle[:, None] + pads
    return DrawnTouch(share(force, len(pads)), places, rng.uniform(0.012, 0.02))


def tap(
    rng: np.random.Generator, device: FlatDevice, shortest: float, longest: float
) -> DrawnTouch:
    """Draw a tap of a fingertip that lasts between two times [s]."""
    seconds = rng.uniform(shortest, longest)
    first = rng.uniform(0, 0.1)
    times = np.arange(round((first + seconds) / STEP) + 1) * STEP
    return stay(rng, device, beat(times, first, seconds), hand=False)


def press_bump(
    rng: np.random.Generator,
    contact: PressedEllipse,
    skin: Skin,
    taxel: int,
    times: Series,
) -> np.ndarray:
    """Return pressures [kPa] of a contact anywhere in a taxel, turned anyhow."""
    off = rng.uniform(-0.5, 0.5, 2) * np.sqrt(skin.areas[taxel])
    placed = replace(contact, places=contact.places + off)
    return press_taxels(placed, skin, taxel, rng.uniform(0, 2 * np.pi), times)


@cache
def mount_ur5() -> MountedSkin:
    """Return the skin `ur5` on its robot."""
    return MountedSkin(load_skin("ur5"), load_robot("ur5"))


def draw_bump_on_ur5(
    rng: np.random.Generator, make: Callable[[np.random.Generator], PressedEllipse]
) -> TouchReadings:
    """Draw a bump on the skin `ur5`, read at 40 to 100 Hz, until it is shown."""
    mounted = mount_ur5()
    skin = mounted.skin
    while True:
        contact = make(rng)
        seconds = REST_BEFORE + contact.times[-1] + REST_AFTER
        times = np.arange(rng.uniform(0, 0.02), seconds, 1 / rng.uniform(40, 100))
        taxel = int(rng.integers(skin.count))
        pressure = press_bump(rng, contact, skin, taxel, times - REST_BEFORE)
        read = np.clip(pressure * rng.uniform(0.8, 1.25), 0, FULL_SCALE)
        if read.max() >= SHOWN:
            q = rng.uniform(-1.5, 1.5, len(mounted.robot.joint_names))
            return TouchReadings(mounted, q, times, read)


def draw_bump_on_grid(
    rng: np.random.Generator, make: Callable[[np.random.Generator], PressedEllipse]
) -> TouchReadings:
    """Draw a bump on a grid drawn anew, until it is shown."""
    while True:
        device = draw_grid(rng, binary=False)
        contact = make(rng)
        spot = rng.uniform(-0.25, 0.25, 2) * np.array(device.size)[::-1]
        taxel = int(np.argmin(np.linalg.norm(device.centres - spot, axis=1)))
        times = np.arange(0, contact.times[-1] + STEP, STEP) - rng.uniform(0, STEP)
        pressure = press_bump(rng, contact, device.skin, taxel, times)
        known, read = read_sensor(pressure, rng, CellReadout())
        if read.max() >= SHOWN:
            mounted = MountedSkin(device.skin, load_robot("table"))
            return TouchReadings(mounted, np.zeros(0), known, read)


def draw_ball(rng: np.random.Generator) -> tuple[Ball, float]:
    """Draw a sphere and its velocity into the skin [m/s], of which Hertz holds."""
    while True:
        radius = rng.uniform(0.02, 0.08)
        mass = np.exp(rng.uniform(np.log(0.3), np.log(5)))
        modulus = np.exp(rng.uniform(np.log(2e5), np.log(3e6)))
        ball = Ball(radius, mass, modulus, rng.uniform(0.2, 0.7), rng.uniform(0.2, 0.8))
        speed = rng.uniform(0.1, 0.6)
        if (1.25 * mass * speed**2 / ball.stiffness) ** 0.4 < 0.4 * radius:
            return ball, speed


def bump_straight(rng: np.random.Generator) -> PressedEllipse:
    """Draw a sphere that hits the skin along its normal."""
    ball, speed = draw_ball(rng)
    return press_sphere(strike(ball, speed), ball)


def bump_obliquely(rng: np.random.Generator) -> PressedEllipse:
    """Draw a sphere that also moves along the skin."""
    ball, speed = draw_ball(rng)
    return press_sphere(strike(ball, speed, rng.uniform(0.1, 0.6)), ball)


def bump_twice(rng: np.random.Generator) -> PressedEllipse:
    """Draw a sphere that comes back after 0.05 to 0.4 s, as fast as it left."""
    ball, speed = draw_ball(rng)
    first = strike(ball, speed, rng.uniform(0, 0.3))
    left = -first.approach[-1]
    second = strike(ball, left, first.sliding[-1], first.slip[-1])
    gap = rng.uniform(0.05, 0.4)
    return press_sphere(first, ball).follow(press_sphere(second, ball), gap)


def bump_with_follower(rng: np.random.Generator) -> PressedEllipse:
    """Draw a sphere that a second body of 0.5 to 5 kg pushes."""
    ball, speed = draw_ball(rng)
    mass = np.exp(rng.uniform(np.log(0.5), np.log(5)))
    stiffness = np.exp(rng.uniform(np.log(1e3), np.log(2e4)))
    reduced = mass * ball.mass / (mass + ball.mass)
    damping = 2 * rng.uniform(0.05, 0.3) * np.sqrt(stiffness * reduced)
    follower = PushingBody(mass, stiffness, damping)
    return press_sphere(strike(ball, speed, follower=follower), ball)


def push_forearm(rng: np.random.Generator) -> PressedEllipse:
    """Draw a push of a forearm of 50 to 150 ms."""
    axes = rng.uniform(0.012, 0.025), rng.uniform(0.03, 0.07)
    return push_ellipse(rng.uniform(10, 80), rng.uniform(0.05, 0.15), axes)


def build_row(
    truth: str,
    device: Callable[[np.random.Generator], FlatDevice],
    touch: Callable[[np.random.Generator, FlatDevice], DrawnTouch],
    readout: CellReadout,
    accept: Callable[[np.ndarray, FlatDevice], bool] = accept_shown,
) -> Row:
    """Return a row of touches on flat devices."""
    draw = partial(
        draw_touch, device=device, touch=touch, readout=readout, accept=accept
    )
    return Row(truth, draw)


def build_drawn() -> dict[str, Row]:
    """Return the rows of all gestures on grids; binary ones are on or off."""
    kinds = (
        ("fingertip pokes", "poke", poke),
        ("two pats", "double_pat", pats),
        ("stroke", "stroke", stroke),
        ("stroke that rests before and after", "stroke", halting),
        ("fingertip held (guard)", NONE, held),
        ("hand rests (guard)", NONE, resting),
        ("binary: two pats", "double_pat", pats),
        ("binary: stroke", "stroke", stroke),
        ("binary: hand rests (guard)", NONE, resting),
    )
    rows = {}
    for name, truth, touch in kinds:
        binary = name.startswith("binary")
        grid = partial(draw_grid, binary=binary)
        rows[name] = build_row(truth, grid, touch, CellReadout(binary), accept_any)
    return rows


LAYOUTS = (("cells side by side", False), ("cells apart", True))
"""Names of the layouts of large cells, and whether these lie apart."""

READOUTS = (("graded", False), ("binary", True))
"""Names of the readouts of large cells, and whether these are on or off."""


def build_rests() -> dict[str, Row]:
    """Return the rows of rests on large cells, by duration."""
    rows = {}
    for band in ((0.3, 0.6), (0.6, 1.0), (1.0, 3.0)):
        touch = partial(rest, shortest=band[0], longest=band[1])
        for layout, apart in LAYOUTS:
            device = partial(draw_pads, apart=apart)
            for kind, binary in READOUTS:
                name = f"rest of {band[0]:g} to {band[1]:g} s, {layout}, {kind}"
                readout = CellReadout(binary, (12.0, 50.0))
                rows[name] = build_row(NONE, device, touch, readout)
    return rows


def build_caresses() -> dict[str, Row]:
    """Return the rows of gestures on large cells."""
    kinds = (
        ("hand strokes two cells or more", "stroke", caress, 2, accept_passing),
        ("hand pats one to four cells twice", "double_pat", pat_cells, 1, accept_shown),
        ("fingertip pokes a cell", "poke", poke_cell, 1, accept_shown),
    )
    rows = {}
    for what, truth, touch, least, accept in kinds:
        for layout, apart in LAYOUTS:
            device = partial(draw_pads, apart=apart, least=least)
            for kind, binary in READOUTS:
                name = f"{what}, {layout}, {kind}"
                readout = CellReadout(binary, (12.0, 50.0))
                rows[name] = build_row(truth, device, touch, readout, accept)
    return rows


def build_travel() -> dict[str, Row]:
    """Return the rows of fingertips that slide on fine grids."""
    kinds = (
        ("poke of 0.15 to 0.4 s", (0.010, 0.015), (0.15, 0.4), True),
        ("poke of 0.4 to 0.8 s", (0.010, 0.015), (0.4, 0.8), True),
        ("stroke of 0.2 to 0.6 s", (0.030, 0.050), (0.2, 0.6), False),
        ("stroke of 0.6 to 1.5 s", (0.030, 0.050), (0.6, 1.5), False),
    )
    device = partial(draw_cells, finest=0.003, coarsest=0.010)
    rows = {}
    for what, lengths, seconds, poked in kinds:
        touch = partial(travel, lengths=lengths, seconds=seconds, poked=poked)
        name = f"{what}, travels {lengths[0] * 1000:.0f} to {lengths[1] * 1000:.0f} mm"
        truth = "poke" if poked else "stroke"
        rows[name] = build_row(truth, device, touch, CellReadout())
    return rows


def build_beats() -> dict[str, Row]:
    """Return the rows of pats by a hand that moves and hardly lifts."""
    device = partial(draw_cells, finest=0.025, coarsest=0.035, least=0.07, most=0.14)
    rows = {}
    for count, what in ((2, "two beats"), (3, "three beats")):
        touch = partial(beats, count=count)
        for lag, lagging in (("no lag", 0.0), ("lag up to 0.15 s", 1.0)):
            readout = CellReadout(False, (20.0, 50.0), (0.01, 0.15), lagging)
            name = f"{what}, {lag}"
            rows[name] = build_row("double_pat", device, touch, readout, accept_few)
    return rows


def build_taps() -> dict[str, Row]:
    """Return the rows of short taps."""
    rows = {}
    for shortest, longest in ((0.04, 0.07), (0.07, 0.1)):
        touch = partial(tap, shortest=shortest, longest=longest)
        for finest, coarsest in ((0.004, 0.012), (0.012, 0.035)):
            device = partial(draw_cells, finest=finest, coarsest=coarsest)
            times = f"{shortest * 1000:.0f} to {longest * 1000:.0f} ms"
            cells = f"{finest * 1000:.0f} to {coarsest * 1000:.0f} mm"
            readout = CellReadout(rates=(12.0, 50.0), lagging=0.25)
            name = f"tap of {times}, cells of {cells}"
            rows[name] = build_row("poke", device, touch, readout)
    return rows


def build_bumps() -> dict[str, Row]:
    """Return the rows of bodies that strike a skin."""
    makes = (
        ("sphere hits along the normal", bump_straight),
        ("sphere hits obliquely", bump_obliquely),
        ("sphere bounces twice", bump_twice),
        ("sphere with a body behind it", bump_with_follower),
        ("forearm pushes 50 to 150 ms", push_forearm),
    )
    rows = {}
    for skin, draw in (("ur5", draw_bump_on_ur5), ("grid", draw_bump_on_grid)):
        for what, make in makes:
            rows[f"{skin}: {what}"] = Row(NONE, partial(draw, make=make))
    return rows


PARTS: dict[str, dict[str, Row]] = {
    "drawn": build_drawn(),
    "rests": build_rests(),
    "caresses": build_caresses(),
    "travel": build_travel(),
    "beats": build_beats(),
    "taps": build_taps(),
    "bumps": build_bumps(),
}
"""Rows of each part; the order seeds their draws."""


def format_table(found: Iterable[Answer]) -> str:
    """Format shares by row and of all, with 95 % intervals (Wilson)."""
    names = ("row", "truth", "n", "forced right", "live right", "live another gesture")
    rows = [format_head(names)]
    every = []
    for name, group in groupby(found, key=lambda each: each[0]):
        answers = list(group)
        rows.append(format_answers(name, answers[0][1], answers))
        every += answers
    rows.append(format_answers("all", "", every))
    return "\n".join(rows)


def format_answers(name: str, truth: str, answers: Sequence[Answer]) -> str:
    """Format the shares of some answers as a row, with the gestures taken wrongly."""
    others = Counter(
        live for _, right, _, live in answers if live not in (right, NONE, UNKNOWN)
    )
    shares = [
        format_share([forced == right for _, right, forced, _ in answers]),
        format_share([live == right for _, right, _, live in answers]),
        format_share([k < others.total() for k in range(len(answers))]),
    ]
    listed = ", ".join(f"{gesture} {n}" for gesture, n in others.most_common(3))
    shares[-1] += f" {listed}" if listed and truth else ""
    return format_row([name, truth, str(len(answers)), *shares])


def format_share(right: Sequence[bool]) -> str:
    """Format a share with its 95 % interval (Wilson)."""
    low, high = bound_share(sum(right), len(right))
    return f"{np.mean(right):.0%} [{low:.0%}, {high:.0%}]"


if __name__ == "__main__":
    main()
