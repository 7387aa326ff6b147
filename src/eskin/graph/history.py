"""What a touch has been so far, beyond what its contact graph shows."""

from math import dist

import numpy as np
from jaxtyping import Float

from eskin.touch.records import TouchRow

HISTORY = (
    "age",
    "pause",
    "contacts",
    "travel",
    "farthest",
    "impulse",
    "peak force",
)
"""Columns of a history: time since onset [s], since the last contact [s], how often it
made contact, distance from where it began, now and at most [cm], force integrated over
time [N s], greatest force [N]. On a skin that is not calibrated all are zero."""

CM_PER_M = 100.0
NANOSECOND = 1e-9
NOTHING = np.zeros(len(HISTORY))


def history_of(touch: TouchRow, stamp: int) -> Float[np.ndarray, "column"]:
    """The history of an open touch.

    Args:
        touch: as it is recorded.
        stamp: of the reading [ns since the epoch].
    """
    return np.array(
        [
            (stamp - touch.onset) * NANOSECOND,
            (stamp - touch.last) * NANOSECOND,
            touch.contacts,
            dist(touch.latest, touch.start) * CM_PER_M,
            touch.farthest * CM_PER_M,
            touch.impulse,
            touch.peak_force,
        ]
    )
