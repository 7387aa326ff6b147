"""This module performs a gesture: from its name to what presses where."""

from collections.abc import Callable

import numpy as np

from eskin.sim.constants import Constants
from eskin.sim.contact.press import Press, Site, TrueTouch
from eskin.sim.people.gesture_sample import Act, Regime, pick
from eskin.sim.people.gestures import double_pat, grab, poke, stroke, tap_many
from eskin.sim.people.non_gestures import (
    brush,
    bump,
    cable,
    guiding,
    lean,
    press,
    resting_hand,
    rub,
    self_contact,
    single_pat,
    squeeze,
    squeeze_hold,
    tickle,
)
from eskin.sim.people.person import Person

Program = Callable[[Act], tuple[Press, ...]]


def untouched(act: Act) -> tuple[Press, ...]:
    """Nothing presses."""
    return ()


STYLED: dict[str, Program] = {
    "poke": poke,
    "double_pat": double_pat,
    "grab": grab,
    "stroke": stroke,
}
NOTHING: dict[str, Program] = {
    "idle": untouched,
    "resting_hand": resting_hand,
    "lean": lean,
    "bump": bump,
    "single_pat": single_pat,
    "press": press,
    "squeeze_hold": squeeze_hold,
    "brush": brush,
    "cable": cable,
    "self_contact": self_contact,
    "guiding": guiding,
    "electrical": untouched,
}
UNKNOWN: dict[str, Program] = {
    "rub": rub,
    "tickle": tickle,
    "squeeze": squeeze,
    "tap_many": tap_many,
}
GESTURES = (*STYLED, "none", *UNKNOWN)
"""What can be performed."""

NOBODY = ("idle", "cable", "self_contact", "electrical")
"""Kinds that nobody does."""


def perform(
    gesture: str,
    kind: str | None,
    person: Person,
    site: Site,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
    regime: Regime | None,
    asked: dict[str, float] | None = None,
) -> TrueTouch:
    """One touch by a person at a site, from step 0 of its own clock.

    Args:
        gesture: one of `GESTURES`; `tap_many` counts as a double pat.
        kind: way of doing it; None draws one.
        person: who touches.
        site: where.
        constants: numbers of the world.
        rng: to draw from.
        difficulty: lambda; 0 is the easiest, 1.5 usual.
        regime: how long touches last; None draws one.
        asked: what is to be so whatever is drawn, by the name that it is noted by,
            such as `force` [N] and `duration` [s].

    Raises:
        ValueError: there is no such gesture, or no such way of doing it.
    """
    if gesture not in GESTURES:
        raise ValueError(f"no gesture '{gesture}'; choose from {', '.join(GESTURES)}")
    if difficulty < 0:
        raise ValueError(f"difficulty is {difficulty}; give 0 or more")
    chosen = regime or regime_of(constants.choose("duration.regime", rng))
    way = kind_of(gesture, kind, person, constants, rng, difficulty)
    act = Act(
        *(way, person, site, constants, rng, float(difficulty), chosen),
        asked=asked or {},
    )
    act.drawn["regime"] = chosen
    program = program_of(gesture, way)
    presses = program(act)
    nobody = gesture == "none" and way in NOBODY
    label = meaning_of(gesture, site, constants)
    return TrueTouch(label, way, "" if nobody else person.name, presses, act.drawn)


def meaning_of(gesture: str, site: Site, constants: Constants) -> str:
    """What a recogniser should say of a gesture at a site.

    A hand spread over what it cannot close round presses, it does not grab.
    """
    if gesture == "tap_many":
        return "double_pat"
    wide = np.isfinite(site.radius) and 2 * site.radius > constants.value("grab.widest")
    return "none" if gesture == "grab" and wide else gesture


def regime_of(name: str) -> Regime:
    """A regime by its name."""
    return "paper" if name == "paper" else "cost"


def program_of(gesture: str, kind: str) -> Program:
    """What does a gesture."""
    if gesture == "none":
        return NOTHING[kind]
    return STYLED[gesture] if gesture in STYLED else UNKNOWN[gesture]


def kind_of(
    gesture: str,
    kind: str | None,
    person: Person,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
) -> str:
    """The way of doing it that was asked for, or one drawn."""
    if gesture in UNKNOWN:
        allowed = [gesture]
    else:
        allowed = list(constants.weights(f"{gesture}.kinds"))
    if kind is not None and kind not in allowed:
        raise ValueError(
            f"no kind '{kind}' of {gesture}; choose from {', '.join(allowed)}, or None"
        )
    if gesture in UNKNOWN:
        return gesture
    return kind or pick(f"{gesture}.kinds", person, constants, rng, difficulty)
