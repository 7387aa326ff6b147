"""Poke: a finger pushes briefly."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press, Stamps
from eskin.sim.people.hand import body_of
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.series import Series, bell, peaked, trapezoid


def poke(act: Act) -> tuple[Press, ...]:
    """One push, sometimes pressed again before it leaves."""
    force = draw_force(act, "poke.force", "poke")
    duration = draw_duration(act, "poke")
    steps = act.steps(duration)
    shape = push(act, steps)
    if act.happens("again", act.constants.value("poke.again") * act.difficulty):
        shape = fitted(again(act, shape), steps)
    path = act.slip("poke.slip", len(shape))
    flesh = replace(act.person.flesh, conformity=act.draw("poke.conformity"))
    return (act.press(finger(act), flesh, force * shape, path, act.turn()),)


def finger(act: Act) -> Stamps:
    """What pokes."""
    if act.kind == "knuckle":
        return body_of("knuckle", act.constants)
    return act.stamps(act.kind)


def push(act: Act, steps: int) -> Series:
    """Force of one push through time, largest value 1."""
    if act.choose("poke.shape") == "bell":
        return bell(steps, act.constants.value("force.bell"))
    rise, fall = (act.constants.value(f"poke.{part}") for part in ("rise", "fall"))
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    return trapezoid(steps, rise, fall, smooth)


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
