"""A scene is a robot motion with touches; this module computes pressure and truth."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.recording import TruthRecord
from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.press import AnyPress, MoviePress, Press, TrueTouch
from eskin.sim.contact.pressure import (
    PressureField,
    compute_leak_share,
    compute_movie_field,
    compute_pressure_field,
    find_grid_neighbours,
    spread_through_film,
)
from eskin.sim.scene.environment import SimEnvironment
from eskin.skin import MountedSkin, Skin
from eskin.transforms import apply


@dataclass(frozen=True, eq=False)
class TouchScene:
    """A scene is a motion of the robot and the touches on it, step by step."""

    q: Float[np.ndarray, "time joint"]
    """Joint positions [rad]."""
    touches: tuple[TrueTouch, ...]
    """Touches, on the clock of this scene."""

    @property
    def steps(self) -> int:
        """Return the number of steps."""
        return len(self.q)


@dataclass(frozen=True, eq=False)
class ScenePress:
    """A scene press is the part of a press that lies in a scene, with its pressure."""

    press: Press | MoviePress
    """Part of the press that lies in the scene."""
    field: PressureField
    """Pressure on the skin."""

    @property
    def span(self) -> slice:
        """Return the steps of the scene that the press covers."""
        return slice(self.press.first, self.press.first + self.press.steps)


def compute_scene_presses(
    touch: TrueTouch, steps: int, charts: tuple[Chart, ...], constants: Constants
) -> list[ScenePress]:
    """Compute the parts of a touch's presses that lie in a scene of `steps` steps."""
    presses = (crop_press(press, steps) for press in touch.presses)
    return [
        ScenePress(press, compute_field(press, charts[press.chart], constants))
        for press in presses
        if press is not None
    ]


def compute_field(
    press: Press | MoviePress, chart: Chart, constants: Constants
) -> PressureField:
    """Compute the pressure field of a body, or of a recorded movie."""
    if isinstance(press, MoviePress):
        return compute_movie_field(press, chart, constants)
    return compute_pressure_field(press, chart, constants)


def crop_press(press: AnyPress, steps: int) -> AnyPress | None:
    """Return the part of a press that lies in a scene of `steps` steps, if any."""
    low, high = max(0, -press.first), min(press.steps, steps - press.first)
    if high <= low:
        return None
    part = slice(low, high)
    # All series are cut at once, since they have one length.
    series = {
        "force": press.force[part],
        "centre": press.centre[part],
        "angle": press.angle[part],
    }
    if isinstance(press, MoviePress):
        series["pressure"] = press.pressure[part]
    return replace(press, first=press.first + low, **series)


def sum_pressure(
    presses: list[ScenePress], steps: int, count: int
) -> tuple[Float[np.ndarray, "time active"], Int[np.ndarray, "active"]]:
    """Sum the pressure of all presses [kPa]; return it with the taxels, ascending."""
    touched = [press.field.taxels for press in presses]
    taxels = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *touched]))
    column_of = np.zeros(count, dtype=np.int64)
    column_of[taxels] = np.arange(len(taxels))
    pressure = np.zeros((steps, len(taxels)))
    for press in presses:
        pressure[press.span, column_of[press.field.taxels]] += press.field.pressure
    return pressure, taxels


def find_contact_steps(touch: TrueTouch) -> tuple[int, int]:
    """Return the first step with force and the step after the last, on its clock."""
    firsts = []
    ends = []
    for press in touch.presses:
        pressed = np.flatnonzero(press.force > 0)
        if len(pressed):
            firsts.append(press.first + int(pressed[0]))
            ends.append(press.first + int(pressed[-1]) + 1)
    return (min(firsts), max(ends)) if firsts else (0, 0)


def shift_touch(touch: TrueTouch, start: int) -> TrueTouch:
    """Return a touch with its clock started at a step of the scene."""
    presses = tuple(replace(p, first=p.first + start) for p in touch.presses)
    return replace(touch, presses=presses)


def are_apart(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    first: TrueTouch,
    second: TrueTouch,
) -> bool:
    """Tell whether two touches are far enough apart to count as separate."""
    a, b = (compute_press_centres(env, q, touch) for touch in (first, second))
    gaps = np.linalg.norm(a[:, None] - b[None], axis=2)
    return bool(gaps.min(initial=np.inf) >= env.constants.value("clip.apart"))


def compute_press_centres(
    env: SimEnvironment, q: Float[np.ndarray, "joint"], touch: TrueTouch
) -> Float[np.ndarray, "press 3"]:
    """Return the position of each press at half of its duration, in the world [m]."""
    T_world_link = env.poses(q)
    points = []
    for press in touch.presses:
        middle = press.centre[press.steps // 2][None]
        p_link = env.charts[press.chart].surface.wrap(middle).positions[0]
        T = T_world_link[env.links[press.chart]]
        points.append(T[:3, :3] @ p_link + T[:3, 3])
    return np.array(points).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class TrueTouchSeries:
    """A true touch series is the ground truth of one touch at each reading of a clip.

    Values are zero, and the centroid is meaningless, while there is no contact.
    """

    number: int
    """Number of the touch in the clip; 0 is the touch that gives the clip its label."""
    gesture: str
    """Gesture of the vocabulary, `none`, or the name of an unknown gesture."""
    kind: str
    """Variant, such as `two_tips` or `bump`."""
    subject: str
    """Name of the person; empty where no person touched."""
    link: str
    """Link that bears most of the force."""
    force: Float[np.ndarray, "reading"]
    """Total force on the skin [N]."""
    area: Float[np.ndarray, "reading"]
    """Contact area [m2]."""
    centroid: Float[np.ndarray, "reading 3"]
    """Centre of the force in the world [m]."""
    onset: float
    """First contact since the start of the clip; negative if before it [s]."""
    end: float
    """Last contact since the start of the clip; may be after its end [s]."""

    def to_record(self, number: int, reading: int, stamp: int) -> TruthRecord:
        """Return the record of the touch at one reading.

        `number` is that of the touch in the recording or stream, `stamp` the time of
        the reading [ns since the epoch].
        """
        x, y, z = self.centroid[reading].tolist()
        return TruthRecord(
            stamp,
            number,
            self.gesture,
            self.kind,
            self.link,
            float(self.force[reading]),
            float(self.area[reading]),
            (x, y, z),
        )


def find_reading_edges(
    lead: int, readings: int, ratio: float
) -> Int[np.ndarray, "reading_and_one"]:
    """Return the first step of each reading, and the step after the last.

    `lead` steps come before the first reading. A reading has `ratio` steps, perhaps not
    a whole number, or less than one.
    """
    edges = np.floor(ratio * np.arange(readings + 1) + EDGE_ROUNDING)
    return lead + edges.astype(np.int64)


EDGE_ROUNDING = 1e-6
"""Part of a step by which the edge of a reading may be too low, by rounding."""


def average_readings(
    series: Float[np.ndarray, "time *more"], edges: Int[np.ndarray, "reading_and_one"]
) -> Float[np.ndarray, "reading *more"]:
    """Return the means over the steps of readings; of less than a step, its value."""
    if len(edges) < 2:
        return series[:0]
    steps = np.maximum(np.diff(edges), 1)
    sums = np.add.reduceat(series[: edges[-2] + steps[-1]], edges[:-1])
    return sums / steps.reshape(-1, *[1] * (series.ndim - 1))


def compute_scene_pressure(
    touch_presses: list[list[ScenePress]], steps: int, film_sigma: float, skin: Skin
) -> tuple[Float[np.ndarray, "time active"], Int[np.ndarray, "active"]]:
    """Return the pressure spread by the film [kPa], and the taxels it acts on."""
    pressure, taxels = sum_pressure(
        [p for ps in touch_presses for p in ps], steps, skin.count
    )
    beta = compute_leak_share(film_sigma, skin.areas)
    return spread_through_film(pressure, taxels, find_grid_neighbours(skin), beta)


def compute_true_series(
    scene: TouchScene,
    touch_presses: list[list[ScenePress]],
    charts: tuple[Chart, ...],
    mounted: MountedSkin,
    lead: int,
    edges: Int[np.ndarray, "reading_and_one"],
    step: float,
) -> tuple[TrueTouchSeries, ...]:
    """Compute the ground truth of every touch of a scene that has presses.

    Values are means over the steps of a reading, since a bump may last a single step.

    Args:
        scene: scene that is simulated.
        touch_presses: presses of each of its touches.
        charts: charts that the touches are on.
        mounted: skin of these charts on its robot.
        lead: steps of the scene before the clip.
        edges: first step of each reading, and the step after the last.
        step: length of a step [s].
    """
    T_world_link = mounted.kinematics.poses(scene.q)
    found = []
    for number, touch in enumerate(scene.touches):
        if not touch.presses:
            continue
        force = np.zeros(scene.steps)
        area = np.zeros(scene.steps)
        moment = np.zeros((scene.steps, 3))
        force_on: dict[str, float] = {}
        for press in touch_presses[number]:
            chart = charts[press.press.chart]
            field = press.field
            link = chart.link
            total = float(field.force.sum())
            force[press.span] += field.force
            area[press.span] += field.area
            p_link = chart.surface.wrap(field.centroid).positions
            poses = T_world_link[press.span, mounted.robot.link_index(link)]
            moment[press.span] += field.force[:, None] * apply(poses, p_link)
            force_on[link] = force_on.get(link, 0.0) + total
        first, end = find_contact_steps(touch)
        force, area, moment = (
            average_readings(series, edges) for series in (force, area, moment)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            centroid = np.nan_to_num(moment / force[:, None])
        found.append(
            TrueTouchSeries(
                number=number,
                gesture=touch.gesture,
                kind=touch.kind,
                subject=touch.subject,
                link=max(force_on, key=lambda link: force_on[link], default=""),
                force=force,
                area=area,
                centroid=centroid,
                onset=(first - lead) * step,
                end=(end - lead) * step,
            )
        )
    return tuple(found)


def compute_touch_presses(
    scene: TouchScene, env: SimEnvironment
) -> list[list[ScenePress]]:
    """Compute the presses of each touch of a scene."""
    return [
        compute_scene_presses(touch, scene.steps, env.charts, env.constants)
        for touch in scene.touches
    ]
