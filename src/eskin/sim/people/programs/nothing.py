"""Hands that touch the robot without a gesture for it."""

import numpy as np

from eskin.sim.contact.press import Press
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.programs.double_pat import pats
from eskin.sim.people.programs.grab import across, closed, hold
from eskin.sim.people.series import Series, peaked, trapezoid, tremor

FINGERS = ("one_tip", "two_tips")
"""Parts of a hand whose brief push is a poke."""


def resting_hand(act: Act) -> tuple[Press, ...]:
    """A hand put down and left there."""
    force = draw_force(act, "none.resting_hand.force", "resting_hand")
    act.happens("began_before", act.constants.value("none.resting_hand.before"))
    steps = act.steps(act.draw("none.resting_hand.hold"))
    ramp = act.draw("none.resting_hand.ramp")
    stamps = act.stamps(act.choose("none.resting_hand.kinds"))
    series = peaked(ramped(act, steps, ramp, ramp) * act.held(steps), force)
    lies_round = act.happens("round", act.constants.value("none.resting_hand.round"))
    flesh = closed(act) if lies_round else act.flesh()
    angle = across(act) if lies_round else act.turn()
    return (act.press(stamps, flesh, series, act.wander(steps), angle),)


def ramped(act: Act, steps: int, up: float, down: float) -> Series:
    """Up in some time [s], hold, down in some time [s]."""
    whole = (steps - 1) * act.step
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    most = 1 / 2
    return trapezoid(steps, min(up / whole, most), min(down / whole, most), smooth)


def single_pat(act: Act) -> tuple[Press, ...]:
    """One pat; slower ones are as long as a tap of Jung et al. 2017."""
    style = act.choose("none.single_pat.kinds")
    if act.regime == "paper":
        return pats(act, 1, style)
    force = draw_force(act, "double_pat.force", "double_pat")
    steps = act.steps(draw_duration(act, "tap"))
    return (pushed(act, style, force, steps),)


def press(act: Act) -> tuple[Press, ...]:
    """A hand or finger pushes and keeps pushing: a finger for longer than a poke."""
    force = draw_force(act, "none.press.force", "press")
    style = act.choose("none.press.kinds")
    length = "finger_press" if style in FINGERS else "press"
    steps = act.steps(draw_duration(act, length, "press"))
    return (pushed(act, style, force, steps),)


def pushed(act: Act, style: str, force: float, steps: int) -> Press:
    """Parts of a hand that push once, where they are."""
    series = peaked(act.push(steps) * act.held(steps), force)
    stamps, flesh = act.stamps(style), act.flesh()
    return act.press(stamps, flesh, series, act.wander(steps), act.turn())


def squeeze_hold(act: Act) -> tuple[Press, ...]:
    """A grab that is held longer than a command."""
    style = act.choose("grab.kinds")
    return (hold(act, act.draw("none.squeeze_hold.hold"), style),)


def guiding(act: Act) -> tuple[Press, ...]:
    """Two hands hold the arm and move it."""
    steps = act.steps(act.draw("none.guiding.hold"))
    total, share = act.draw("none.guiding.force"), act.draw("none.guiding.share")
    gap = guided_gap(act)
    made = [
        guide(act, total * part, steps, place)
        for part, place in zip((share, 1 - share), gap, strict=True)
    ]
    return tuple(made)


def guided_gap(act: Act) -> tuple[float, float]:
    """Where along the tube the two hands are, from the site's centre [m]."""
    low, high = act.site.clear
    gap = min(act.draw("none.guiding.gap"), high - low)
    first = float(np.clip(-gap / 2, low, high - gap))
    return first, first + gap


def guide(act: Act, force: float, steps: int, place: float) -> Press:
    """One of the two hands."""
    sway = act.draw("none.guiding.sway")
    rate = act.draw("none.guiding.sway_rate")
    swaying = 1 + sway * tremor(steps, act.step, rate, act.rng)
    shape = ramped(act, steps, *(act.draw("none.lean.ramp") for _ in range(2)))
    stamps = act.stamps("full_hand")
    path = act.wander(steps) + np.array([0.0, place])
    series = peaked(shape * swaying * act.held(steps), force)
    return act.press(stamps, closed(act), series, path, across(act))
