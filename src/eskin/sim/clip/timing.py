"""When in its clip a touch takes place."""

from dataclasses import replace

import numpy as np

from eskin.sim.clip.truth import TrueTouch
from eskin.sim.constants import Constants


def contact_steps(touch: TrueTouch) -> tuple[int, int]:
    """First step with force and the step behind the last, on the touch's own clock."""
    firsts, ends = [], []
    for press in touch.presses:
        pressed = np.flatnonzero(press.force > 0)
        if len(pressed):
            firsts.append(press.first + int(pressed[0]))
            ends.append(press.first + int(pressed[-1]) + 1)
    return (min(firsts), max(ends)) if firsts else (0, 0)


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


def moved(touch: TrueTouch, start: int) -> TrueTouch:
    """The same touch with its clock started at a step of the clip."""
    presses = tuple(replace(p, first=p.first + start) for p in touch.presses)
    return replace(touch, presses=presses)
