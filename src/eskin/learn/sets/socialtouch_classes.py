"""This module says which of the paper's classes a SocialTouch repetition shows."""

import numpy as np
from jaxtyping import Float

from eskin.learn.sets.socialtouch import GESTURES, Repetition
from eskin.recording.records import NONE

GROUP_NUMBERS = {
    "contact": (0, 1),
    "finger touch": (2, 3, 4, 5),
    "poke": (6, 7),
    "pat": (8, 9),
    "pinch": (10, 11),
    "tap": (12, 13, 29),
    "hit": (14, 15, 16, 17),
    "stroke": (18, 19, 20, 27, 28),
    "caress": (21, 30),
    "tickle": (22, 23, 24),
    "arm": (25, 26),
    "hug": (31,),
}
GROUPS = {
    name: tuple(GESTURES[number] for number in numbers)
    for name, numbers in GROUP_NUMBERS.items()
}
"""Gestures that are variants of one another, by the name of their group."""

HELD = 1.3
"""Duration from which a touch of a finger is held rather than a poke [s]."""

VALLEY = 0.5
"""Share of the lower of two peaks of force below which two presses are separate."""

LEAST_PRESS = 0.25
"""Share of the strongest press below which a rise of force is no press."""


def find_group(gesture: str) -> str:
    """Return the group of a gesture."""
    return next(name for name, gestures in GROUPS.items() if gesture in gestures)


def classify_repetition(repetition: Repetition) -> str | None:
    """Return the class of a repetition; None without one, or without contact."""
    touched = repetition.seconds[repetition.touched]
    if not len(touched):
        return None
    match find_group(repetition.gesture):
        case "poke":
            return "poke"
        case "stroke":
            return "stroke"
        case "contact" | "arm":
            return NONE
        case "finger touch":
            return NONE if np.ptp(touched) >= HELD else None
        case "pat":
            total = repetition.counts.sum(axis=1).astype(np.float64)
            return "double_pat" if count_presses(total) > 1 else NONE
    return None


def count_presses(force: Float[np.ndarray, "reading"]) -> int:
    """Count the presses in a series of forces, with low forces between them."""
    # Importing it takes as long as all else that the simulator imports.
    from scipy.signal import find_peaks, peak_prominences

    if force.max(initial=0.0) <= 0.0:
        return 0
    # Of equal peaks the later one counts as higher, so that one of them is the lower.
    padded = np.pad(force + 1e-9 * np.arange(len(force)), 1)
    peaks, _ = find_peaks(padded, height=LEAST_PRESS * force.max())
    prominences, _, _ = peak_prominences(padded, peaks)
    return int((prominences > (1 - VALLEY) * padded[peaks]).sum())
