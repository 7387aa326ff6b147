"""Poke: a finger pushes briefly."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press, Stamps
from eskin.sim.people.hand import body_of
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.series import Series, peaked


def poke(act: Act) -> tuple[Press, ...]:
    """One push, sometimes pressed again before it leaves."""
    force = draw_force(act, "poke.force", "poke")
    duration = draw_duration(act, "poke")
    steps = act.steps(duration)
    shape = act.push(steps)
    if act.happens("again", act.constants.value("poke.again") * act.difficulty):
        shape = fitted(again(act, shape), steps)
    series = peaked(shape * act.held(steps), force)
    flesh = replace(act.person.flesh, conformity=act.draw("poke.conformity"))
    path, angle = act.wander(steps), act.turn()
    return (act.press(finger(act), flesh, series, path, angle),)


def finger(act: Act) -> Stamps:
    """What pokes."""
    if act.kind == "knuckle":
        return body_of("knuckle", act.constants)
    return act.stamps(act.kind)


def again(act: Act, shape: Series) -> Float[np.ndarray, "longer"]:
    """The push, and another one that begins before it has left."""
    share, dip = act.draw("poke.again_share"), act.draw("poke.again_dip")
    later = int(np.flatnonzero(shape >= dip)[-1]) + 1
    both = np.zeros(later + len(shape))
    both[: len(shape)] = shape
    start = int(np.flatnonzero(share * shape >= dip * share)[0])
    tail = share * shape[start:]
    both[later : later + len(tail)] = np.maximum(both[later : later + len(tail)], tail)
    return both[: later + len(tail)]


def fitted(shape: Float[np.ndarray, "longer"], steps: int) -> Series:
    """The same shape in so many steps: the law of durations is that of whole pokes."""
    places = np.linspace(0, len(shape) - 1, steps)
    return peaked(np.interp(places, np.arange(len(shape)), shape), 1.0)
