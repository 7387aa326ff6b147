"""This module draws what happens in a clip or stream: pose, motion and touches.

A stream is one touch after the other, with pauses, sometimes two at once. Its kind is
`ACCIDENTS` for accidental contacts only, `QUIET` for no contact, or None for gestures.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from eskin.recording import NONE
from eskin.sim.constants import Constants
from eskin.sim.contact.press import ContactSite, TrueTouch
from eskin.sim.dataset.plan import ClipPlan, Origin, build_rng
from eskin.sim.dataset.sets import ACCIDENTS, QUIET
from eskin.sim.people.perform import choose_kind, perform
from eskin.sim.people.person import Person, draw_person
from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.folds import compute_fold_share, find_fold_sites, press_both_sites
from eskin.sim.scene.motion import (
    draw_motion,
    draw_pose_path,
    follow_with_delay,
    hold_pose,
)
from eskin.sim.scene.placement import choose_site, draw_site
from eskin.sim.scene.poses import (
    can_fold,
    can_touch_itself,
    draw_pose,
    draw_touching_pose,
)
from eskin.sim.scene.scene import are_apart, crop_press, find_contact_steps, shift_touch
from eskin.sim.scene.validity import find_self_contact_sites


def draw_start(
    touch: TrueTouch, steps: int, constants: Constants, rng: np.random.Generator
) -> int:
    """Draw the step of the clip at which a touch's clock starts.

    Some touches are cut by an end of the clip, but at least the share `clip.inside` of
    them is in it. Half of the touches that are longer than the clip begin before it,
    and the rest in its first part, unless one was drawn with `began_before`.
    """
    first, end = find_contact_steps(touch)
    length = end - first
    outside = round((1 - constants.value("clip.inside")) * length)
    if length >= steps:
        margin = round((1 - constants.value("clip.inside")) * steps)
        before = bool(touch.drawn.get("began_before", rng.random() < 0.5))
        low, high = (steps - length - margin, -1) if before else (0, margin)
        onset = int(rng.integers(low, high + 1))
    elif rng.random() < constants.value("clip.cut"):
        low = -outside if rng.random() < 0.5 else steps - length
        onset = int(rng.integers(low, low + outside + 1))
    else:
        onset = int(rng.integers(0, steps - length + 1))
    return onset - first


@dataclass(frozen=True, eq=False)
class ClipSetup:
    """A clip setup holds the pose and motion of a clip, to which touches are added."""

    plan: ClipPlan
    """Plan of the clip."""
    env: SimEnvironment
    """Robot in its skin."""
    q: Float[np.ndarray, "time joint"]
    """Joint positions, starting `lead` steps before the clip [rad]."""
    lead: int
    """Steps before the clip."""
    folded: bool
    """Whether patches of two links face each other at the start."""
    rng: np.random.Generator
    """Random generator."""

    @property
    def steps(self) -> int:
        """Return the number of steps of the clip."""
        return len(self.q) - self.lead


def count_clip_steps(plan: ClipPlan, env: SimEnvironment) -> tuple[int, int]:
    """Return the number of steps before the clip, and of all steps simulated."""
    step = env.constants.value("time.step")
    lead = round(env.constants.value("clip.before") / step)
    return lead, lead + round(plan.seconds / step)


def set_up_clip(
    plan: ClipPlan, kind: str, env: SimEnvironment, rng: np.random.Generator
) -> ClipSetup:
    """Draw the pose and motion of a clip."""
    lead, steps = count_clip_steps(plan, env)
    groups = frozenset(plan.groups)
    folded = bool(rng.random() < plan.fold_share) and can_fold(env, groups)
    pose_rng = rng if plan.pose is None else build_rng(plan.pose)
    if needs_touching_pose(plan, kind, env, rng):
        q = draw_touching_pose(env, groups, pose_rng)
    else:
        q = draw_pose(env, groups, pose_rng, folded)
    seconds = steps * env.constants.value("time.step")
    if not (plan.moving and env.can_move):
        path = hold_pose(env, q, seconds)
    elif plan.gesture is None:
        path = draw_pose_path(env, seconds, rng, groups)
    else:
        path = draw_motion(env, q, seconds, rng)
    return ClipSetup(plan, env, path, lead, folded, rng)


def needs_touching_pose(
    plan: ClipPlan, kind: str, env: SimEnvironment, rng: np.random.Generator
) -> bool:
    """Tell whether a clip needs a pose in which links of the robot nearly touch."""
    if kind != ACCIDENTS:
        return kind == "self_contact"
    wanted = not plan.moving and rng.random() < env.constants.value("stream.touching")
    return wanted and can_touch_itself(env, frozenset(plan.groups))


@lru_cache(maxsize=128)
def get_person(origin: Origin, env: SimEnvironment) -> Person:
    """Return the person of an origin, cached."""
    return draw_person(origin.name, env.constants, origin.rng())


def draw_second_person(setup: ClipSetup) -> Person:
    """Draw who makes a second touch: another person, or the same one."""
    plan = setup.plan
    env = setup.env
    other = setup.rng.random() < env.constants.value("clip.company")
    company = plan.company if other and plan.company is not None else plan.person
    return get_person(company, env)


def draw_kind(setup: ClipSetup, person: Person, gesture: str) -> str:
    """Draw a variant of a gesture by the weights of a person."""
    constants = setup.env.constants
    difficulty = setup.plan.difficulty
    return choose_kind(gesture, None, person, constants, setup.rng, difficulty)


def perform_at(
    setup: ClipSetup, person: Person, gesture: str, kind: str, at: int
) -> TrueTouch:
    """Draw the touch of a person at a step of the scene, on the touch's own clock."""
    q = setup.q[at]
    first, second = draw_sites(setup, person, gesture, kind, q)
    touch = perform_planned(
        gesture, kind, person, first, setup.plan, setup.env, setup.rng
    )
    if second is None:
        return touch
    share = compute_fold_share(setup.env, q, first, second)
    return press_both_sites(touch, first, second, share)


def perform_planned(
    gesture: str,
    kind: str | None,
    person: Person,
    site: ContactSite,
    plan: ClipPlan,
    env: SimEnvironment,
    rng: np.random.Generator,
) -> TrueTouch:
    """Perform a gesture with the difficulty and durations of a plan."""
    constants = env.constants
    difficulty = plan.difficulty
    regime = plan.regime
    return perform(gesture, kind, person, site, constants, rng, difficulty, regime)


def draw_sites(
    setup: ClipSetup,
    person: Person,
    gesture: str,
    kind: str,
    q: Float[np.ndarray, "joint"],
) -> tuple[ContactSite, ContactSite | None]:
    """Draw the site of a touch, and a second one in some folded poses."""
    env = setup.env
    rng = setup.rng
    if kind == "self_contact":
        found = find_self_contact_sites(env, q)
        return found[rng.integers(len(found))], None
    if setup.folded and rng.random() < env.constants.value("fold.both"):
        pairs = find_fold_sites(env, q, person)
        if pairs:
            return pairs[0]
    if setup.plan.places:
        places = map(build_rng, setup.plan.places)
        return choose_site(env, q, person, gesture, places, kind), None
    return draw_site(env, q, person, gesture, rng, kind), None


def place_touch(setup: ClipSetup, touch: TrueTouch, start: int) -> TrueTouch:
    """Return a touch with its clock started at a step, on the moving robot.

    A hand follows the robot with a delay, the robot slides past a body that stands in
    the world, and a link that touches another moves with it.
    """
    touch = shift_touch(touch, start)
    if not setup.plan.moving or touch.kind == "self_contact":
        return touch
    delay = setup.env.constants.draw("motion.delay", setup.rng)
    cropped = (crop_press(press, len(setup.q)) for press in touch.presses)
    presses = tuple(
        follow_with_delay(press, setup.env, setup.q, delay)
        for press in cropped
        if press is not None
    )
    return replace(touch, presses=presses, drawn=touch.drawn | {"delay": delay})


SECOND_TOUCH_TRIES = 5
"""Attempts to draw a second touch that fits."""

NEVER_SECOND = ("self_contact", "electrical", "idle")
"""Kinds that are never a second touch, nor a gesture of a stream."""


def draw_second_touch(setup: ClipSetup, first: TrueTouch) -> tuple[TrueTouch, ...]:
    """Draw another touch at the same time, smaller than the first, if one fits.

    A clip is labelled by its first touch: a larger second one would make the label
    wrong, and so would a gesture beside a first touch that is `none`.
    """
    constants = setup.env.constants
    for _ in range(SECOND_TOUCH_TRIES):
        person = draw_second_person(setup)
        gesture = constants.choose("clip.second", setup.rng)
        gesture = gesture if first.gesture != NONE else NONE
        kind = draw_kind(setup, person, gesture)
        if kind in NEVER_SECOND:
            continue
        touch = perform_at(setup, person, gesture, kind, setup.lead)
        start = setup.lead + draw_start(touch, setup.steps, constants, setup.rng)
        touch = place_touch(setup, touch, start)
        if 0 < compute_impulse(setup, touch) < compute_impulse(setup, first):
            if are_apart(setup.env, setup.q[setup.lead], touch, first):
                return (touch,)
    return ()


def compute_impulse(setup: ClipSetup, touch: TrueTouch) -> float:
    """Return the force of a touch summed over the clip [N s]."""
    step = setup.env.constants.value("time.step")
    total = 0.0
    for press in touch.presses:
        start = max(0, setup.lead - press.first)
        end = max(0, len(setup.q) - press.first)
        total += float(press.force[start:end].sum()) * step
    return total


def draw_stream(setup: ClipSetup) -> tuple[TrueTouch, ...]:
    """Draw all touches of a stream, in order of onset."""
    if setup.plan.kind == QUIET:
        return ()
    constants = setup.env.constants
    rng = setup.rng
    quiet = constants.value("stream.quiet") / constants.value("time.step")
    last = len(setup.q) - round(quiet)
    person = get_person(setup.plan.person, setup.env)
    found: list[TrueTouch] = []
    at = setup.lead + draw_pause(setup)
    while True:
        touch = draw_next_touch(setup, person, at)
        _, end = find_contact_steps(touch)
        if end >= last:
            return tuple(found)
        found.append(touch)
        if rng.random() < constants.value("stream.together"):
            company = draw_second_person(setup)
            onset = at + int(rng.integers(0, max(1, end - at)))
            other = draw_next_touch(setup, company, onset)
            other_end = find_contact_steps(other)[1]
            if other_end < last and are_apart(setup.env, setup.q[at], touch, other):
                found.append(other)
                end = max(end, other_end)
        at = end + draw_pause(setup)


def draw_next_touch(setup: ClipSetup, person: Person, at: int) -> TrueTouch:
    """Draw a touch whose contact begins at a step."""
    at = min(at, len(setup.q) - 1)
    if setup.plan.kind == ACCIDENTS:
        gesture = NONE
        kind = draw_accident(setup, at)
    else:
        gesture = setup.env.constants.choose("stream.gestures", setup.rng)
        kind = draw_kind(setup, person, gesture)
        while kind in NEVER_SECOND:
            kind = draw_kind(setup, person, gesture)
    touch = perform_at(setup, person, gesture, kind, at)
    return place_touch(setup, touch, at - find_contact_steps(touch)[0])


def draw_accident(setup: ClipSetup, at: int) -> str:
    """Draw the kind of an accidental contact that is possible at a step."""
    env = setup.env
    touching = bool(find_self_contact_sites(env, setup.q[at]))
    kind = env.constants.choose("stream.accidents", setup.rng)
    while kind == "self_contact" and not touching:
        kind = env.constants.choose("stream.accidents", setup.rng)
    return kind


def draw_pause(setup: ClipSetup) -> int:
    """Draw the number of steps without contact until the next touch."""
    seconds = setup.env.constants.draw("stream.pause", setup.rng)
    return round(seconds / setup.env.constants.value("time.step"))
