"""What a touch has been so far, beyond what its contact graph shows."""

import numpy as np
from jaxtyping import Float

from eskin.touch import TouchState

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


def histories_of(state: TouchState) -> dict[int, Float[np.ndarray, "column"]]:
    """The history of each open touch, by its id."""
    touches, stamp = state.open_records, state.reading.stamp
    table = np.empty((len(touches), len(HISTORY)))
    table[:, 0] = (stamp - touches["onset"]) * NANOSECOND
    table[:, 1] = (stamp - touches["last"]) * NANOSECOND
    table[:, 2] = touches["contacts"]
    travel = np.linalg.norm(touches["latest"] - touches["start"], axis=1)
    table[:, 3] = travel * CM_PER_M
    table[:, 4] = touches["farthest"] * CM_PER_M
    table[:, 5] = touches["impulse"]
    table[:, 6] = touches["peak_force"]
    return dict(zip(touches["id"].tolist(), table, strict=True))
