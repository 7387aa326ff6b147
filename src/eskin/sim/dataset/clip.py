"""This module simulates one clip or stream from its plan."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.recording import NONE
from eskin.sim.contact.press import TrueTouch
from eskin.sim.dataset.plan import BuildOrigin, ClipPlan, Origin
from eskin.sim.dataset.sets import QUIET
from eskin.sim.dataset.staging import (
    ClipSetup,
    draw_second_touch,
    draw_start,
    draw_stream,
    get_person,
    perform_at,
    place_touch,
    set_up_clip,
)
from eskin.sim.people.perform import STANDING_KINDS, choose_kind
from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.poses import can_touch_itself, compute_pose_group
from eskin.sim.scene.scene import (
    TouchScene,
    TrueTouchSeries,
    compute_scene_pressure,
    compute_touch_presses,
    compute_true_series,
    find_reading_edges,
)
from eskin.sim.sensor.build import SensorBuild, draw_build
from eskin.sim.sensor.faults import ELECTRICAL_EVENTS, add_electrical_event
from eskin.sim.sensor.model import SensorSession, SensorStages, draw_session
from eskin.sim.sensor.sensor import draw_reading_times, sense


@dataclass(frozen=True, eq=False)
class SimulatedClip:
    """A simulated clip holds the counts of the sensor and the ground truth."""

    counts: Int[np.ndarray, "reading taxel"]
    """Counts of the converter (int32)."""
    received: Bool[np.ndarray, "reading taxel"]
    """False where no new data was received."""
    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""
    truths: tuple[TrueTouchSeries, ...]
    """True touches, by number."""
    pose_group: int
    """Group of the pose at the start of the clip."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for the clip, by name."""
    times: Float[np.ndarray, "reading"] | None = None
    """Time of each reading since the start of the clip [s]; None where readings are
    `sensor.period` apart."""


@lru_cache(maxsize=16)
def get_build(origin: BuildOrigin, env: SimEnvironment) -> SensorBuild:
    """Return the sensor build of an origin, cached."""
    skin = env.mounted.skin
    constants = env.constants
    return draw_build(origin.name, origin.kind, skin, constants, origin.rng())


@lru_cache(maxsize=16)
def get_session(origin: Origin, build: SensorBuild) -> SensorSession:
    """Return the sensor session of an origin, cached."""
    return draw_session(build, origin.rng())


def simulate_clip(
    scene: TouchScene,
    lead: int,
    build: SensorBuild,
    session: SensorSession,
    env: SimEnvironment,
    rng: np.random.Generator,
    stages: SensorStages | None = None,
) -> SimulatedClip:
    """Simulate the counts of a scene, and its ground truth.

    The scene begins `lead` steps before the clip, in which contacts and creep build up.
    All stages of the sensor are simulated unless given.
    """
    skin = env.mounted.skin
    touch_presses = compute_touch_presses(scene, env)
    pressure, taxels = compute_scene_pressure(
        touch_presses, scene.steps, build.film_sigma, skin
    )
    counts, received = sense(pressure, taxels, build, skin, rng, stages, session, lead)
    ratio = build.electronics.period / build.electronics.step
    edges = find_reading_edges(lead, len(counts), ratio)
    truths = compute_true_series(
        scene,
        touch_presses,
        env.charts,
        env.mounted,
        lead,
        edges,
        build.electronics.step,
    )
    q = scene.q[edges[:-1]]
    times = draw_reading_times(build, len(counts), rng) if build.flaws else None
    return SimulatedClip(counts, received, q, truths, 0, {}, times)


SECONDS_PER_HOUR = 3600.0


def add_events_to_stream(clip: SimulatedClip, setup: ClipSetup) -> SimulatedClip:
    """Return a stream with electrical events at random times, at a constant rate."""
    constants = setup.env.constants
    rng = setup.rng
    rate = constants.value("stream.electrical") / SECONDS_PER_HOUR
    for number in range(rng.poisson(rate * setup.plan.seconds)):
        onset = int(rng.integers(len(clip.counts)))
        clip = add_event(clip, setup, f"electrical{number}", onset)
    return clip


def add_event(
    clip: SimulatedClip, setup: ClipSetup, name: str, onset: int | None
) -> SimulatedClip:
    """Return a clip with an electrical event that begins at a reading, or anywhere."""
    event = ELECTRICAL_EVENTS[setup.rng.integers(len(ELECTRICAL_EVENTS))]
    build = get_build(setup.plan.build, setup.env)
    counts, received, drawn = add_electrical_event(
        event,
        clip.counts,
        clip.received,
        setup.env.mounted.skin,
        build.electronics,
        setup.rng,
        setup.env.constants,
        onset,
    )
    more = {f"{name}.{key}": value for key, value in drawn.items()}
    return replace(clip, counts=counts, received=received, drawn=clip.drawn | more)


def make_clip(plan: ClipPlan, env: SimEnvironment) -> SimulatedClip:
    """Simulate the clip or stream of a plan, the same one every time.

    Raises:
        ValueError: the plan needs what the robot or the skin cannot do.
    """
    rng = plan.rng()
    kind = plan.kind or ""
    if plan.gesture is not None and not kind:
        kind = draw_clip_kind(plan, plan.gesture, env, rng)
    setup = set_up_clip(plan, kind, env, rng)
    if plan.gesture is None:
        touches = draw_stream(setup)
    else:
        touches = draw_touches(setup, plan.gesture, kind)
    clip = simulate_touches(setup, touches)
    if kind == "electrical":
        return add_event(clip, setup, "electrical", None)
    return add_events_to_stream(clip, setup) if kind == QUIET else clip


def simulate_touches(setup: ClipSetup, touches: tuple[TrueTouch, ...]) -> SimulatedClip:
    """Simulate touches on the robot of a clip, with the sensor of its plan."""
    plan = setup.plan
    env = setup.env
    build = get_build(plan.build, env)
    session = get_session(plan.session, build)
    scene = TouchScene(setup.q, touches)
    clip = simulate_clip(scene, setup.lead, build, session, env, setup.rng)
    start = setup.q[setup.lead]
    drawn = collect_joint_values(env, start) | {"folded": float(setup.folded)}
    return replace(
        clip,
        pose_group=compute_pose_group(env, start),
        drawn=drawn | collect_touch_values(touches),
    )


def draw_clip_kind(
    plan: ClipPlan, gesture: str, env: SimEnvironment, rng: np.random.Generator
) -> str:
    """Draw a variant of the gesture of a clip that its pose groups permit.

    A robot that moves slides past what stands more often than `none.kinds` says.
    """
    constants = env.constants
    if gesture == NONE and plan.moving and env.can_move:
        if rng.random() < constants.value("none.standing.share"):
            return str(rng.choice(STANDING_KINDS))
    person = get_person(plan.person, env)
    groups = frozenset(plan.groups)
    while True:
        kind = choose_kind(gesture, None, person, constants, rng, plan.difficulty)
        if kind != "self_contact" or can_touch_itself(env, groups):
            return kind


def draw_touches(setup: ClipSetup, gesture: str, kind: str) -> tuple[TrueTouch, ...]:
    """Draw the main touch of a clip, and perhaps a smaller one at the same time."""
    person = get_person(setup.plan.person, setup.env)
    touch = perform_at(setup, person, gesture, kind, setup.lead)
    start = draw_start(touch, setup.steps, setup.env.constants, setup.rng)
    touch = place_touch(setup, touch, setup.lead + start)
    if touch.presses and setup.rng.random() < setup.plan.concurrent:
        return (touch, *draw_second_touch(setup, touch))
    return (touch,)


def collect_joint_values(
    env: SimEnvironment, q: Float[np.ndarray, "joint"]
) -> dict[str, float | str]:
    """Return joint positions by name, such as `q.elbow_joint` [rad]."""
    joints = env.mounted.robot.joint_names
    return {f"q.{name}": value for name, value in zip(joints, q.tolist(), strict=True)}


def collect_touch_values(touches: Iterable[TrueTouch]) -> dict[str, float | str]:
    """Return the kinds and drawn parameters of touches, such as `touch0.kind`."""
    drawn: dict[str, float | str] = {}
    for number, touch in enumerate(touches):
        drawn[f"touch{number}.kind"] = touch.kind
        drawn |= {f"touch{number}.{name}": each for name, each in touch.drawn.items()}
    return drawn
