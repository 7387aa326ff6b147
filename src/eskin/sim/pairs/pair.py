"""The two clips of a pair."""

from dataclasses import dataclass, replace
from functools import lru_cache

from eskin.robot import load_robot
from eskin.sim.clip.outcome import Clip
from eskin.sim.clip.plan import ClipPlan
from eskin.sim.clip.play import build_of, felt_in, play, session_of, truths_of
from eskin.sim.clip.scene import Scene
from eskin.sim.constants import load_constants
from eskin.sim.pairs.bending import draw_bending
from eskin.sim.pairs.merging import draw_merging
from eskin.sim.pairs.schedule import plan_alone
from eskin.sim.pairs.sides import KINDS, SKINS, PairKind, kind_named
from eskin.sim.pairs.twins import Twins, steps_of
from eskin.sim.robot.groups import group_of
from eskin.sim.robot.world import World, build_world
from eskin.skin import PRESETS, MountedSkin

DRAWN = {"bending": draw_bending, "merging": draw_merging}


@dataclass(frozen=True, eq=False)
class Pair:
    """Two clips with the same counts, of which only one shows a gesture."""

    kind: PairKind
    """What tells them apart: the shape of the skin, or the pose of the robot."""
    first: Clip
    """With the gesture."""
    second: Clip
    """With what is none."""
    labels: tuple[str, str]
    """What is done in either."""
    mounted: tuple[MountedSkin, MountedSkin]
    """The skin of either on its robot."""


def make_pair(
    kind: str,
    seed: int,
    difficulty: float | None = None,
    world: World | None = None,
) -> Pair:
    """Make a pair alone, its person and sensor drawn from the same seed.

    Args:
        kind: `bending` or `merging`.
        seed: decides all that is drawn.
        difficulty: how much touches vary; the published one unless given.
        world: of the first clip; the patch round a tube or the UR5 unless given.

    Raises:
        ValueError: there is no such kind, or patches of the world never meet.
    """
    chosen = kind_named(kind)
    world = world or world_of(SKINS.get(KINDS[chosen][0], "ur5"))
    published = world.constants.value("sets.difficulty")
    level = published if difficulty is None else difficulty
    return pair_of(plan_alone(chosen, seed, level, world.constants), world)


@lru_cache(maxsize=2)
def world_of(skin: str) -> World:
    """A preset skin on its robot, prepared for touching."""
    preset = PRESETS[skin]
    mounted = MountedSkin(preset.build(), load_robot(preset.robot))
    return build_world(mounted, load_constants())


def pair_of(plan: ClipPlan, world: World) -> Pair:
    """Both clips of the pair that a plan belongs to.

    Args:
        plan: of either clip.
        world: of the first.
    """
    assert plan.pair is not None
    rng, kind = plan.rng(), plan.pair.kind
    twins = DRAWN[kind](plan, world, rng)
    lead, _ = steps_of(plan, world)
    build = build_of(plan.build, world)
    session = session_of(plan.session, build)
    played = play(twins.first, lead, build, session, world, rng)
    first = described(played, twins.first, plan, world, lead)
    second = described(
        second_of(played, twins, world, lead), twins.second, plan, world, lead
    )
    mounted = world.mounted, twins.mounted
    return Pair(kind, first, second, (plan.pair.gesture, "none"), mounted)


def clip_of(plan: ClipPlan, world: World) -> Clip:
    """The clip of a plan that is of a pair."""
    pair = pair_of(plan, world)
    assert plan.pair is not None
    return pair.second if plan.pair.is_second else pair.first


def second_of(first: Clip, twins: Twins, world: World, lead: int) -> Clip:
    """The same counts with the truth of the second scene."""
    scene = twins.second
    felt = felt_in(scene, world)
    truths = truths_of(scene, felt, twins.charts, twins.mounted, lead, world)
    readings = len(first.counts)
    every = (len(scene.q) - lead) // readings
    return replace(first, q=scene.q[lead::every][:readings], truths=truths)


def described(
    clip: Clip, scene: Scene, plan: ClipPlan, world: World, lead: int
) -> Clip:
    """The same clip with its group of poses and all that was drawn for it."""
    assert plan.pair is not None
    start = scene.q[lead]
    joints = world.mounted.robot.joint_names
    names = [f"q.{joint}" for joint in joints]
    drawn: dict[str, float | str] = {"pair": float(plan.pair.number)}
    drawn |= dict(zip(names, start.tolist(), strict=True))
    for number, touch in enumerate(scene.touches):
        drawn[f"touch{number}.kind"] = touch.kind
        drawn |= {f"touch{number}.{name}": each for name, each in touch.drawn.items()}
    group = group_of(world, start) if joints else 0
    return replace(clip, pose_group=group, drawn=drawn)
