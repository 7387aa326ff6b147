"""This module draws bumps: bodies that hit the robot, and leave at once.

Real bumps differ in what hits, how hard and how often. A sprung mass is one model; a
body that is pushed for a moment, a force that falls more slowly than it rose, and one
that bounces are others, so that no recogniser learns the one model.
"""

from typing import Literal, cast

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM
from eskin.sim.contact.press import Press
from eskin.sim.people.gesture_sample import (
    GestureSample,
    Series,
    build_bell,
    pin_ends,
    scale_to_peak,
)
from eskin.sim.people.person import build_body

Make = Literal["impact", "push"]


def draw_bump(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a body that hits the robot once, or bounces."""
    make = cast(Make, sample.choose("none.bump.makes"))
    if make == "impact":
        body, force, seconds = draw_impact(sample)
    else:
        body, force, seconds = draw_short_push(sample)
    hit = scale_to_peak(draw_hit(sample, sample.count_steps(seconds)), force)
    series = repeat_hit(sample, hit)
    path = draw_slide(sample, sample.draw("none.bump.slide"), len(series))
    return (sample.build_press(build_body(body, sample.constants), series, path),)


def draw_impact(sample: GestureSample) -> tuple[str, float, float]:
    """Draw a sprung mass: its body, greatest force [N] and half a period [s]."""
    speed = sample.draw("none.bump.speed")
    mass = sample.draw("none.bump.mass")
    stiffness = sample.draw("none.bump.stiffness") / MM
    force = sample.record("force", speed * np.sqrt(mass * stiffness))
    seconds = sample.record("duration", np.pi * np.sqrt(mass / stiffness))
    soft, hard = sample.constants.array("none.bump.limits") / MM
    body = "torso" if stiffness < soft else "forearm"
    if stiffness > hard:
        body = sample.choose("none.bump.hard")
    return body, force, seconds


def draw_short_push(sample: GestureSample) -> tuple[str, float, float]:
    """Draw a body that is pushed for a moment: it, its force [N] and duration [s]."""
    force = sample.record("force", sample.draw("none.bump.push"))
    seconds = sample.record("duration", sample.draw("none.bump.push_seconds"))
    return sample.choose("none.bump.bodies"), force, seconds


def draw_hit(sample: GestureSample, steps: int) -> Series:
    """Draw the force of one hit through time: half a sine, or a slower fall."""
    if not sample.draw_event("slow", sample.constants.value("none.bump.slow")):
        return build_bell(steps, 1.0)
    rise = sample.draw("none.bump.rise")
    x = np.linspace(0, 1, steps) / rise
    return pin_ends(x * np.exp(1 - x))


def repeat_hit(sample: GestureSample, hit: Series) -> Float[np.ndarray, "longer"]:
    """Return a hit and those that follow, each weaker and sooner by one share."""
    hits = int(sample.choose("none.bump.hits"))
    share = sample.draw("none.bump.restitution")
    gap = sample.draw("none.bump.gap")
    parts = [hit]
    for number in range(1, hits):
        pause = round(gap * share ** (number - 1) / sample.step)
        parts += [np.zeros(pause), share**number * hit]
    return np.concatenate(parts)


def draw_slide(
    sample: GestureSample, speed: float, steps: int
) -> Float[np.ndarray, "time 2"]:
    """Draw a straight path at even speed [m/s] about the site [m]."""
    direction = sample.record("direction", sample.rng.uniform(-np.pi, np.pi))
    along = speed * sample.step * (np.arange(steps) - (steps - 1) / 2)
    return along[:, None] * np.array([-np.sin(direction), np.cos(direction)])
