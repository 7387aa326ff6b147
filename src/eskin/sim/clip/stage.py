"""Where a clip takes place, and what people do there."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from eskin.sim.clip.plan import ACCIDENTS, ClipPlan, Origin
from eskin.sim.clip.scene import cropped
from eskin.sim.clip.timing import moved
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.people.person import Person, draw_person
from eskin.sim.people.programs import perform
from eskin.sim.people.programs.perform import kind_of
from eskin.sim.robot.motion import drag, draw_motion, follow, still, way
from eskin.sim.robot.pose import (
    can_fold,
    can_touch_itself,
    draw_pose,
    draw_touching_pose,
)
from eskin.sim.robot.world import World
from eskin.sim.site.fold import fold, fold_sites, share_of
from eskin.sim.site.place import draw_site
from eskin.sim.site.site import Site
from eskin.sim.site.touching import self_contact_sites


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
    return kind_of(gesture, None, person, constants, stage.rng, difficulty)


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
) -> tuple[Site, Site | None]:
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
