"""This module performs a gesture by its name: it draws the presses of one touch."""

from collections.abc import Callable

import numpy as np

from eskin.sim.constants import Constants
from eskin.sim.contact.press import ContactSite, Press, TrueTouch
from eskin.sim.people.bumps import draw_bump
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
    """Return no press."""
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
    "rub": draw_rub,
    "tickle": draw_tickle,
}
UNKNOWN_PROGRAMS: dict[str, Program] = {
    "rub": draw_rub,
    "tickle": draw_tickle,
    "squeeze": draw_squeeze,
    "tap_many": draw_many_taps,
}
PERFORMABLE = (*GESTURE_PROGRAMS, "none", *UNKNOWN_PROGRAMS)
"""Names of everything that can be performed."""

NO_PERSON_KINDS = ("idle", "cable", "self_contact", "electrical")
"""Kinds of contact that no person makes."""

STANDING_KINDS = ("brush", "cable")
"""Kinds of contact with what stands in the world; only the robot slides."""


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
    """Draw one touch by a person at a site, from step 0 of its own clock.

    Args:
        gesture: one of `PERFORMABLE`; `tap_many` counts as a double pat.
        kind: variant of the gesture; None draws one.
        person: person who touches.
        site: site of the touch.
        constants: constants of the simulation.
        rng: random generator.
        difficulty: lambda; 0 is the easiest, 1.5 usual.
        regime: law of durations; None draws one.
        requested: values that replace what is drawn, by the name that they are recorded
            under, such as `force` [N] and `duration` [s].

    Raises:
        ValueError: there is no such gesture, or no such variant.
    """
    if gesture not in PERFORMABLE:
        raise ValueError(
            f"no gesture '{gesture}'; choose from {', '.join(PERFORMABLE)}"
        )
    if difficulty < 0:
        raise ValueError(f"difficulty is {difficulty}; give 0 or more")
    drawn = regime or constants.choose("duration.regime", rng)
    chosen: Regime = "paper" if drawn == "paper" else "cost"
    variant = choose_kind(gesture, kind, person, constants, rng, difficulty)
    sample = GestureSample(
        variant,
        person,
        site,
        constants,
        rng,
        float(difficulty),
        chosen,
        requested=requested or {},
    )
    sample.drawn["regime"] = chosen
    if gesture == "none":
        presses = NONE_PROGRAMS[variant](sample)
    else:
        presses = (GESTURE_PROGRAMS | UNKNOWN_PROGRAMS)[gesture](sample)
    is_thing = gesture == "none" and variant in NO_PERSON_KINDS
    label = find_label(gesture, site, constants)
    return TrueTouch(
        label, variant, "" if is_thing else person.name, presses, sample.drawn
    )


def find_label(gesture: str, site: ContactSite, constants: Constants) -> str:
    """Return the label that a recogniser should give to a gesture at a site.

    A hand spread over what it cannot close round presses, it does not grab.
    """
    if gesture == "tap_many":
        return "double_pat"
    wide = np.isfinite(site.radius) and 2 * site.radius > constants.value("grab.widest")
    return "none" if gesture == "grab" and (wide or not site.can_close) else gesture


def choose_kind(
    gesture: str,
    kind: str | None,
    person: Person,
    constants: Constants,
    rng: np.random.Generator,
    difficulty: float,
) -> str:
    """Return the variant that is asked for, or draw one."""
    is_unknown = gesture in UNKNOWN_PROGRAMS
    allowed = [gesture] if is_unknown else [*constants.weights(f"{gesture}.kinds")]
    if gesture == "none":
        allowed = list(NONE_PROGRAMS)
    if kind is not None and kind not in allowed:
        raise ValueError(
            f"no kind '{kind}' of {gesture}; choose from {', '.join(allowed)}, or None"
        )
    if is_unknown:
        return gesture
    return kind or choose_style(f"{gesture}.kinds", person, constants, rng, difficulty)
