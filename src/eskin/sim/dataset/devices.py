"""This module draws small devices at random, and simulates clips of touches on them.

A device is a grid of cells on a plane or a tube, or some pads apart from each other,
read out in some way. Cells, rates, gains and lags span those of sensors that can be
bought, so that a recogniser learns what is common to touches on all of them, not what
one sensor makes of them.
"""

import zlib
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Int

from eskin.recording import NONE
from eskin.robot import load_robot
from eskin.sim.constants import MM, Constants, load_constants
from eskin.sim.contact.chart import build_charts
from eskin.sim.contact.press import ContactSite, Press, TrueTouch
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.dataset.clip_generator import ClipGenerator
from eskin.sim.dataset.plan import IDLE, BuildOrigin, ClipPlan, SessionPlan
from eskin.sim.dataset.staging import draw_start
from eskin.sim.people.gesture_sample import build_minimum_jerk
from eskin.sim.people.perform import perform
from eskin.sim.people.person import draw_person
from eskin.sim.people.recorded import (
    RecordedPeople,
    draw_recorded_touch,
    play_recorded_touch,
    read_recorded_touches,
)
from eskin.sim.scene.scene import (
    TrueTouchSeries,
    compute_scene_presses,
    find_contact_steps,
    shift_touch,
    sum_pressure,
)
from eskin.skin import MountedSkin, Patch, Plane, Skin, Tube
from eskin.skin.layout import TaxelGrid, build_skin
from eskin.touch import Calibration
from eskin.touch.records import FINGERTIP

LINK = "table"
"""Robot, and link, that devices are fixed to."""

FINEST = 0.005
"""Largest cell in which pressure is computed before it is averaged [m]."""

TYPICAL_FORCE = 3.0
"""Force of a typical touch, which reads the level of a device [N]."""

TIP_AREA = 1e-4
"""Area of a fingertip in contact [m2]."""

VISIBLE = 1.5
"""Least reading of a touch that a device shows [kPa]."""

TRIES = 12
"""Touches that are drawn until one is shown."""

ReadingWay = Literal["line", "hold", "own"]
READINGS: tuple[ReadingWay, ...] = ("line", "hold", "own")
"""Ways in which devices are read."""

USUAL_PERIOD = 0.02
"""Period at which slower devices are read [s]."""

PADS = 0.4
"""Share of devices that have a few large pads, perhaps apart, instead of many cells."""

NONE_KINDS = {
    "resting_hand": 0.36,
    "press": 0.14,
    "lean": 0.1,
    "bump": 0.12,
    "single_pat": 0.1,
    "squeeze_hold": 0.04,
    "rub": 0.07,
    "tickle": 0.07,
}
"""Kinds of `none` on devices, with their shares."""

LIKE_A_POKE = ("single_pat", "rub", "tickle")
"""Kinds that look like a poke, or like a hand at rest, on cells larger than what moves;
a hand rests on such cells instead."""


@dataclass(frozen=True, eq=False)
class Device:
    """A device is a grid of cells with its way of measuring and of being read."""

    skin: Skin
    """Cells."""
    fine: Skin
    """The same surface in small cells, in which pressure is computed."""
    finer: int
    """Number of small cells from one cell to the next."""
    inner: int
    """Number of these that the cell itself covers, in the middle; the others are a gap
    that measures nothing."""
    pitch: float
    """Distance of neighbouring cells [m]."""
    closed: bool
    """Whether its cells go all the way round a tube."""
    rate: float
    """Measurements a second [Hz]."""
    reading: ReadingWay
    """Read at a higher rate, by interpolation or by repetition, or as they come."""
    gain: float
    """Reading over pressure."""
    lag: float
    """Time constant with which a reading falls [s]; 0 for none."""
    binary: float
    """Pressure above which a cell of a binary device is on [kPa]; 0 for others."""
    full: float
    """Reading at full scale [kPa]."""
    counts: int
    """Counts at full scale."""
    noise: float
    """Standard deviation of a measurement [counts]."""

    @property
    def has_large_cells(self) -> bool:
        """Return whether a cell is larger than a fingertip."""
        return float(self.skin.areas[0]) >= FINGERTIP


def draw_between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number between two limits, its logarithm uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


@lru_cache(maxsize=16)
def draw_device(name: str) -> Device:
    """Draw the device of a name, always the same."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))

    between = partial(draw_between, rng)
    has_pads = rng.random() < PADS
    if has_pads:
        cell = between(20.0, 90.0) * MM
        apart = between(1.15, 4.0) if rng.random() < 0.5 else 1.0
        pitch = min(cell * apart, max(0.16, cell))
        cells = int(between(1.0, 13.0))
        rows = int(rng.choice([n for n in (1, 2, 3) if cells % n == 0]))
        columns = cells // rows
    else:
        cell = pitch = between(3.0, 40.0) * MM
        largest = max(0.12, 5 * pitch)
        rows, columns = (
            int(np.clip(round(between(0.05, largest) / pitch), 2, 24)) for _ in "rc"
        )
    round_it = rng.random() < 0.4
    radius = between(0.02, 0.07)
    closed = round_it and 2 * np.pi * radius / pitch >= 3 and rng.random() < 0.6
    if closed:
        columns = min(int(2 * np.pi * radius / pitch), 40)
        radius = columns * pitch / (2 * np.pi)
    round_it = closed or (round_it and columns * pitch < 4 * radius)
    surface = Tube(radius, np.eye(4)) if round_it else Plane(np.eye(4))
    finer = int(np.ceil(pitch / FINEST))
    inner = max(1, round(finer * cell / pitch))
    inner -= (finer - inner) % 2
    inner = max(inner, 1 + (finer + 1) % 2)
    separate = has_pads and rng.random() < 0.5

    def build(times: int) -> Skin:
        size = rows * times, columns * times
        grid = TaxelGrid(*size, pitch / times, pitch / times)
        patch = Patch("grid", LINK, 1, *size)
        return build_skin(name, [(patch, grid, surface)])

    skin = build(1)
    skin = replace(skin, areas=skin.areas * (inner / finer) ** 2)
    if separate:
        skin = separate_cells(skin)
    reading = READINGS[rng.integers(len(READINGS))]
    level = between(2.0, 40.0)
    typical = TYPICAL_FORCE / max(cell**2, TIP_AREA) / 1000
    chance = 0.5 if has_pads else 0.25
    binary = typical * between(0.01, 0.3) if rng.random() < chance else 0.0
    counts = int(rng.choice([255, 1023, 4095]))
    rate = between(9.0, 60.0)
    lag = float(rng.uniform(0.05, 0.5)) if rng.random() < 0.5 else 0.0
    full = between(10.0, 60.0) if binary else max(level * between(0.6, 3.0), 4.0)
    return Device(
        skin=skin,
        fine=build(finer),
        finer=finer,
        inner=inner,
        pitch=pitch,
        closed=closed,
        rate=rate,
        reading=reading,
        gain=level / typical,
        # Two pats on a binary device that lags would look like one that is held.
        lag=0.0 if binary else lag,
        binary=binary,
        full=full,
        counts=counts,
        noise=float(rng.uniform(0.0, counts / 400)) if rng.random() < 0.5 else 0.0,
    )


def separate_cells(skin: Skin) -> Skin:
    """Return a skin each of whose taxels is a patch of its own."""
    count = skin.count
    patches = tuple(Patch(f"pad{n}", LINK, n, 1, 1) for n in range(count))
    alone = np.zeros(count, dtype=np.int64)
    return replace(
        skin,
        patches=patches,
        patch_index=np.arange(count),
        rows=alone,
        columns=alone,
    )


def name_device(session: SessionPlan) -> str:
    """Return the name of the device of a session."""
    return "device-" + "-".join(map(str, session.build.seed))


def fit_to_device(plan: ClipPlan, name: str) -> ClipPlan:
    """Return a plan of `none` where the device cannot show the gesture of a plan.

    A grab would be a hand that lies on the device, where no hand can close round it, or
    where cells are only on or off. A single cell shows no stroke.
    """
    device = draw_device(name)
    can_show = {
        "grab": device.closed and not device.binary,
        "stroke": device.skin.count > 1,
    }
    if can_show.get(plan.gesture or NONE, True):
        return plan
    return replace(plan, gesture=NONE)


@final
class DeviceSimulator(ClipGenerator):
    """A device simulator generates clips of people, or recorded ones, on one device."""

    robot_name = LINK

    def __init__(self, name: str, recorded: RecordedPeople | None = None) -> None:
        """Draw the device of a name, and read the recorded touches if any."""
        self.device = draw_device(name)
        self.mounted = MountedSkin(self.device.skin, load_robot(LINK))
        self.constants = load_constants()
        fine = MountedSkin(self.device.fine, self.mounted.robot)
        rim = self.constants.value("contact.rim")
        self.charts = build_charts(fine, rim)
        self.touches = recorded and read_recorded_touches(recorded.folder)

    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the nominal calibration of the device."""
        device = self.device
        return Calibration.uniform(device.skin.count, device.counts, device.full)

    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the clip of a plan."""
        rng = plan.rng()
        value = self.constants.value
        step = value("time.step")
        lead = round(value("clip.before") / step)
        steps = round(plan.seconds / step)
        pressure = np.zeros((lead + steps, self.device.fine.count))
        measured = np.zeros((lead + steps, self.device.skin.count))
        touch = None
        for _ in range(0 if plan.kind == IDLE else TRIES):
            touch = self.draw_touch(plan, rng)
            touch = shift_touch(touch, lead + self.draw_start(touch, steps, rng))
            presses = compute_scene_presses(
                touch, lead + steps, self.charts, self.constants
            )
            part, cells = sum_pressure(presses, lead + steps, pressure.shape[1])
            pressure[:] = 0.0
            pressure[:, cells] = part
            measured = measure(self.device, pressure, step)
            shown = measured[lead:].max(axis=0) >= VISIBLE
            if shown.sum() >= (2 if touch.gesture == "stroke" else 1):
                break
        times, counts = read_out(self.device, measured[lead:], step, rng)
        at = np.minimum(np.rint(times / step).astype(np.int64), steps - 1)
        truths = ()
        if touch is not None and pressure[lead:].any():
            truths = (self.find_truth(touch, pressure, lead, at, step),)
        drawn: dict[str, float | str] = {} if touch is None else {"kind": touch.kind}
        received = np.ones(counts.shape, dtype=np.bool_)
        q = np.zeros((len(counts), 0))
        return SimulatedClip(counts, received, q, truths, 0, drawn, times)

    def draw_touch(self, plan: ClipPlan, rng: np.random.Generator) -> TrueTouch:
        """Draw the touch of a clip, from step 0 on."""
        site = self.draw_site(rng)
        gesture = plan.gesture or NONE
        if self.touches is not None:
            name = plan.person.name
            chosen = draw_recorded_touch(self.touches, name, gesture, rng)
            return play_recorded_touch(chosen, site, self.constants, rng)
        person = draw_person(plan.person.name, self.constants, plan.person.rng())
        kind = None
        if gesture == NONE:
            kind = str(rng.choice(list(NONE_KINDS), p=list(NONE_KINDS.values())))
            if self.device.has_large_cells and kind in LIKE_A_POKE:
                kind = "resting_hand"
        wanted = draw_wishes(kind or gesture, self.device, rng)
        constants = self.constants
        difficulty = plan.difficulty
        touch = perform(
            gesture, kind, person, site, constants, rng, difficulty, None, wanted
        )
        if gesture == "poke" and rng.random() < 0.35:
            return slide_poke(touch, rng)
        return add_rests(touch, constants, rng) if gesture == "stroke" else touch

    def draw_site(self, rng: np.random.Generator) -> ContactSite:
        """Draw where a touch is, anywhere but at the very edge."""
        unrolled = self.charts[0].unrolled
        low, high = unrolled.min(axis=0), unrolled.max(axis=0)
        s, t = low + (high - low) * rng.uniform(0.15, 0.85, 2)
        beyond = self.constants.value("place.beyond") * MM / 2
        return ContactSite(
            chart=0,
            centre=(float(s), float(t)),
            radius=self.charts[0].radius,
            free_run=(float(low[1] - t), float(high[1] - t)),
            angle=float(rng.uniform(-np.pi, np.pi)),
            beyond=(beyond, beyond),
            can_close=self.device.closed,
        )

    def draw_start(self, touch: TrueTouch, steps: int, rng: np.random.Generator) -> int:
        """Draw the step of the clip at which a touch's clock starts.

        All of it is in the clip, unless it is longer.
        """
        first, end = find_contact_steps(touch)
        if end - first >= steps:
            return draw_start(touch, steps, self.constants, rng)
        return int(rng.integers(steps - (end - first) + 1)) - first

    def find_truth(
        self,
        touch: TrueTouch,
        pressure: Float[np.ndarray, "time fine"],
        lead: int,
        at: Int[np.ndarray, "reading"],
        step: float,
    ) -> TrueTouchSeries:
        """Return the true touch at the readings, of what presses on the device."""
        fine = self.device.fine
        load = pressure[lead + at] * fine.areas * 1000
        force = load.sum(axis=1)
        first, end = find_contact_steps(touch)
        touched = pressure[lead + at] >= self.constants.value("contact.touched")
        return TrueTouchSeries(
            number=0,
            gesture=touch.gesture,
            kind=touch.kind,
            subject=touch.subject,
            link=LINK,
            force=force,
            area=touched @ fine.areas,
            centroid=load @ fine.positions / np.maximum(force, 1e-9)[:, None],
            onset=(first - lead) * step,
            end=(end - lead) * step,
        )


def draw_wishes(
    name: str, device: Device, rng: np.random.Generator
) -> dict[str, float]:
    """Draw sizes and durations of a gesture that simulated people seldom choose.

    Strokes are long enough to pass from cell to cell. A hand rests from 0.3 s on, and
    may be put down and lifted within 0.1 s, so that cells switch at nearly once. A
    poke on a cell that is larger than a fingertip is shorter than half a second: there
    only its duration tells it from a hand. Pats move by up to a cell.
    """
    between = partial(draw_between, rng)
    if name == "poke":
        if device.has_large_cells:
            return {"duration": between(0.04, 0.5)}
        return {"duration": between(0.04, 0.35)} if rng.random() < 0.5 else {}
    if name == "double_pat" and rng.random() < 0.5:
        most = min(max(device.pitch, 0.01), 0.04)
        return {"double_pat.shift": float(rng.uniform(0.0, most))}
    if name == "resting_hand" and rng.random() < 0.7:
        wishes = {"none.resting_hand.hold": between(0.3, 2.0), "began_before": 0.0}
        return wishes | {"none.resting_hand.ramp": between(0.03, 0.4)}
    if name == "lean" and rng.random() < 0.5:
        wishes = {"none.lean.hold": between(0.5, 2.0)}
        return wishes | {"none.lean.ramp": between(0.03, 0.4)}
    if name == "stroke":
        least = max(0.025, device.pitch * (2.0 if device.binary else 1.3))
        span = device.pitch * np.sqrt(device.skin.count)
        length = rng.uniform(least, max(1.3 * least, span))
        speed = np.exp(rng.uniform(np.log(0.04), np.log(0.4)))
        duration = float(np.clip(length / speed, 0.15, 1.8))
        return {"length": length, "duration": duration, "both": 0.0}
    return {}


LONGEST_POKE_TRAVEL = 0.015
"""Largest distance over which the finger of a poke slips [m]."""


def slide_poke(touch: TrueTouch, rng: np.random.Generator) -> TrueTouch:
    """Return a poke whose finger slips a little while it presses."""
    travel = rng.uniform(0.004, LONGEST_POKE_TRAVEL)
    away = rng.uniform(-np.pi, np.pi)
    presses = []
    for press in touch.presses:
        share = build_minimum_jerk(press.steps)[:, None]
        path = travel * share * np.array([np.cos(away), np.sin(away)])
        presses.append(replace(press, centre=press.centre + path))
    return replace(touch, presses=tuple(presses))


def add_rests(
    touch: TrueTouch, constants: Constants, rng: np.random.Generator
) -> TrueTouch:
    """Return a stroke that perhaps rests before the hand slides, and after."""
    step = constants.value("time.step")
    rests = [
        round(float(rng.uniform(0.05, 0.6)) / step) if rng.random() < 0.45 else 0
        for _ in range(2)
    ]
    presses = []
    for press in touch.presses:
        assert isinstance(press, Press)
        firm = np.flatnonzero(press.force >= 0.6 * press.force.max())
        times = np.ones(press.steps, dtype=np.int64)
        times[firm[0]] += rests[0]
        times[firm[-1]] += rests[1]
        index = np.repeat(np.arange(press.steps), times)
        presses.append(
            replace(
                press,
                force=press.force[index],
                centre=press.centre[index],
                angle=press.angle[index],
            )
        )
    return replace(touch, presses=tuple(presses))


def measure(
    device: Device, pressure: Float[np.ndarray, "time fine"], step: float
) -> Float[np.ndarray, "time taxel"]:
    """Return what each cell shows at each step: its mean pressure, as it reads it."""
    times = device.finer
    fine = device.fine.patches[0]
    shape = (len(pressure), fine.rows // times, times, fine.columns // times, times)
    first = (times - device.inner) // 2
    inner = slice(first, first + device.inner)
    cells = pressure.reshape(shape)[:, :, inner, :, inner]
    mean = cells.mean(axis=(2, 4)).reshape(len(pressure), -1)
    if device.lag:
        kept = np.exp(-step / device.lag)
        for number in range(1, len(mean)):
            mean[number] = np.maximum(mean[number], kept * mean[number - 1])
    if device.binary:
        return np.where(mean > device.binary, device.full, 0.0)
    return np.minimum(device.gain * mean, device.full)


def read_out(
    device: Device,
    measured: Float[np.ndarray, "time taxel"],
    step: float,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "reading"], Int[np.ndarray, "reading taxel"]]:
    """Return the times of readings [s], and their counts."""
    seconds = len(measured) * step
    period = 1 / device.rate
    known = np.arange(rng.uniform(0, period) - period, seconds, period)
    at = np.clip(np.rint(known / step).astype(np.int64), 0, len(measured) - 1)
    counts = measured[at] / device.full * device.counts
    if not device.binary:
        counts = counts + device.noise * rng.standard_normal(counts.shape)
    if device.reading == "own" or period <= USUAL_PERIOD:
        times = known[1:]
        counts = counts[1:]
    else:
        times = np.arange(0, known[-1], USUAL_PERIOD)
        before = np.searchsorted(known, times, side="right") - 1
        share = (times - known[before]) / period * (device.reading == "line")
        after = np.minimum(before + 1, len(known) - 1)
        share = share[:, None]
        counts = (1 - share) * counts[before] + share * counts[after]
    rounded = np.clip(np.rint(counts), 0, device.counts).astype(np.int32)
    return times, rounded


@dataclass(frozen=True)
class DeviceFactory:
    """This factory builds the simulator of a device, in any process."""

    recorded: RecordedPeople | None = None
    """People whose recorded touches are played; None draws touches."""

    def __call__(self, name: str) -> DeviceSimulator:
        """Build the simulator of the device of a name."""
        return DeviceSimulator(name, self.recorded)
