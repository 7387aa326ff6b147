"""A second touch while another one takes place."""

import numpy as np
from jaxtyping import Float

from eskin.recording import NONE
from eskin.sim.clip.stage import Stage, act_out, company_of, draw_kind, put
from eskin.sim.clip.timing import draw_start
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.robot.world import World

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


def are_apart(
    world: World, q: Float[np.ndarray, "joint"], one: TrueTouch, other: TrueTouch
) -> bool:
    """Whether two touches are far enough apart in space to be two."""
    a, b = (centres_of(world, q, touch) for touch in (one, other))
    gaps = np.linalg.norm(a[:, None] - b[None], axis=2)
    return bool(gaps.min(initial=np.inf) >= world.constants.value("clip.apart"))


def centres_of(
    world: World, q: Float[np.ndarray, "joint"], touch: TrueTouch
) -> Float[np.ndarray, "press 3"]:
    """Where each press of a touch is half-way through it, in the world [m]."""
    T_world_link = world.poses(q)
    points = []
    for press in touch.presses:
        middle = press.centre[press.steps // 2][None]
        p_link = world.charts[press.chart].surface.wrap(middle).positions[0]
        T = T_world_link[world.links[press.chart]]
        points.append(T[:3, :3] @ p_link + T[:3, 3])
    return np.array(points).reshape(-1, 3)
