"""Gestures outside the vocabulary, to see what becomes of them."""

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.programs.grab import hold
from eskin.sim.people.programs.nothing import ramped
from eskin.sim.people.programs.stroke import draw_way, sliding
from eskin.sim.people.series import peaked, tremor


def rub(act: Act) -> tuple[Press, ...]:
    """To and fro, firmly, several times."""
    force = draw_force(act, "unknown.rub.force", "stroke")
    steps = act.steps(draw_duration(act, "rub", "stroke"))
    swing = swung(act, steps, "unknown.rub")
    path = swing[:, None] * draw_way(act) + act.wander(steps)
    stamps = act.stamps(act.choose("stroke.kinds"))
    series = peaked(sliding(act, steps), force)
    return (act.press(stamps, act.flesh(), series, path, act.turn()),)


def swung(act: Act, steps: int, name: str) -> Float[np.ndarray, "time"]:
    """To and fro, in the room there is [m]."""
    low, high = act.site.clear
    reach = min(act.draw(f"{name}.reach"), (high - low) / 2)
    return reach * tremor(steps, act.step, act.draw(f"{name}.rate"), act.rng)


def tickle(act: Act) -> tuple[Press, ...]:
    """Fingertips, lightly and quickly."""
    force = draw_force(act, "unknown.tickle.force", "tickle")
    steps = act.steps(draw_duration(act, "tickle"))
    swings = [swung(act, steps, "unknown.tickle") for _ in "st"]
    path = np.column_stack(swings) + act.wander(steps)
    depth = act.draw("unknown.tickle.depth")
    rate = act.draw("unknown.tickle.rate")
    beats = 1 - depth * (1 + tremor(steps, act.step, rate, act.rng)) / 2
    ramp = 2 * act.constants.value("force.smooth")
    series = peaked(ramped(act, steps, ramp, ramp) * beats, force)
    stamps = act.stamps("tips")
    return (act.press(stamps, act.flesh(), series, path, act.turn()),)


def squeeze(act: Act) -> tuple[Press, ...]:
    """A firmer grab that is held."""
    duration = draw_duration(act, "squeeze", "grab")
    firmer = act.constants.value("unknown.squeeze.firmer")
    return (hold(act, duration, act.choose("grab.kinds"), firmer),)
