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
    """Find the largest pressure of each reading, for taxels of gain one.

    Pressure grows with the counts above rest, so only the largest is looked up.

    Args:
        counts: counts, one row for each reading (int32).
        received: whether each count is fresh.
        rest: counts of each taxel untouched (int32).
        curve: curve from counts to pressure.
    """
    peaks = np.zeros(len(counts))
    for reading in range(len(counts)):
        most = np.int32(0)
        for taxel in range(len(rest)):
            above = np.int32(counts[reading, taxel] - rest[taxel])
            most = max(most, np.int32(above * received[reading, taxel]))
        peaks[reading] = linearise_counts(float(most), curve)
    return peaks
