"""What a touch has been so far, beyond what its contact graph shows."""

import numpy as np

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
