"""Compiled kernels that find the largest pressure of readings."""

from typing import no_type_check

import numpy as np

from eskin.compiled import compiled
from eskin.touch.calibration_kernels import PressureCurve, linearise_counts


@compiled
@no_type_check
def find_largest_pressure(
    counts: np.ndarray, received: np.ndarray, rest: np.ndarray, curve: PressureCurve
) -> np.ndarray:
    """Largest pressure of each reading for a gain of one, of taxels of one gain.

    Pressure grows with the counts above rest, so only the largest is looked up.

    Args:
        counts: one row a reading (int32).
        received: whether each is fresh.
        rest: counts of each taxel untouched (int32).
        curve: of the curve.
    """
    peaks = np.zeros(len(counts))
    for reading in range(len(counts)):
        most = np.int32(0)
        for taxel in range(len(rest)):
            above = np.int32(counts[reading, taxel] - rest[taxel])
            most = max(most, np.int32(above * received[reading, taxel]))
        peaks[reading] = linearise_counts(float(most), curve)
    return peaks
