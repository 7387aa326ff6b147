"""One clip or stream from its plan: who does what where, through the sensor."""

from dataclasses import replace

from eskin.sim.clip.disturbance import disturbed, disturbed_by_the_hour
from eskin.sim.clip.outcome import Clip
from eskin.sim.clip.plan import QUIET, ClipPlan
from eskin.sim.clip.play import build_of, play, session_of
from eskin.sim.clip.scene import Scene
from eskin.sim.clip.second import second_touch
from eskin.sim.clip.stage import Stage, act_out, person_of, put, set_up
from eskin.sim.clip.stream import draw_stream
from eskin.sim.clip.timing import draw_start
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.people.programs.perform import kind_of
from eskin.sim.robot.groups import group_of
from eskin.sim.robot.pose import can_touch_itself
from eskin.sim.robot.world import World


def make_clip(plan: ClipPlan, world: World) -> Clip:
    """Make one clip or stream alone, the same one every time.

    Raises:
        ValueError: the plan asks for what the robot or the skin cannot do.
    """
    rng, constants = plan.rng(), world.constants
    person, groups = person_of(plan.person, world), frozenset(plan.groups)
    kind = plan.kind or ""
    if plan.gesture is not None and not kind:
        kind = kind_of(plan.gesture, None, person, constants, rng, plan.difficulty)
        while kind == "self_contact" and not can_touch_itself(world, groups):
            kind = kind_of(plan.gesture, None, person, constants, rng, plan.difficulty)
    stage = set_up(plan, kind, world, rng)
    if plan.gesture is None:
        touches = draw_stream(stage)
    else:
        touches = draw_touches(stage, plan.gesture, kind)
    build = build_of(plan.build, world)
    session = session_of(plan.session, build)
    clip = play(Scene(stage.q, touches), stage.lead, build, session, world, rng)
    clip = replace(
        clip,
        pose_group=group_of(world, stage.q[stage.lead]),
        drawn=drawn_of(stage, touches),
    )
    if kind == "electrical":
        return disturbed(clip, stage)
    return disturbed_by_the_hour(clip, stage) if kind == QUIET else clip


def draw_touches(stage: Stage, gesture: str, kind: str) -> tuple[TrueTouch, ...]:
    """The touch that a clip is made for, and perhaps a smaller one beside it."""
    person = person_of(stage.plan.person, stage.world)
    touch = act_out(stage, person, gesture, kind, stage.lead)
    start = draw_start(touch, stage.steps, stage.world.constants, stage.rng)
    touch = put(stage, touch, stage.lead + start)
    if touch.presses and stage.rng.random() < stage.plan.concurrent:
        return (touch, *second_touch(stage, touch))
    return (touch,)


def drawn_of(stage: Stage, touches: tuple[TrueTouch, ...]) -> dict[str, float | str]:
    """Every parameter of the clip, by name."""
    joints = stage.world.mounted.robot.joint_names
    start = stage.q[stage.lead].tolist()
    drawn: dict[str, float | str] = {
        f"q.{joint}": value for joint, value in zip(joints, start, strict=True)
    }
    drawn["folded"] = float(stage.folded)
    for number, touch in enumerate(touches):
        drawn[f"touch{number}.kind"] = touch.kind
        drawn |= {f"touch{number}.{name}": each for name, each in touch.drawn.items()}
    return drawn
