"""Compare the model of contact with rigid ellipsoids in MuJoCo.

Random people touch a flat surface, both tubes of the arm and a dome. Every clip is
evaluated at its largest force and at other random steps, and counts by its medians.
Targets: area within 25 %, centroids within 4 mm, correlation of the taxels' pressures
above 0.8. Both sides know where the parts lie, so the centroid of one part alone is no
test; it tests how parts share the load on a round surface.
"""

from dataclasses import dataclass

import numpy as np

from eskin.sim import Chart, Constants, Press, load_constants
from eskin.sim.contact.press import ContactSite
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.people.perform import perform
from eskin.sim.people.person import draw_person
from eskin.skin import Dome, Plane, Surface, Tube
from lab.simulation.mujoco_contact import (
    Agreement,
    agreement,
    feel_in_mujoco,
    instant,
)

PITCH = 0.0077  # [m], that of the forearm
SURFACES: dict[str, Surface] = {
    "flat": Plane(np.eye(4)),
    "tube 75 mm": Tube(0.0375, np.eye(4)),
    "tube 101 mm": Tube(0.0505, np.eye(4)),
    "dome 115 mm": Dome(0.0575, np.eye(4)),
}
TOUCHES = (
    *(("poke", None), ("double_pat", None), ("stroke", None), ("grab", None)),
    *(("none", "resting_hand"), ("none", "bump"), ("none", "lean"), ("none", "cable")),
)
BODIES = ("fingertips", "fingers", "hand with palm", "other bodies")
FORCES = (0.0, 1.0, 3.0, 10.0, 30.0, np.inf)  # [N]


INSTANTS = 3
"""Number of steps of a clip that are evaluated."""


@dataclass(frozen=True)
class Case:
    """Holds the comparison at one instant of one clip."""

    surface: str
    touch: str
    body: str
    clip: int
    force: float
    found: Agreement | None
    """Comparison; None if the reference cannot carry the force."""


def reference_tables(repeats: int, seed: int) -> str:
    """Format the comparison by surface, by touch and by force.

    Args:
        repeats: number of clips of every touch on every surface.
        seed: seed of people and touches.
    """
    cases = compare_all(repeats, np.random.default_rng(seed))
    clips = len({case.clip for case in cases})
    sunk = sum(case.found is None for case in cases)
    rows = [
        "\n**The same hands in MuJoCo**\n",
        f"{clips} clips, {len(cases)} instants; {sunk} of them left out, where parts "
        "of the reference sink in altogether.\n",
        *head("surface", "body"),
    ]
    for surface in (*SURFACES, "all"):
        for body in (*BODIES, "all"):
            rows += row(
                (surface, body), [c for c in cases if lies_in(c, surface, body)]
            )
    rows += ["", *head("surface", "touch")]
    for surface in SURFACES:
        for touch in dict.fromkeys(case.touch for case in cases):
            here = [c for c in cases if (c.surface, c.touch) == (surface, touch)]
            rows += row((surface, touch), here)
    rows += ["", *head("force [N]", "body")]
    for low, high in zip(FORCES[:-1], FORCES[1:], strict=True):
        for body in BODIES:
            here = [c for c in cases if c.body == body and low < c.force <= high]
            rows += row((f"{low:g} to {high:g}", body), here)
    return "\n".join(rows)


def lies_in(case: Case, surface: str, body: str) -> bool:
    """Return whether a case belongs to a row, where `all` stands for any."""
    return surface in (case.surface, "all") and body in (case.body, "all")


def compare_all(repeats: int, rng: np.random.Generator) -> list[Case]:
    """Compare all cases."""
    constants = load_constants()
    cases: list[Case] = []
    clip = 0
    for surface in SURFACES:
        chart = even_chart(SURFACES[surface])
        for gesture, kind in TOUCHES:
            if gesture == "grab" and not isinstance(chart.surface, Tube):
                continue
            for _ in range(repeats):
                press = draw_press(gesture, kind, chart, constants, rng)
                touch = gesture if kind is None else kind
                body = "other bodies" if kind in BARE else describe_hand(press)
                for step in draw_steps(press, INSTANTS, rng):
                    at = instant(press, step)
                    found = compare_instant(at, chart, constants)
                    force = float(at.force[0])
                    cases.append(Case(surface, touch, body, clip, force, found))
                clip += 1
    return cases


def compare_instant(
    press: Press, chart: Chart, constants: Constants
) -> Agreement | None:
    """Compare one instant; return None if the reference cannot carry the force."""
    felt = compute_pressure_field(press, chart, constants)
    try:
        return agreement(felt, feel_in_mujoco(press, chart, constants))
    except ValueError:
        return None


BARE = ("bump", "lean", "cable")


def even_chart(surface: Surface) -> Chart:
    """Build a surface full of square taxels, so that only the contact is compared."""
    long = 0.075 if isinstance(surface, Dome) else 0.22
    along_t = np.arange(-long, long, PITCH)
    along_s, width = along_t, PITCH
    if isinstance(surface, Tube):
        whole = 2 * np.pi * surface.radius
        count = round(whole / PITCH)
        width = whole / count
        along_s = (np.arange(count) - count / 2) * width
    places = np.stack(np.meshgrid(along_s, along_t, indexing="ij"), axis=2)
    unrolled = places.reshape(-1, 2)
    cells = np.tile(np.diag([width, PITCH]) / 2, (len(unrolled), 1, 1))
    return Chart("link", surface, np.arange(len(unrolled)), unrolled, cells)


def draw_press(
    gesture: str,
    kind: str | None,
    chart: Chart,
    constants: Constants,
    rng: np.random.Generator,
) -> Press:
    """Draw the first press of a touch by a new person."""
    room = 0.02 if isinstance(chart.surface, Dome) else 0.08
    site = ContactSite(
        chart=0,
        centre=(rng.uniform(-0.01, 0.01), rng.uniform(-0.01, 0.01)),
        radius=chart.radius,
        free_run=(-room, room),
        angle=rng.uniform(-np.pi, np.pi),
    )
    person = draw_person("somebody", constants, rng)
    touch = perform(gesture, kind, person, site, constants, rng, 1.0, "paper")
    return touch.presses[0]


def describe_hand(press: Press) -> str:
    """Return which parts of a hand touch."""
    across, along = press.pads.radii.max(axis=0)
    if across > 0.013:
        return "hand with palm"
    return "fingertips" if along < 0.025 else "fingers"


def draw_steps(press: Press, count: int, rng: np.random.Generator) -> list[int]:
    """Draw the step of the largest force, and others at least a tenth as strong."""
    peak = int(np.argmax(press.force))
    strong = np.flatnonzero(press.force > 0.1 * press.force[peak])
    return [peak, *rng.choice(strong, count - 1).tolist()]


def head(*names: str) -> list[str]:
    """Format the head of a table."""
    columns = (*names, "clips", "area +-25 %", "centroid < 4 mm", "correlation > 0.8")
    columns += (
        "area ratio",
        "centroid [mm]",
        "correlation",
        "correlation, touched taxels only",
    )
    return [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]


def row(names: tuple[str, str], cases: list[Case]) -> list[str]:
    """Format a row, if there are cases: shares within each target, and medians.

    An undefined correlation meets no target, and counts in no median.
    """
    clips: dict[int, list[Agreement]] = {}
    for case in cases:
        if case.found is not None:
            clips.setdefault(case.clip, []).append(case.found)
    if not clips:
        return []
    area, away, alike, strict = np.array([middle(found) for found in clips.values()]).T
    shares = [np.abs(area - 1) <= 0.25, away <= 0.004, alike > 0.8]
    cells = [*names, len(clips), *(f"{share.mean():.0%}" for share in shares)]
    cells += [f"{np.median(area):.2f}", f"{1e3 * np.median(away):.1f}"]
    cells += [f"{np.nanmedian(alike):.2f}", f"{np.nanmedian(strict):.2f}"]
    return [f"| {' | '.join(map(str, cells))} |"]


def middle(found: list[Agreement]) -> list[float]:
    """Return the medians over the instants of a clip."""
    names = ("area", "centroid", "correlation", "strict")
    return [float(np.median([getattr(each, name) for each in found])) for name in names]
