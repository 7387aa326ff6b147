"""How much force and how long: what a population, a person and a touch vary by.

A constant tells the law over the whole population. A person's own scale and the repeats
of one person are part of it; what they leave is how a person does that one gesture.
"""

import numpy as np

from eskin.sim.constants import Constants, Spread
from eskin.sim.people.programs.act import Act

TRIES = 30
"""Draws before a number outside its limits is cut."""


def draw_force(act: Act, name: str, gesture: str, most: float = np.inf) -> float:
    """Largest force of a touch [N]; more spread the more difficult.

    Args:
        act: the touch.
        name: constant with the law over the population.
        gesture: whose habit it goes by; drawn anew for one that is no habit.
        most: no more than this [N].
    """
    habit = act.person.firmness.get(gesture)
    usual = act.constants.value("force.repeat")
    repeat = np.log(usual + act.constants.value("force.repeat_growth") * act.difficulty)
    scale = act.person.force_scale
    rest = left_over(act.constants, name, "person.force_scale", np.log(usual))
    return act.note("force", draw_amount(act, name, scale, rest, repeat, habit, most))


def draw_duration(act: Act, gesture: str, habit: str | None = None) -> float:
    """How long a touch lasts [s].

    Difficulty moves spread from between people to within them and leaves the law over
    the population as it is, for that is published.
    """
    name = f"duration.{act.regime}.{gesture}"
    pace = act.person.pace.get(habit or gesture)
    repeat = np.log(
        act.constants.value("duration.repeat")
        + act.constants.value("duration.repeat_growth") * act.difficulty
    )
    scale = act.person.tempo_scale
    rest = left_over(act.constants, name, "person.tempo_scale", repeat)
    return act.note(
        "duration", draw_amount(act, name, scale, rest, repeat, pace, np.inf)
    )


def draw_amount(
    act: Act,
    name: str,
    scale: float,
    rest: float,
    repeat: float,
    habit: float | None,
    most: float,
) -> float:
    """Median x person x the person's habit x this time, within the law's limits."""
    law = lognormal(act.constants, name)
    own = act.rng.normal() if habit is None else habit
    middle = (law.median or 0.0) * scale * np.exp(rest * own)
    middle *= act.constants.factors.get(name, 1.0)
    high = min(law.high, most)
    number = middle
    for _ in range(TRIES):
        number = float(middle * np.exp(repeat * act.rng.normal()))
        if law.low <= number <= high:
            return number
    return float(np.clip(number, min(law.low, high), high))


def left_over(constants: Constants, name: str, person: str, repeat: float) -> float:
    """Deviation of the logarithm that person and repeats leave of a law's."""
    total = np.log(lognormal(constants, name).gsd or 1.0)
    own = np.log(lognormal(constants, person).gsd or 1.0)
    return float(np.sqrt(max(total**2 - own**2 - repeat**2, 0.0)))


def lognormal(constants: Constants, name: str) -> Spread:
    """The law of a constant, which must be lognormal."""
    spread = constants.entry(name).spread
    if spread is None or spread.law != "lognormal":
        raise ValueError(f"constant '{name}' must have a lognormal law")
    return spread
