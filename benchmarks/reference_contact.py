"""How near the model of contact comes to rigid ellipsoids in MuJoCo.

    python -m benchmarks.reference_contact

People that are drawn touch a flat, both tubes of the arm and a dome; every clip is
looked at when its force is largest and at other steps drawn, and counts by its medians.
Wanted: area within 25 %, centroids within 4 mm, pressures of the taxels correlated over
0.8. Both sides are told where the parts lie, so the centroid of one part alone says
nothing; it is a check of how many parts share the load on a round surface.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tyro

from eskin.sim import Chart, Constants, Press, load_constants
from eskin.sim.contact import feel
from eskin.sim.person import draw_person
from eskin.sim.programs import perform
from eskin.sim.reference import Agreement, agreement, feel_in_mujoco, instant
from eskin.sim.site import Site
from eskin.skin.round import Dome, Tube
from eskin.skin.surface import Plane, Surface

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


@dataclass(frozen=True)
class Command:
    """Compare."""

    repeats: int = 8
    """Clips of every touch on every surface."""
    instants: int = 3
    """Steps of a clip that are looked at."""
    seed: int = 0


@dataclass(frozen=True)
class Case:
    """One instant of one clip."""

    surface: str
    touch: str
    body: str
    clip: int
    force: float
    found: Agreement | None
    """None where the reference cannot carry the force."""


def main() -> None:
    """Compare and print."""
    command = tyro.cli(Command)
    began, rng = time.perf_counter(), np.random.default_rng(command.seed)
    cases = compare(command, rng)
    clips = len({case.clip for case in cases})
    seconds = time.perf_counter() - began
    print(f"{clips} clips, {len(cases)} instants, {seconds:.0f} s")
    sunk = [case for case in cases if case.found is None]
    print(f"{len(sunk)} instants left out: the reference's parts sink in altogether\n")
    head("surface", "body")
    for surface in (*SURFACES, "all"):
        for body in (*BODIES, "all"):
            row((surface, body), cases, lambda c, s=surface, b=body: lies_in(c, s, b))
    print()
    head("surface", "touch")
    for surface in SURFACES:
        for touch in dict.fromkeys(case.touch for case in cases):
            row(
                (surface, touch),
                cases,
                lambda c, s=surface, w=touch: (c.surface, c.touch) == (s, w),
            )
    print()
    head("force [N]", "body")
    for low, high in zip(FORCES[:-1], FORCES[1:], strict=True):
        for body in BODIES:
            row(
                (f"{low:g} to {high:g}", body),
                cases,
                lambda c, b=body, f=(low, high): c.body == b and f[0] < c.force <= f[1],
            )


def lies_in(case: Case, surface: str, body: str) -> bool:
    """Whether a case belongs to a row, `all` standing for any."""
    return surface in (case.surface, "all") and body in (case.body, "all")


def compare(command: Command, rng: np.random.Generator) -> list[Case]:
    """All cases."""
    constants = load_constants()
    cases: list[Case] = []
    clip = 0
    for surface in SURFACES:
        chart = even_chart(SURFACES[surface])
        for gesture, kind in TOUCHES:
            if gesture == "grab" and not isinstance(chart.surface, Tube):
                continue
            for _ in range(command.repeats):
                press = draw_press(gesture, kind, chart, constants, rng)
                touch = gesture if kind is None else kind
                body = "other bodies" if kind in BARE else body_of(press)
                for step in steps_of(press, command.instants, rng):
                    at = instant(press, step)
                    found = look(at, chart, constants)
                    force = float(at.force[0])
                    cases.append(Case(surface, touch, body, clip, force, found))
                clip += 1
    return cases


def look(press: Press, chart: Chart, constants: Constants) -> Agreement | None:
    """Compare one instant; None where the reference cannot carry the force."""
    felt = feel(press, chart, constants)
    try:
        return agreement(felt, feel_in_mujoco(press, chart, constants))
    except ValueError:
        return None


BARE = ("bump", "lean", "cable")


def even_chart(surface: Surface) -> Chart:
    """A surface full of square taxels, so that the contact alone is compared."""
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
    """The first press of a touch by somebody new."""
    room = 0.02 if isinstance(chart.surface, Dome) else 0.08
    site = Site(
        chart=0,
        centre=(rng.uniform(-0.01, 0.01), rng.uniform(-0.01, 0.01)),
        radius=chart.radius,
        clear=(-room, room),
        angle=rng.uniform(-np.pi, np.pi),
    )
    person = draw_person("somebody", constants, rng)
    touch = perform(gesture, kind, person, site, constants, rng, 1.0, "paper")
    return touch.presses[0]


def body_of(press: Press) -> str:
    """Which parts of a hand touch."""
    across, along = press.stamps.radii.max(axis=0)
    if across > 0.013:
        return "hand with palm"
    return "fingertips" if along < 0.025 else "fingers"


def steps_of(press: Press, count: int, rng: np.random.Generator) -> list[int]:
    """The step of the largest force, and others at least a tenth as strong."""
    peak = int(np.argmax(press.force))
    strong = np.flatnonzero(press.force > 0.1 * press.force[peak])
    return [peak, *rng.choice(strong, count - 1).tolist()]


def head(*names: str) -> None:
    """The first lines of a table."""
    columns = (*names, "clips", "area +-25 %", "centroid < 4 mm", "correlation > 0.8")
    columns += ("area ratio", "centroid [mm]", "correlation", "of touched taxels only")
    print(f"| {' | '.join(columns)} |")
    print(f"|{'---|' * len(columns)}")


def row(
    names: tuple[str, str], cases: list[Case], belongs: Callable[[Case], bool]
) -> None:
    """One line: shares of clips within each bar, and medians over clips."""
    clips: dict[int, list[Agreement]] = {}
    for case in cases:
        if belongs(case) and case.found is not None:
            clips.setdefault(case.clip, []).append(case.found)
    if not clips:
        return
    area, away, alike, strict = np.array([middle(found) for found in clips.values()]).T
    shares = [np.abs(area - 1) <= 0.25, away <= 0.004, alike > 0.8]
    cells = [*names, len(clips), *(f"{share.mean():.0%}" for share in shares)]
    cells += [f"{np.median(area):.2f}", f"{1e3 * np.median(away):.1f}"]
    cells += [f"{np.median(alike):.2f}", f"{np.median(strict):.2f}"]
    print(f"| {' | '.join(map(str, cells))} |")


def middle(found: list[Agreement]) -> list[float]:
    """Medians over the instants of a clip."""
    names = ("area", "centroid", "correlation", "strict")
    return [float(np.median([getattr(each, name) for each in found])) for name in names]


if __name__ == "__main__":
    main()
