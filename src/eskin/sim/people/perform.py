"""This module performs a gesture: from its name to what presses where."""

from collections.abc import Callable

import numpy as np

from eskin.sim.constants import Constants
from eskin.sim.contact.press import ContactSite, Press, TrueTouch
from eskin.sim.people.gesture_sample import GestureSample, Regime, choose_style
from eskin.sim.people.gestures import (
    draw_double_pat,
    draw_grab,
    draw_many_taps,
    draw_poke,
    draw_stroke,
)
from eskin.sim.people.non_gestures import (
    draw_brush,
    draw_bump,
    draw_cable,
    draw_guiding,
    draw_lean,
    draw_long_press,
    draw_resting_hand,
    draw_rub,
    draw_self_contact,
    draw_single_pat,
    draw_squeeze,
    draw_squeeze_hold,
    draw_tickle,
)
from eskin.sim.people.person import Person

Program = Callable[[GestureSample], tuple[Press, ...]]


def draw_nothing(sample: GestureSample) -> tuple[Press, ...]:
    """Nothing presses."""
    return ()


GESTURE_PROGRAMS: dict[str, Program] = {
    "poke": draw_poke,
    "double_pat": draw_double_pat,
    "grab": draw_grab,
    "stroke": draw_stroke,
}
NONE_PROGRAMS: dict[str, Program] = {
    "idle": draw_nothing,
    "resting_hand": draw_resting_hand,
    "lean": draw_lean,
    "bump": draw_bump,
    "single_pat": draw_single_pat,
    "press": draw_long_press,
    "squeeze_hold": draw_squeeze_hold,
    "brush": draw_brush,
    "cable": draw_cable,
    "self_contact": draw_self_contact,
    "guiding": draw_guiding,
    "electrical": draw_nothing,
}
UNKNOWN_PROGRAMS: dict[str, Program] = {
    "rub": draw_rub,
    "tickle": draw_tickle,
    "squeeze": draw_squeeze,
    "tap_many": draw_many_taps,
}
PERFORMABLE = (*GESTURE_PROGRAMS, "none", *UNKNOWN_PROGRAMS)
"""What can be performed."""

NO_PERSON_KINDS = ("idle", "cable", "self_contact", "electrical")
"""Kinds that nobody does."""


def perform(
    gesture: str,
    kind: str | None,
    person: Person,
    site: ContactSite,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
    regime: Regime | None,
    requested: dict[str, float] | None = None,
) -> TrueTouch:
    """One touch by a person at a site, from step 0 of its own clock.

    Args:
        gesture: one of `PERFORMABLE`; `draw_many_taps` counts as a double pat.
        kind: way of doing it; None draws one.
        person: who touches.
        site: where.
        constants: numbers of the world.
        rng: to draw from.
        difficulty: lambda; 0 is the easiest, 1.5 usual.
        regime: how long touches last; None draws one.
        requested: what is to be so whatever is drawn, by the name that it is noted by,
            such as `force` [N] and `duration` [s].

    Raises:
        ValueError: there is no such gesture, or no such way of doing it.
    """
    if gesture not in PERFORMABLE:
        raise ValueError(
            f"no gesture '{gesture}'; choose from {', '.join(PERFORMABLE)}"
        )
    if difficulty < 0:
        raise ValueError(f"difficulty is {difficulty}; give 0 or more")
    chosen = regime or parse_regime(constants.choose("duration.regime", rng))
    way = choose_kind(gesture, kind, person, constants, rng, difficulty)
    sample = GestureSample(
        *(way, person, site, constants, rng, float(difficulty), chosen),
        requested=requested or {},
    )
    sample.drawn["regime"] = chosen
    program = find_program(gesture, way)
    presses = program(sample)
    is_thing = gesture == "none" and way in NO_PERSON_KINDS
    label = find_label(gesture, site, constants)
    return TrueTouch(label, way, "" if is_thing else person.name, presses, sample.drawn)


def find_label(gesture: str, site: ContactSite, constants: Constants) -> str:
    """What a recogniser should say of a gesture at a site.

    A hand spread over what it cannot close round presses, it does not grab.
    """
    if gesture == "tap_many":
        return "double_pat"
    wide = np.isfinite(site.radius) and 2 * site.radius > constants.value("grab.widest")
    return "none" if gesture == "grab" and wide else gesture


def parse_regime(name: str) -> Regime:
    """A regime by its name."""
    return "paper" if name == "paper" else "cost"


def find_program(gesture: str, kind: str) -> Program:
    """What does a gesture."""
    if gesture == "none":
        return NONE_PROGRAMS[kind]
    return (
        GESTURE_PROGRAMS[gesture]
        if gesture in GESTURE_PROGRAMS
        else UNKNOWN_PROGRAMS[gesture]
    )


def choose_kind(
    gesture: str,
    kind: str | None,
    person: Person,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
) -> str:
    """The way of doing it that was asked for, or one drawn."""
    if gesture in UNKNOWN_PROGRAMS:
        allowed = [gesture]
    else:
        allowed = list(constants.weights(f"{gesture}.kinds"))
    if kind is not None and kind not in allowed:
        raise ValueError(
            f"no kind '{kind}' of {gesture}; choose from {', '.join(allowed)}, or None"
        )
    if gesture in UNKNOWN_PROGRAMS:
        return gesture
    return kind or choose_style(f"{gesture}.kinds", person, constants, rng, difficulty)
