"""What happens in the two clips of a pair."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.clip.plan import ClipPlan
from eskin.sim.clip.scene import Scene
from eskin.sim.clip.timing import contact_steps, draw_start
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.chart import Chart
from eskin.sim.robot.world import World
from eskin.skin import MountedSkin


@dataclass(frozen=True, eq=False)
class Twins:
    """Two scenes that press the same taxels alike."""

    first: Scene
    """With the gesture."""
    second: Scene
    """With what is none."""
    mounted: MountedSkin
    """The skin of the second scene on its robot."""
    charts: tuple[Chart, ...]
    """Its surfaces, unrolled as those of the first scene are."""


def steps_of(plan: ClipPlan, world: World) -> tuple[int, int]:
    """Steps before the clip, and of all that is simulated."""
    step = world.constants.value("time.step")
    lead = round(world.constants.value("clip.before") / step)
    return lead, lead + round(plan.seconds / step)


def still(q: Float[np.ndarray, "joint"], steps: int) -> Float[np.ndarray, "time joint"]:
    """A robot that stands in one pose."""
    return np.tile(q, (steps, 1))


def onset_of(
    touch: TrueTouch, plan: ClipPlan, world: World, rng: np.random.Generator
) -> int:
    """Step of the scene at which a touch's clock starts, all of it in the clip.

    A touch that is longer than the clip is cut as in other clips.
    """
    lead, steps = steps_of(plan, world)
    first, end = contact_steps(touch)
    free = steps - lead - (end - first)
    if free <= 0:
        return lead + draw_start(touch, steps - lead, world.constants, rng)
    return lead - first + int(rng.integers(0, free + 1))
