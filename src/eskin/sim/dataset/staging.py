"""This module draws what happens in a clip or stream: pose, motion and touches."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from eskin.recording import NONE
from eskin.sim.constants import Constants
from eskin.sim.contact.press import ContactSite, TrueTouch
from eskin.sim.dataset.plan import ACCIDENTS, QUIET, ClipPlan, Origin
from eskin.sim.people.perform import choose_kind, perform
from eskin.sim.people.person import Person, draw_person
from eskin.sim.scene.environment import World
from eskin.sim.scene.folds import fold, fold_sites, share_of
from eskin.sim.scene.motion import drag, draw_motion, follow, still, way
from eskin.sim.scene.placement import draw_site
from eskin.sim.scene.poses import (
    can_fold,
    can_touch_itself,
    draw_pose,
    draw_touching_pose,
)
from eskin.sim.scene.scene import are_apart, contact_steps, cropped, moved
from eskin.sim.scene.validity import self_contact_sites


def draw_start(
    touch: TrueTouch, steps: int, constants: Constants, rng: np.random.Generator
) -> int:
    """Step of the clip at which the touch's clock starts.

    Some touches are cut by an end of the clip on purpose, yet never more of them than
    a share; one longer than the clip fills it, or begins or ends within it.

    Args:
        touch: what takes place.
        steps: length of the clip.
        constants: numbers of the world.
        rng: to draw from.
    """
    first, end = contact_steps(touch)
    length = end - first
    outside = round((1 - constants.value("clip.inside")) * length)
    if length >= steps:
        onset = draw_long(touch, length, steps, constants, rng)
    elif rng.random() < constants.value("clip.cut"):
        early = rng.random() < 0.5
        low, high = (
            (-outside, 0) if early else (steps - length, steps - length + outside)
        )
        onset = int(rng.integers(low, high + 1))
    else:
        onset = int(rng.integers(0, steps - length + 1))
    return onset - first


def draw_long(
    touch: TrueTouch,
    length: int,
    steps: int,
    constants: Constants,
    rng: np.random.Generator,
) -> int:
    """Step at which a touch longer than the clip makes contact.

    What began before, if the program says so, is there all the time or ends in the
    clip; other touches begin in its first part as often as they end in its last.
    """
    margin = round((1 - constants.value("clip.inside")) * steps)
    before = bool(touch.drawn.get("began_before", rng.random() < 0.5))
    low, high = (steps - length - margin, -1) if before else (0, margin)
    return int(rng.integers(low, high + 1))


@dataclass(frozen=True, eq=False)
class Stage:
    """Where and when a clip takes place, before anybody touches."""

    plan: ClipPlan
    """What was decided."""
    world: World
    """The robot in its skin."""
    q: Float[np.ndarray, "time joint"]
    """Joint positions, from `lead` steps before the clip on [rad]."""
    lead: int
    """Steps before the clip."""
    folded: bool
    """Whether patches of two links face each other at the start."""
    rng: np.random.Generator
    """To draw from."""

    @property
    def steps(self) -> int:
        """Length of the clip."""
        return len(self.q) - self.lead


def set_up(plan: ClipPlan, kind: str, world: World, rng: np.random.Generator) -> Stage:
    """Draw pose and motion."""
    step = world.constants.value("time.step")
    lead = round(world.constants.value("clip.before") / step)
    steps = lead + round(plan.seconds / step)
    groups = frozenset(plan.groups)
    folded = bool(rng.random() < plan.fold_share) and can_fold(world, groups)
    pose_rng = rng
    if plan.pose is not None:
        pose_rng = np.random.default_rng(np.random.SeedSequence(plan.pose))
    if is_touching(plan, kind, world, rng):
        q = draw_touching_pose(world, groups, pose_rng)
    else:
        q = draw_pose(world, groups, pose_rng, folded)
    seconds = steps * step
    if not (plan.moving and world.can_move):
        path = still(world, q, seconds)
    elif plan.gesture is None:
        path = way(world, seconds, rng, groups)
    else:
        path = draw_motion(world, q, seconds, rng)
    return Stage(plan, world, path, lead, folded, rng)


def is_touching(
    plan: ClipPlan, kind: str, world: World, rng: np.random.Generator
) -> bool:
    """Whether a clip needs a pose in which links of the robot all but touch."""
    if kind != ACCIDENTS:
        return kind == "self_contact"
    wanted = not plan.moving and rng.random() < world.constants.value("stream.touching")
    return wanted and can_touch_itself(world, frozenset(plan.groups))


@lru_cache(maxsize=128)
def person_of(origin: Origin, world: World) -> Person:
    """The person of an origin; the same one every time."""
    return draw_person(origin.name, world.constants, origin.rng())


def company_of(stage: Stage) -> Person:
    """Who makes a second touch: somebody else, or the same person's other hand."""
    plan, world = stage.plan, stage.world
    other = stage.rng.random() < world.constants.value("clip.company")
    company = plan.company if other and plan.company is not None else plan.person
    return person_of(company, world)


def draw_kind(stage: Stage, person: Person, gesture: str) -> str:
    """A way of doing a gesture, to a person's taste."""
    constants, difficulty = stage.world.constants, stage.plan.difficulty
    return choose_kind(gesture, None, person, constants, stage.rng, difficulty)


def act_out(
    stage: Stage, person: Person, gesture: str, kind: str, at: int
) -> TrueTouch:
    """What a person does at a step of the scene, still on the touch's own clock."""
    q = stage.q[at]
    first, second = sites_of(stage, person, gesture, kind, q)
    touch = perform(
        *(gesture, kind, person, first, stage.world.constants, stage.rng),
        *(stage.plan.difficulty, stage.plan.regime),
    )
    if second is None:
        return touch
    return fold(touch, first, second, share_of(stage.world, q, first, second))


def sites_of(
    stage: Stage,
    person: Person,
    gesture: str,
    kind: str,
    q: Float[np.ndarray, "joint"],
) -> tuple[ContactSite, ContactSite | None]:
    """Where it takes place; on two links at once in some folded poses."""
    world, rng = stage.world, stage.rng
    if kind == "self_contact":
        found = self_contact_sites(world, q)
        return found[rng.integers(len(found))], None
    if stage.folded and rng.random() < world.constants.value("fold.both"):
        pairs = fold_sites(world, q, person)
        if pairs:
            return pairs[0]
    return draw_site(world, q, person, gesture, rng, kind), None


def put(stage: Stage, touch: TrueTouch, start: int) -> TrueTouch:
    """A touch with its clock started at a step, as the robot moves under it.

    A hand follows the robot late, a cable hangs where it is, and a link that touches
    another stays with it.
    """
    touch = moved(touch, start)
    if not stage.plan.moving or touch.kind == "self_contact":
        return touch
    delay = stage.world.constants.draw("motion.delay", stage.rng)
    inside = (cropped(press, len(stage.q)) for press in touch.presses)
    presses = tuple(
        drag(press, stage.world, stage.q)
        if touch.kind == "cable"
        else follow(press, stage.world, stage.q, delay)
        for press in inside
        if press is not None
    )
    return replace(touch, presses=presses, drawn=touch.drawn | {"delay": delay})


TRIES = 5
"""Second touches that are drawn to find one that fits."""

ALONE = ("self_contact", "electrical", "idle")
"""Kinds that do not come as a second touch."""


def second_touch(stage: Stage, first: TrueTouch) -> tuple[TrueTouch, ...]:
    """Another touch at the same time, smaller than the first; none where none is.

    The clip stands for its largest touch, so a larger one would make its label wrong,
    and so would a gesture beside a touch that is none.
    """
    constants = stage.world.constants
    for _ in range(TRIES):
        person = company_of(stage)
        gesture = constants.choose("clip.second", stage.rng)
        gesture = gesture if first.gesture != NONE else NONE
        kind = draw_kind(stage, person, gesture)
        if kind in ALONE:
            continue
        touch = act_out(stage, person, gesture, kind, stage.lead)
        start = stage.lead + draw_start(touch, stage.steps, constants, stage.rng)
        touch = put(stage, touch, start)
        if 0 < impulse(stage, touch) < impulse(stage, first):
            if are_apart(stage.world, stage.q[stage.lead], touch, first):
                return (touch,)
    return ()


def impulse(stage: Stage, touch: TrueTouch) -> float:
    """Force of a touch over the clip [N s]."""
    step = stage.world.constants.value("time.step")
    total = 0.0
    for press in touch.presses:
        start = max(0, stage.lead - press.first)
        end = max(0, len(stage.q) - press.first)
        total += float(press.force[start:end].sum()) * step
    return total


def draw_stream(stage: Stage) -> tuple[TrueTouch, ...]:
    """All touches of a stream, by their onset."""
    if stage.plan.kind == QUIET:
        return ()
    constants, rng = stage.world.constants, stage.rng
    step = constants.value("time.step")
    person = person_of(stage.plan.person, stage.world)
    found: list[TrueTouch] = []
    at = stage.lead + pause_of(stage)
    while True:
        touch = next_touch(stage, person, at)
        _, end = contact_steps(touch)
        if end >= len(stage.q) - round(constants.value("stream.quiet") / step):
            return tuple(found)
        found.append(touch)
        if rng.random() < constants.value("stream.together"):
            other = next_touch(stage, company_of(stage), at + offset_of(stage, at, end))
            if fits(stage, touch, other, at):
                found.append(other)
                end = max(end, contact_steps(other)[1])
        at = end + pause_of(stage)


def next_touch(stage: Stage, person: Person, at: int) -> TrueTouch:
    """A touch whose contact begins at a step."""
    at = min(at, len(stage.q) - 1)
    if stage.plan.kind == ACCIDENTS:
        gesture, kind = NONE, draw_accident(stage, at)
    else:
        gesture, kind = draw_gesture(stage, person)
    touch = act_out(stage, person, gesture, kind, at)
    return put(stage, touch, at - contact_steps(touch)[0])


def draw_gesture(stage: Stage, person: Person) -> tuple[str, str]:
    """Something that people do, and the way they do it."""
    gesture = stage.world.constants.choose("stream.gestures", stage.rng)
    kind = draw_kind(stage, person, gesture)
    while kind in ALONE:
        kind = draw_kind(stage, person, gesture)
    return gesture, kind


def draw_accident(stage: Stage, at: int) -> str:
    """A contact that nobody means; of links, where they all but touch at a step."""
    world = stage.world
    touching = bool(self_contact_sites(world, stage.q[at]))
    kind = world.constants.choose("stream.accidents", stage.rng)
    while kind == "self_contact" and not touching:
        kind = world.constants.choose("stream.accidents", stage.rng)
    return kind


def pause_of(stage: Stage) -> int:
    """Steps without contact until the next touch."""
    seconds = stage.world.constants.draw("stream.pause", stage.rng)
    return round(seconds / stage.world.constants.value("time.step"))


def offset_of(stage: Stage, start: int, end: int) -> int:
    """How much later than the first a second touch begins: while the first lasts."""
    return int(stage.rng.integers(0, max(1, end - start)))


def fits(stage: Stage, first: TrueTouch, other: TrueTouch, at: int) -> bool:
    """Whether a second touch is apart from the first and over before the stream is."""
    quiet = stage.world.constants.value("stream.quiet")
    last = len(stage.q) - round(quiet / stage.world.constants.value("time.step"))
    over = contact_steps(other)[1] < last
    return over and are_apart(stage.world, stage.q[at], first, other)
