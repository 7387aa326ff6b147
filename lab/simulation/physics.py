"""Check areas, pressures, forces and times of contact."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from eskin.robot import load_robot
from eskin.sim.constants import MM, Constants
from eskin.sim.contact.chart import Chart, build_charts
from eskin.sim.contact.press import ContactPads, ContactSite, Press, SoftTissue
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.people.perform import perform
from eskin.sim.people.person import Person, build_hand, draw_person, select_pads
from eskin.skin import SKIN_PRESETS, MountedSkin, Plane, Surface
from lab.simulation.check import BandCheck, within

FINGERTIP = {0.5: 67.0, 1.0: 90.0, 2.0: 120.0, 5.0: 177.0}
"""Area [mm2] on a flat by force [N]."""
BALANCE = {"one_tip": 4.0, "fingers": 30.0, "flat_hand": 60.0}
"""Force [N] on parts of a hand that lie inside a patch."""
FOREARM = "forearm_link"
WANDER = {
    "poke": ("poke", None, 0.24, 0.6),
    "long finger touch": ("none", "press", 0.24, 1.76),
    "resting hand": ("none", "resting_hand", 0.16, 1.2),
}
"""Gesture, kind, median displacement of the centre in 83 ms, and its range [mm], while
the force exceeds 60 % of its peak: two people of SocialTouch, taxels of 4 mm."""
SAMPLED = 0.083
"""Time between two readings of SocialTouch [s]."""


def physics_checks(constants: Constants, people: int, seed: int) -> list[BandCheck]:
    """Check one average fingertip, then people."""
    return [
        *fingertip_checks(constants),
        *people_checks(constants, people, seed),
        *time_checks(constants, people, seed),
        *wander_checks(constants, people, seed),
    ]


def fingertip_checks(constants: Constants) -> list[BandCheck]:
    """Check the area, its growth, and the peak pressure of the average fingertip."""
    forces = np.array(list(FINGERTIP))
    areas = tip_areas(constants, forces)
    checks = [
        within(
            f"fingertip: area at {force:g} N, flat", area, 0.75 * wanted, 1.25 * wanted,
            "recalled from the literature", "mm2",
        )
        for (force, wanted), area in zip(FINGERTIP.items(), areas, strict=True)
    ]  # fmt: skip
    slopes = np.diff(np.log(areas)) / np.diff(np.log(forces))
    source = "Xydas and Kao 1999: at most 2/3"
    name = "fingertip: slope of ln area over ln force"
    return [
        *checks,
        within(f"{name}, least", slopes.min(), 0.25, 0.6, source),
        within(f"{name}, most", slopes.max(), 0.25, 0.6, source),
        within(
            "fingertip: peak by mean pressure, 2 N", peakedness(constants), 1.7, 2.3,
            "Pawluk and Howe 1999",
        ),
    ]  # fmt: skip


def tip_areas(
    constants: Constants, forces: Float[np.ndarray, "time"]
) -> Float[np.ndarray, "time"]:
    """Return the contact area of the average fingertip on a flat surface [mm2]."""
    tip, flesh = average_tip(constants)
    felt = compute_pressure_field(
        held(tip, flesh, forces), fine_chart(Plane(np.eye(4))), constants
    )
    return felt.area / MM**2


def peakedness(constants: Constants) -> float:
    """Return the ratio of peak to mean pressure under the average fingertip at 2 N."""
    tip, flesh = average_tip(constants)
    felt = compute_pressure_field(
        held(tip, flesh, [2.0]), fine_chart(Plane(np.eye(4))), constants
    )
    pressed = felt.pressure[0][felt.pressure[0] > constants.value("contact.touched")]
    return float(pressed.max() / pressed.mean())


def average_tip(constants: Constants) -> tuple[ContactPads, SoftTissue]:
    """Return the index fingertip of the average hand, and its tissue."""
    thumb, breadth, palm, length = (
        constants.value(f"hand.{name}") * MM
        for name in ("thumb", "breadth", "palm_length", "length")
    )
    fingers = constants.array("hand.fingers") * MM
    hand = build_hand(fingers, thumb, breadth, palm, length, constants)
    flesh = SoftTissue(
        b=middle("person.stiffness", constants) / MM,
        m=middle("person.stiffness_growth", constants) / MM,
        area_scale=middle("person.area", constants),
        area_exponent=middle("person.area_exponent", constants),
        conformity=1.0,
    )
    return select_pads(hand, ("index_tip",)), flesh


def middle(name: str, constants: Constants) -> float:
    """Return the median of a constant that is drawn."""
    law = constants.get_constant(name).spread
    return float((law.median or law.mean or 0.0) if law else 0.0)


def held(
    stamps: ContactPads,
    flesh: SoftTissue,
    forces: Iterable[float],
    centre: tuple[float, float] = (0.0, 0.0),
    angle: float = 0.0,
) -> Press:
    """Build a press of a body at rest with one force after the other [N]."""
    force = np.array(list(forces))
    still = np.tile(np.array(centre), (len(force), 1))
    return Press(0, 0, force, still, np.full(len(force), angle), stamps, flesh)


def fine_chart(surface: Surface, pitch: float = 0.0005, half: float = 0.015) -> Chart:
    """Build a small square of a surface with very fine taxels [m]."""
    line = np.arange(-half, half, pitch) + pitch / 2
    unrolled = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    cells = np.tile(np.eye(2) * pitch / 2, (len(unrolled), 1, 1))
    return Chart("flat", surface, np.arange(len(unrolled)), unrolled, cells)


def ur5() -> tuple[MountedSkin, Chart]:
    """Build the skin on the UR5, and the tube of its forearm."""
    preset = SKIN_PRESETS["ur5"]
    mounted = MountedSkin(preset.build(), load_robot(preset.robot))
    charts = [chart for chart in build_charts(mounted) if chart.link == FOREARM]
    return mounted, max(charts, key=lambda chart: len(chart.taxels))


def people_checks(constants: Constants, people: int, seed: int) -> list[BandCheck]:
    """Check the force that taxels measure, and the true area of a firm grab."""
    mounted, chart = ur5()
    rng = np.random.default_rng([seed, 61])
    drawn = [draw_person(f"physics-{n}", constants, rng) for n in range(people)]
    checks = []
    for group, force in BALANCE.items():
        ratios = [
            balance(each, group, force, mounted, chart, constants, rng)
            for each in drawn
        ]
        low, half, high = np.percentile(ratios, [10, 50, 90])
        checks.append(
            BandCheck(
                f"force felt by force given, {group} at {force:g} N inside a patch",
                "10th, 50th and 90th percentile within 0.95 to 1.05",
                "design",
                f"{low:.3f}, {half:.3f}, {high:.3f}",
                bool(low >= 0.95 and high <= 1.05),
            )
        )
    areas = [grab_area(each, chart, constants, rng) for each in drawn]
    source = "palm fitted to Jung et al. 2017"
    name = "full-hand grab of 60 N on 75 mm: true area over 1 kPa, median"
    return [*checks, within(name, float(np.median(areas)), 60, 90, source, "cm2")]


def balance(
    person: Person,
    group: str,
    force: float,
    mounted: MountedSkin,
    chart: Chart,
    constants: Constants,
    rng: np.random.Generator,
) -> float:
    """Return the ratio of measured to applied force amid the largest patch."""
    patch = np.bincount(mounted.skin.patch_index[chart.taxels]).argmax()
    inside = chart.unrolled[mounted.skin.patch_index[chart.taxels] == patch]
    places = inside[0] + np.column_stack(
        [chart.wrap_s(inside[:, 0] - inside[0, 0]), inside[:, 1] - inside[0, 1]]
    )
    centre = places.mean(axis=0) + rng.uniform(-0.004, 0.004, 2)
    press = held(
        person.select_pads(group), person.tissue, [force], (centre[0], centre[1]), 0.0
    )
    felt = compute_pressure_field(press, chart, constants)
    return float(felt.pressure[0] @ mounted.skin.areas[felt.taxels] * 1e3 / force)


def grab_area(
    person: Person, chart: Chart, constants: Constants, rng: np.random.Generator
) -> float:
    """Return the true contact area of a full-hand grab of 60 N [cm2]."""
    flesh = SoftTissue(
        **vars(person.tissue) | {"conformity": constants.draw("grab.conformity", rng)}
    )
    stamps = person.select_pads("full_hand", constants.draw("grab.splay", rng))
    middle_of = chart.unrolled.mean(axis=0)
    centre = (float(middle_of[0]), float(middle_of[1]))
    press = held(stamps, flesh, [60.0], centre, np.pi / 2)
    return float(compute_pressure_field(press, chart, constants).area[0] * 1e4)


def time_checks(constants: Constants, people: int, seed: int) -> list[BandCheck]:
    """Check the time of contact of bumps and pats."""
    rng = np.random.default_rng([seed, 62])
    site = ContactSite(0, (0.0, 0.0), 0.0375, (-0.1, 0.1), 0.0)
    bumps = []
    pats = []
    for number in range(people):
        person = draw_person(f"times-{number}", constants, rng)
        for gesture, kind, name, found in (
            ("none", "bump", "duration", bumps),
            ("double_pat", None, "contact", pats),
        ):
            touch = perform(gesture, kind, person, site, constants, rng, 0.0, "paper")
            found.append(1e3 * float(touch.drawn[name]))
    return [
        times("bump: time of contact", bumps, 15, 60, "mass on a spring"),
        times("pat: time of contact", pats, 80, 200, "touchscreen taps, 133 (83) ms"),
    ]


def wander_checks(constants: Constants, people: int, seed: int) -> list[BandCheck]:
    """Check how far the centre of a touch moves while the hand stays in place."""
    rng = np.random.default_rng([seed, 63])
    site = ContactSite(0, (0.0, 0.0), 0.0375, (-0.1, 0.1), 0.0)
    every = round(SAMPLED / constants.value("time.step"))
    checks = []
    for name, (gesture, kind, way, span) in WANDER.items():
        ways = []
        spans = []
        for number in range(people):
            person = draw_person(f"wander-{number}", constants, rng)
            touch = perform(gesture, kind, person, site, constants, rng, 1.5, None)
            press = touch.presses[0]
            centre = press.centre[press.force > 0.6 * press.force.max()] / MM
            if len(centre) > every:
                moved = np.linalg.norm(centre[every:] - centre[:-every], axis=1)
                ways.append(float(np.median(moved)))
                spans.append(float(np.linalg.norm(np.ptp(centre, axis=0))))
        for what, found, wanted in (
            ("way in 83 ms", ways, way),
            ("range", spans, span),
        ):
            label = f"{name}: {what}, median"
            median = float(np.median(found))
            limits = 0.5 * wanted, 1.5 * wanted
            checks.append(within(label, median, *limits, "SocialTouch", "mm"))
    return checks


def times(
    name: str, found: list[float], low: float, high: float, source: str
) -> BandCheck:
    """Check the median of some times, and report their spread [ms]."""
    least, half, most = np.percentile(found, [10, 50, 90])
    return BandCheck(
        f"{name}, 10/50/90 %",
        f"median {low:g} to {high:g} ms",
        source,
        f"{least:.0f}/{half:.0f}/{most:.0f} ms",
        bool(low <= half <= high),
    )
