"""Check gestures on a virtual copy of the grid of the CoST data set.

Jung, Poel, Poppe and Heylen 2017 recorded 31 people on 8 x 8 cells of 20 mm round a
mannequin's forearm. Force laws differ between that felt grid and ours, so only areas,
durations and ratios are compared. Blur and exponent of the read-out were fitted to four
means; the spreads and the other ratios are the test. Areas and peaks are those of the
blurred and compressed reading, as in the tables of CoST; the uncompressed ratio of
pressures stands beside it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.press import ContactSite
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.people.perform import perform
from eskin.sim.people.person import draw_person
from eskin.skin import Tube
from lab.simulation.check import BandCheck, ordered, within

CELLS = 8
PITCH = 0.02  # [m]
RADIUS = 0.045  # [m], of the mannequin's forearm
BLUR = 0.01  # [m], by the felt
EXPONENT = 0.35  # of the read-out
FINER = 4  # steps a cell on which the felt spreads
SOURCE = "Jung et al. 2017"

COST = {
    "poke": (0.650, 0.502, 0.08, 0.08),
    "tap": (0.564, 0.486, 0.12, 0.07),
    "pat": (0.709, 0.753, 0.15, 0.07),
    "press": (1.181, 0.608, 0.23, 0.16),
    "stroke": (1.722, 0.829, 0.20, 0.08),
    "grab": (1.373, 0.715, 0.59, 0.17),
}
"""Duration mean and SD [s], area fraction mean and SD (Tables 3 to 5)."""

GESTURES = {
    "poke": ("poke", None),
    "tap": ("none", "single_pat"),
    "pat": ("double_pat", None),
    "press": ("none", "press"),
    "stroke": ("stroke", None),
    "grab": ("grab", None),
}
"""Class and kind in our vocabulary."""


@dataclass(frozen=True)
class Captures:
    """Holds many captures of one gesture."""

    seconds: Float[np.ndarray, "capture"]
    """Duration of each capture [s]."""
    area: Float[np.ndarray, "capture"]
    """Share of cells above half of the maximum, when the sum is largest."""
    peak: Float[np.ndarray, "capture"]
    """Largest pressure on a cell, as the felt passes it on [kPa]."""


def rig_checks(
    constants: Constants, people: int, repeats: int, difficulty: float, seed: int
) -> list[BandCheck]:
    """Check areas, durations and ratios of six gestures against those of CoST."""
    found = {
        name: captures(name, constants, people, repeats, difficulty, seed)
        for name in COST
    }
    checks = []
    for name, captured in found.items():
        _, _, area, area_sd = COST[name]
        checks += [
            within(f"{name}: area, mean", captured.area.mean(), *near(area), SOURCE),
            within(
                f"{name}: area, SD", captured.area.std(), 0.5 * area_sd, 2 * area_sd,
                SOURCE,
            ),
        ]  # fmt: skip
    means = {name: float(captured.area.mean()) for name, captured in found.items()}
    plain = {name: float(np.median(captured.peak)) for name, captured in found.items()}
    peaks = {name: peak**EXPONENT for name, peak in plain.items()}
    times = {name: float(captured.seconds.mean()) for name, captured in found.items()}
    lengths = ("tap", "poke", "press", "grab", "stroke")
    return [
        *checks,
        within("grab / pat area", means["grab"] / means["pat"], 3, 5, SOURCE),
        within("pat / poke area", means["pat"] / means["poke"], 1.5, 3, SOURCE),
        *(
            ordered("peak reading", {n: peaks[n] for n in names}, SOURCE, "kPa^0.35")
            for names in (("stroke", "poke", "grab"), ("pat", "poke", "grab"))
        ),
        stroke_by_pat(peaks, plain),
        ordered("duration", {n: times[n] for n in lengths}, SOURCE, "s"),
        within("poke / pat duration", times["poke"] / times["pat"], 0.7, 1.4, SOURCE),
    ]


def stroke_by_pat(peaks: dict[str, float], plain: dict[str, float]) -> BandCheck:
    """Check the ratio of the peaks of strokes and pats, which are equal in CoST."""
    ratio, pressed = (each["stroke"] / each["pat"] for each in (peaks, plain))
    return BandCheck(
        "stroke / pat, peak reading",
        "0.7 to 1.4",
        SOURCE,
        f"{ratio:.3g} (of pressures before the read-out {pressed:.3g})",
        bool(0.7 <= ratio <= 1.4),
    )


def near(mean: float) -> tuple[float, float]:
    """Return the range of a third about a mean, which held for the prototype."""
    return 0.67 * mean, 1.33 * mean


def captures(
    name: str,
    constants: Constants,
    people: int,
    repeats: int,
    difficulty: float,
    seed: int,
) -> Captures:
    """Simulate several people who make one gesture several times on the rig."""
    gesture, kind = GESTURES[name]
    chart = rig_chart()
    rows = []
    for number in range(people):
        rng = np.random.default_rng([seed, number])
        person = draw_person(f"rig-{number}", constants, rng)
        for _ in range(repeats):
            touch = perform(
                gesture, kind, person, rig_site(rng), constants, rng, difficulty, "cost"
            )
            images = sum_pressure(chart, touch.presses, constants)
            rows.append(measure(images, constants.value("time.step")))
    return Captures(*np.array(rows).T)


def rig_chart() -> Chart:
    """Build the grid of CoST round its forearm, finer than its cells."""
    count = CELLS * FINER
    pitch = PITCH / FINER
    offsets = (np.arange(count) - (count - 1) / 2) * pitch
    unrolled = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    cells = np.tile(np.eye(2) * pitch / 2, (len(unrolled), 1, 1))
    surface = Tube(RADIUS, np.eye(4))
    return Chart("forearm", surface, np.arange(len(unrolled)), unrolled, cells)


def rig_site(rng: np.random.Generator) -> ContactSite:
    """Draw a site near the middle of the grid."""
    s, t = rng.uniform(-1.5 * PITCH, 1.5 * PITCH, 2)
    return ContactSite(
        chart=0,
        centre=(float(s), float(t)),
        radius=RADIUS,
        free_run=(-2.5 * PITCH, 2.5 * PITCH),
        angle=0.0,
    )


def sum_pressure(
    chart: Chart, presses: tuple, constants: Constants
) -> Float[np.ndarray, "time row column"]:
    """Return the pressure on every cell under the felt [kPa]."""
    length = max(press.first + press.steps for press in presses)
    fine = np.zeros((length, len(chart.taxels)))
    for press in presses:
        felt = compute_pressure_field(press, chart, constants)
        fine[press.first : press.first + press.steps, felt.taxels] += felt.pressure
    side = CELLS * FINER
    sigma = BLUR / PITCH * FINER
    spread = gaussian_filter(
        fine.reshape(length, side, side), (0, sigma, sigma), mode="constant"
    )
    return spread.reshape(length, CELLS, FINER, CELLS, FINER).mean(axis=(2, 4))


def measure(
    images: Float[np.ndarray, "time row column"], step: float
) -> tuple[float, float, float]:
    """Return duration [s], area share and peak of one capture."""
    read = np.maximum(images, 0.0) ** EXPONENT
    touched = np.flatnonzero(images.sum(axis=(1, 2)) > 0)
    seconds = (touched[-1] - touched[0] + 1) * step if len(touched) else 0.0
    fullest = read[read.sum(axis=(1, 2)).argmax()]
    area = float(np.mean(fullest > 0.5 * fullest.max())) if fullest.max() > 0 else 0.0
    return seconds, area, float(images.max())
