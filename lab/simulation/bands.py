"""Check sizes, forces, times and spectra of gestures on the forearm of the UR5."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.press import ContactSite, TrueTouch
from eskin.sim.contact.pressure import (
    compute_leak_share,
    find_grid_neighbours,
    spread_through_film,
)
from eskin.sim.dataset import Simulator, get_build
from eskin.sim.dataset.clip import get_session, simulate_clip
from eskin.sim.dataset.plan import BuildOrigin, Origin
from eskin.sim.dataset.session_file import compute_rest_counts
from eskin.sim.people.gesture_sample import Regime
from eskin.sim.people.perform import perform
from eskin.sim.people.person import Person, draw_person
from eskin.sim.scene import SimEnvironment
from eskin.sim.scene.scene import (
    TouchScene,
    compute_scene_presses,
    find_contact_steps,
    shift_touch,
    sum_pressure,
)
from eskin.touch.calibration_kernels import linearise_counts
from lab.simulation.check import BandCheck, at_least, within
from lab.simulation.physics import FOREARM

BANDS = {
    "poke": ((3, 4, 7), (3, 5, 7), (2, 4, 7), (16, 32, 59)),
    "double_pat": ((9, 18, 32), (12, 24, 41), (4, 7, 14), (10, 18, 37)),
    "grab": ((35, 58, 83), (35, 58, 83), (16, 25, 43), (13, 21, 35)),
    "stroke": ((4, 7, 12), (27, 51, 106), (1, 3, 5), (5, 10, 23)),
    "none": ((4, 20, 53), (6, 22, 56), (2, 11, 43), (7, 16, 40)),
}
"""An earlier prototype's 10th, 50th and 90th percentiles, in the order of `SIZES`."""
SIZES = ("taxels at peak", "taxels in all", "peak force [N]", "peak pressure [kPa]")
PRESSED = 2.0  # [kPa]
UNTOUCHED = ("idle", "electrical", "self_contact")
LENGTHS = {"poke": (0.96, 1.0), "double_pat": (0.96, 1.0)}
LENGTHS |= {"grab": (0.60, 0.66), "stroke": (0.60, 0.66)}
"""Share of touches that are shorter than 1 s."""
REPEATS = 3
"""Touches of each gesture by each person."""
MORE = 10
"""Factor on the number of people for durations, which vary between people."""
SECONDS = 2.0  # [s], of a clip
RATE = 50.0  # [Hz]
FULL = 1e6  # more than any converter counts
PAPER = "arXiv 2506.18256"

Series = Float[np.ndarray, "reading"]


@dataclass(frozen=True, eq=False)
class Forearm:
    """Holds the robot and the tube of its forearm."""

    world: SimEnvironment
    """Environment of the robot in its skin."""
    index: int
    """Index of the tube among the charts."""

    @property
    def chart(self) -> Chart:
        """Chart of the tube."""
        return self.world.charts[self.index]


def band_checks(constants: Constants, people: int, seed: int) -> list[BandCheck]:
    """Check sizes, durations, spectra and strokes."""
    forearm = build_forearm(constants)
    return [
        *size_checks(forearm, people, seed),
        *length_checks(forearm, people, seed),
        *spectrum_checks(forearm, people, seed),
        stroke_check(forearm, people, seed),
    ]


def build_forearm(constants: Constants) -> Forearm:
    """Build the forearm of the UR5."""
    world = Simulator(constants=constants).env
    charts = [i for i, chart in enumerate(world.charts) if chart.link == FOREARM]
    return Forearm(world, max(charts, key=lambda i: len(world.charts[i].taxels)))


def site_on(forearm: Forearm, rng: np.random.Generator) -> ContactSite:
    """Draw a site on the forearm, 3 cm or more from its ends."""
    chart = forearm.chart
    low, high = np.quantile(chart.unrolled[:, 1], [0, 1])
    around = rng.uniform(0, chart.circumference)
    along = rng.uniform(low + 0.03, high - 0.03)
    return ContactSite(
        chart=forearm.index,
        centre=(float(around), float(along)),
        radius=chart.radius,
        free_run=(float(low - along), float(high - along)),
        angle=float(rng.uniform(-np.pi, np.pi)),
    )


def touches(
    forearm: Forearm,
    gesture: str,
    kind: str | None,
    people: int,
    seed: int,
    regime: Regime | None = None,
    difficulty: float = 0.0,
) -> Iterator[tuple[Person, TrueTouch]]:
    """Yield a gesture by several people, several times each."""
    constants = forearm.world.constants
    for number in range(people):
        rng = np.random.default_rng([seed, number])
        person = draw_person(f"band-{number}", constants, rng)
        for _ in range(REPEATS):
            site = site_on(forearm, rng)
            yield (
                person,
                perform(
                    gesture, kind, person, site, constants, rng, difficulty, regime
                ),
            )


def size_checks(forearm: Forearm, people: int, seed: int) -> list[BandCheck]:
    """Check percentiles of four sizes of each gesture against the prototype's."""
    checks = []
    for gesture, bands in BANDS.items():
        found = np.array(
            [
                sizes(forearm, touch)
                for _, touch in touches(forearm, gesture, None, people, seed)
                if touch.presses and touch.kind not in UNTOUCHED
            ]
        )
        percentiles = np.percentile(found, [10, 50, 90], axis=0)
        checks += [
            band_check(f"{gesture}: {name}", band, percentiles[:, column])
            for column, (name, band) in enumerate(zip(SIZES, bands, strict=True))
        ]
    return checks


def band_check(
    name: str, band: tuple[int, int, int], found: Float[np.ndarray, "3"]
) -> BandCheck:
    """Check that the median lies between the prototype's outer percentiles."""
    return BandCheck(
        f"{name}, 10/50/90 %",
        f"median within {band[0]}-{band[2]} (prototype {'/'.join(map(str, band))})",
        "regression band of the prototype",
        "/".join(f"{number:.3g}" for number in found),
        bool(band[0] <= found[1] <= band[2]),
    )


def sizes(forearm: Forearm, touch: TrueTouch) -> tuple[float, float, float, float]:
    """Return the quantities of `SIZES`."""
    pressure, force = pressed(forearm, touch)
    over = pressure > PRESSED
    return (
        over[force.argmax()].sum(),
        over.any(axis=0).sum(),
        force.max(),
        pressure.max(initial=0.0),
    )


def pressed(
    forearm: Forearm, touch: TrueTouch
) -> tuple[Float[np.ndarray, "time active"], Float[np.ndarray, "time"]]:
    """Return pressure of taxels under an average film [kPa], and force [N]."""
    world = forearm.world
    skin, constants = world.mounted.skin, world.constants
    steps = max(press.first + press.steps for press in touch.presses)
    parts = compute_scene_presses(touch, steps, world.charts, constants)
    force = np.zeros(steps)
    for part in parts:
        force[part.span] += part.field.force
    law = constants.get_constant("film.sigma").spread
    sigma = 1e-3 * (law.low + law.high) / 2 if law else 0.0
    pressure, taxels = sum_pressure(parts, steps, skin.count)
    share = compute_leak_share(sigma, skin.areas)
    return spread_through_film(pressure, taxels, find_grid_neighbours(skin), share)[
        0
    ], force


def length_checks(forearm: Forearm, people: int, seed: int) -> list[BandCheck]:
    """Check the share of touches that are as short as in the paper."""
    step = forearm.world.constants.value("time.step")
    checks, every = [], []
    for gesture, (low, high) in LENGTHS.items():
        lengths = np.array(
            [
                np.ptp(find_contact_steps(touch)) * step
                for _, touch in touches(
                    forearm, gesture, None, MORE * people, seed, "paper"
                )
            ]
        )
        every.append(np.mean(lengths < 2.0))
        share = float(np.mean(lengths < 1.0))
        checks.append(within(f"{gesture}: share under 1 s", share, low, high, PAPER))
    mean = float(np.mean(every))
    return [*checks, at_least("all gestures: share under 2 s", mean, 0.97, PAPER)]


def spectrum_checks(forearm: Forearm, people: int, seed: int) -> list[BandCheck]:
    """Check the spectrum of the largest reading of the skin."""
    checks = []
    for kind in ("resting_hand", "lean"):
        shares = [
            slow_share(series)
            for series, _ in readings(forearm, "none", kind, people, seed)
        ]
        name = f"{kind}: share of power below 2 Hz, mean taken off, median"
        checks.append(at_least(name, float(np.median(shares)), 0.9, "slow by nature"))
    ratios, rates = [], []
    for series, touch in readings(forearm, "double_pat", None, people, seed):
        rate = 1.0 / float(touch.drawn["interval"])
        found = second_peak(series)
        if found is not None:
            ratios.append(found / rate)
            rates.append(found)
    source = "two pulses an interval apart"
    ratio, rate = float(np.median(ratios)), float(np.median(rates))
    name = "double_pat: peak of the spectrum"
    return [
        *checks,
        within(f"{name} by 1 / interval, median", ratio, 0.85, 1.15, source),
        within(f"{name}, median", rate, 2.0, 5.0, source, "Hz"),
    ]


def readings(
    forearm: Forearm, gesture: str, kind: str | None, people: int, seed: int
) -> Iterator[tuple[Series, TrueTouch]]:
    """Yield the largest reading [kPa] of clips that begin within the touch."""
    world = forearm.world
    constants = world.constants
    origin = BuildOrigin("bands", (seed, 63), "fresh")
    build = get_build(origin, world)
    session = get_session(Origin("bands", (seed, 64)), build)
    calibration = build.calibration(world.mounted.skin)
    bend, lead = (
        calibration.pressure_curve,
        round(1.0 / constants.value("time.step")),
    )
    steps = lead + round(SECONDS / constants.value("time.step"))
    q = np.zeros((steps, len(world.mounted.robot.joint_names)))
    rng = np.random.default_rng([seed, 65])
    for _, touch in touches(forearm, gesture, kind, people, seed, "paper"):
        first, last = find_contact_steps(touch)
        late = max(last - first - (steps - lead), 0)
        shown = shift_touch(touch, lead - first - int(rng.integers(0, late + 1)))
        clip = simulate_clip(TouchScene(q, (shown,)), lead, build, session, world, rng)
        quiet = simulate_clip(TouchScene(q, ()), lead, build, session, world, rng)
        rest = np.nan_to_num(compute_rest_counts(quiet), posinf=FULL)
        above = np.where(clip.received, clip.counts - rest, 0.0).max(axis=1)
        gain = float(calibration.gain[0])
        yield np.array([gain * linearise_counts(float(x), bend) for x in above]), touch


def slow_share(series: Series) -> float:
    """Return the share of the power below 2 Hz, without the mean."""
    power = np.abs(np.fft.rfft(series - series.mean())) ** 2
    rates = np.fft.rfftfreq(len(series), 1 / RATE)
    return float(power[rates < 2.0].sum() / power.sum())


def second_peak(series: Series) -> float | None:
    """Return the frequency of the largest peak of the spectrum above 0 Hz [Hz]."""
    power = np.abs(np.fft.rfft(series - np.median(series), 4096))
    rates = np.fft.rfftfreq(4096, 1 / RATE)
    rising = np.flatnonzero(np.diff(power) > 0)
    if not len(rising):
        return None
    start = rising[rates[rising] > 0.5][0]
    return float(rates[start + power[start:].argmax()])


def stroke_check(forearm: Forearm, people: int, seed: int) -> BandCheck:
    """Check the delay between neighbouring taxels against the speed of strokes."""
    step = forearm.world.constants.value("time.step")
    found, lags = [], []
    for _, touch in touches(forearm, "stroke", "one_finger", people, seed):
        press = touch.presses[0]
        if touch.drawn["stroke.path"] == "along" and not touch.drawn["return"]:
            pressure, _ = pressed_raw(forearm, touch)
            found += lag_ratios(forearm.chart, pressure, press.centre[:, 1], step, lags)
    ratio = float(np.median(found))
    low, half, high = 1e3 * np.percentile(lags, [10, 50, 90])
    return BandCheck(
        "stroke: lag of neighbouring taxels by pitch / speed, median",
        "0.8 to 1.25 (8 mm at 14 cm/s: 57 ms)",
        "pitch / speed",
        f"{ratio:.3g}; lags 10/50/90 % {low:.0f}/{half:.0f}/{high:.0f} ms",
        bool(0.8 <= ratio <= 1.25),
    )


def pressed_raw(
    forearm: Forearm, touch: TrueTouch
) -> tuple[Float[np.ndarray, "time taxel"], Float[np.ndarray, "time"]]:
    """Return pressure of the tube's taxels in chart order [kPa], and force [N]."""
    world = forearm.world
    steps = touch.presses[0].steps
    part = compute_scene_presses(touch, steps, world.charts, world.constants)[0]
    pressure = np.zeros((steps, len(forearm.chart.taxels)))
    columns = np.searchsorted(forearm.chart.taxels, part.field.taxels)
    pressure[:, columns] = part.field.pressure
    return pressure, part.field.force


def lag_ratios(
    chart: Chart,
    pressure: Float[np.ndarray, "time taxel"],
    along: Float[np.ndarray, "time"],
    step: float,
    lags: list[float],
) -> list[float]:
    """Return lags over pitch / speed in the most pressed column; append the lags."""
    column = chart.unrolled[pressure.max(axis=0).argmax(), 0]
    same = np.abs(chart.wrap_s(chart.unrolled[:, 0] - column)) < 1e-4
    peak = pressure[:, same].max(axis=0)
    order = np.argsort(chart.unrolled[same, 1])
    when = middles(pressure[:, same])[order]
    where = chart.unrolled[same, 1][order]
    loaded = peak[order] > PRESSED
    speed = np.abs(np.gradient(along, step))
    ratios = []
    for before in range(1, len(when) - 2):
        # The first and last taxels of a stroke are not passed whole.
        if loaded[before - 1 : before + 3].all():
            lag = abs(when[before + 1] - when[before]) * step
            passing = speed[int((when[before + 1] + when[before]) / 2)]
            ratios.append(lag * passing / (where[before + 1] - where[before]))
            lags.append(lag)
    return ratios


def middles(pressure: Float[np.ndarray, "time taxel"]) -> Float[np.ndarray, "taxel"]:
    """Return the middle of the time in which each taxel exceeds half its maximum."""
    over = pressure > 0.5 * pressure.max(axis=0)
    first = over.argmax(axis=0)
    last = len(over) - 1 - over[::-1].argmax(axis=0)
    return (first + last) / 2
