"""This compiled kernel finds the largest pressure of each reading."""

from typing import no_type_check

import numpy as np

from eskin.compiled import compiled
from eskin.touch.calibration_kernels import PressureCurve, linearise_counts


@compiled
@no_type_check
def find_largest_pressure(
    counts: np.ndarray, received: np.ndarray, rest: np.ndarray, curve: PressureCurve
) -> np.ndarray:
    """Find the largest pressure of each reading, for taxels of gain one [kPa].

    Pressure rises with the counts above rest, so only the largest is converted.

    Args:
        counts: counts (reading, taxel), int32.
        received: whether each count was received (reading, taxel).
        rest: counts at rest (taxel), int32.
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
