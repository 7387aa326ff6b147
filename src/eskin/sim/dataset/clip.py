"""This module makes one clip or stream from its plan."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.contact.press import TrueTouch
from eskin.sim.dataset.plan import QUIET, BuildOrigin, ClipPlan, Origin
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
from eskin.sim.people.perform import choose_kind
from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.poses import can_touch_itself, compute_pose_group
from eskin.sim.scene.scene import (
    TouchScene,
    TrueTouchSeries,
    compute_scene_pressure,
    compute_touch_presses,
    compute_true_series,
    count_steps_per_reading,
)
from eskin.sim.sensor.build import SensorBuild, draw_build
from eskin.sim.sensor.electrical import ELECTRICAL_EVENTS, add_electrical_event
from eskin.sim.sensor.model import SensorSession, SensorStages, draw_session
from eskin.sim.sensor.sensor import sense


@dataclass(frozen=True, eq=False)
class SimulatedClip:
    """A simulated clip holds what the sensor counted and what was really done."""

    counts: Int[np.ndarray, "reading taxel"]
    """Counts of the converter (int32), one row for each reading of the sensor."""
    received: Bool[np.ndarray, "reading taxel"]
    """False where no fresh data came."""
    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""
    truths: tuple[TrueTouchSeries, ...]
    """True touches, by number; empty where nothing touched."""
    pose_group: int
    """Group of the pose at its start."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for it, by name."""


@lru_cache(maxsize=16)
def get_build(origin: BuildOrigin, env: SimEnvironment) -> SensorBuild:
    """Return the build of an origin, the same one every time."""
    skin, constants = env.mounted.skin, env.constants
    return draw_build(origin.name, origin.kind, skin, constants, origin.rng())


@lru_cache(maxsize=16)
def get_session(origin: Origin, build: SensorBuild) -> SensorSession:
    """Return the session of an origin, the same one every time."""
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

    Args:
        scene: scene, from `lead` steps before the clip on.
        lead: steps before the clip, in which contacts and creep build up.
        build: skin as built.
        session: drift since calibration.
        env: robot in its skin.
        rng: random generator of noise.
        stages: stages of the sensor that work; all unless given.
    """
    skin = env.mounted.skin
    touch_presses = compute_touch_presses(scene, env)
    pressure, taxels = compute_scene_pressure(
        touch_presses, scene.steps, build.film_sigma, skin
    )
    counts, received = sense(pressure, taxels, build, skin, rng, stages, session, lead)
    every = count_steps_per_reading(env)
    truths = compute_true_series(
        scene, touch_presses, env.charts, env.mounted, lead, env
    )
    return SimulatedClip(
        counts=counts,
        received=received,
        q=scene.q[lead::every][: len(counts)],
        truths=truths,
        pose_group=0,
        drawn={},
    )


HOUR = 3600.0
"""Length of an hour [s]."""


def add_event_to_clip(clip: SimulatedClip, setup: ClipSetup) -> SimulatedClip:
    """Return a clip with an electrical event in it."""
    return add_event(clip, setup, "electrical", None)


def add_events_to_stream(clip: SimulatedClip, setup: ClipSetup) -> SimulatedClip:
    """Return a stream with electrical events at random times, so many an hour."""
    constants, rng = setup.env.constants, setup.rng
    rate = constants.value("stream.electrical") / HOUR
    for number in range(rng.poisson(rate * setup.plan.seconds)):
        onset = int(rng.integers(len(clip.counts)))
        clip = add_event(clip, setup, f"electrical{number}", onset)
    return clip


def add_event(
    clip: SimulatedClip, setup: ClipSetup, name: str, onset: int | None
) -> SimulatedClip:
    """Return a clip with one more event.

    Args:
        clip: clip as simulated.
        setup: setup of the clip.
        name: name under which the event is recorded.
        onset: reading at which it begins; None draws it.
    """
    event = ELECTRICAL_EVENTS[setup.rng.integers(len(ELECTRICAL_EVENTS))]
    build = get_build(setup.plan.build, setup.env)
    counts, received, drawn = add_electrical_event(
        event,
        clip.counts,
        clip.received,
        setup.env.mounted.skin,
        build,
        setup.rng,
        setup.env.constants,
        onset,
    )
    more = {f"{name}.{key}": value for key, value in drawn.items()}
    return replace(clip, counts=counts, received=received, drawn=clip.drawn | more)


def make_clip(plan: ClipPlan, env: SimEnvironment) -> SimulatedClip:
    """Make one clip or stream alone, the same one every time.

    Raises:
        ValueError: the plan asks for what the robot or the skin cannot do.
    """
    rng, constants = plan.rng(), env.constants
    person, groups = get_person(plan.person, env), frozenset(plan.groups)
    kind = plan.kind or ""
    if plan.gesture is not None and not kind:
        kind = choose_kind(plan.gesture, None, person, constants, rng, plan.difficulty)
        while kind == "self_contact" and not can_touch_itself(env, groups):
            kind = choose_kind(
                plan.gesture, None, person, constants, rng, plan.difficulty
            )
    setup = set_up_clip(plan, kind, env, rng)
    if plan.gesture is None:
        touches = draw_stream(setup)
    else:
        touches = draw_touches(setup, plan.gesture, kind)
    build = get_build(plan.build, env)
    session = get_session(plan.session, build)
    clip = simulate_clip(
        TouchScene(setup.q, touches), setup.lead, build, session, env, rng
    )
    clip = replace(
        clip,
        pose_group=compute_pose_group(env, setup.q[setup.lead]),
        drawn=collect_drawn(setup, touches),
    )
    if kind == "electrical":
        return add_event_to_clip(clip, setup)
    return add_events_to_stream(clip, setup) if kind == QUIET else clip


def draw_touches(setup: ClipSetup, gesture: str, kind: str) -> tuple[TrueTouch, ...]:
    """Draw the touch that a clip is made for, and perhaps a smaller one beside it."""
    person = get_person(setup.plan.person, setup.env)
    touch = perform_at(setup, person, gesture, kind, setup.lead)
    start = draw_start(touch, setup.steps, setup.env.constants, setup.rng)
    touch = place_touch(setup, touch, setup.lead + start)
    if touch.presses and setup.rng.random() < setup.plan.concurrent:
        return (touch, *draw_second_touch(setup, touch))
    return (touch,)


def collect_drawn(
    setup: ClipSetup, touches: tuple[TrueTouch, ...]
) -> dict[str, float | str]:
    """Collect every parameter of the clip, by name."""
    joints = setup.env.mounted.robot.joint_names
    start = setup.q[setup.lead].tolist()
    drawn: dict[str, float | str] = {
        f"q.{joint}": value for joint, value in zip(joints, start, strict=True)
    }
    drawn["folded"] = float(setup.folded)
    for number, touch in enumerate(touches):
        drawn[f"touch{number}.kind"] = touch.kind
        drawn |= {f"touch{number}.{name}": each for name, each in touch.drawn.items()}
    return drawn
