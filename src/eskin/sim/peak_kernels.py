"""The largest pressure of readings, compiled."""

from typing import no_type_check

import numpy as np
from numba import njit

from eskin.touch.kernels import Bend, undo


@njit(cache=True)
@no_type_check
def largest_pressure(
    counts: np.ndarray,
    received: np.ndarray,
    rest: np.ndarray,
    gain: np.ndarray,
    bend: Bend,
) -> np.ndarray:
    """Largest pressure of each reading; of equal gains only the largest count matters.

    Args:
        counts: one row a reading.
        received: whether each is fresh.
        rest: counts of each taxel untouched.
        gain: of each taxel [kPa/count].
        bend: of the curve.
    """
    peaks = np.zeros(len(counts))
    for reading in range(len(counts)):
        most, most_gain = 0.0, 0.0
        for taxel in range(len(rest)):
            above = float(counts[reading, taxel] - rest[taxel])
            if not received[reading, taxel] or above <= 0.0:
                continue
            if gain[taxel] == most_gain and above <= most:
                continue
            pressure = undo(above, bend) * gain[taxel]
            if pressure > peaks[reading]:
                peaks[reading], most, most_gain = pressure, above, gain[taxel]
    return peaks
