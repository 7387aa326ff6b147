"""Bending: a grab round a tube, and the hand pressed flat that has the same counts."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from eskin.robot import load_robot
from eskin.sim.clip.plan import ClipPlan
from eskin.sim.clip.scene import Scene
from eskin.sim.clip.stage import person_of
from eskin.sim.clip.timing import moved
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.chart import Chart, charts_of
from eskin.sim.pairs.sides import INSTEAD
from eskin.sim.pairs.twins import Twins, onset_of, steps_of
from eskin.sim.people.hand import MM
from eskin.sim.people.programs import perform
from eskin.sim.robot.world import World
from eskin.sim.site.site import Site
from eskin.skin import PRESETS, MountedSkin


@lru_cache(maxsize=1)
def flat_side() -> tuple[MountedSkin, tuple[Chart, ...]]:
    """The patch laid flat, and its one chart."""
    preset = PRESETS["flat"]
    mounted = MountedSkin(preset.build(), load_robot(preset.robot))
    return mounted, charts_of(mounted)


def draw_bending(plan: ClipPlan, world: World, rng: np.random.Generator) -> Twins:
    """A grab of the patch round the tube, and the same on it as it lies flat."""
    _, steps = steps_of(plan, world)
    q = np.zeros((steps, 0))
    grabs = () if plan.kind == "idle" else (draw_grab(plan, world, rng),)
    presses = tuple(
        replace(touch, gesture="none", kind=INSTEAD["grab"]) for touch in grabs
    )
    return Twins(Scene(q, grabs), Scene(q, presses), *flat_side())


def draw_grab(plan: ClipPlan, world: World, rng: np.random.Generator) -> TrueTouch:
    """A grab somewhere on the patch, by the person's taste."""
    touch = perform(
        *("grab", None, person_of(plan.person, world), draw_site(world, rng)),
        *(world.constants, rng, plan.difficulty, plan.regime),
    )
    return moved(touch, onset_of(touch, plan, world, rng))


def draw_site(world: World, rng: np.random.Generator) -> Site:
    """Near the middle of the patch, the hand round the tube either way."""
    chart = world.charts[0]
    off = world.constants.value("pairs.off") * MM
    s, t = rng.uniform(-off, off, 2)
    low, high = chart.unrolled[:, 1].min() - t, chart.unrolled[:, 1].max() - t
    angle = rng.choice([-1.0, 1.0]) * np.pi / 2
    return Site(0, (s, t), chart.radius, (float(low), float(high)), float(angle))
