"""Compiled kernels that relate counts and pressure."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from eskin.compiled import compiled

Values = Float[np.ndarray, "taxel"]


class PressureCurve(NamedTuple):
    """A curve holds the relation of pressure and counts; see `Calibration`."""

    full_scale: float
    """Counts at which the device saturates; infinite for a linear one."""
    exponent: float
    """Exponent of conductance over pressure; 1 for a linear device."""
    unfelt: float
    """Pressure that closes the sensor without a change of the counts [kPa]."""
    span: float
    """Range of a logarithmic converter; 0 for other devices."""


MAX_SCALE_SHARE = 0.999
"""Fraction of a divider's full scale above which pressures are indistinguishable."""


@compiled
def linearise_counts(above: float, curve: PressureCurve) -> float:
    """Return the counts above rest that a linear device of the same gain would give."""
    if above <= 0.0 or curve.full_scale == np.inf:
        return max(above, 0.0)
    if curve.span > 0.0:
        share = min(above / curve.full_scale, 1.0)
        conductance = math.expm1(share * math.log1p(curve.span)) / curve.span
    else:
        share = min(above / curve.full_scale, MAX_SCALE_SHARE)
        conductance = share / (1.0 - share)
    if curve.exponent != 1.0:
        # Pressures are kept in float32, whose powers take a third of the time.
        exponent = np.float32(1.0 / curve.exponent)
        conductance = float(np.float32(conductance) ** exponent)
    return curve.full_scale * conductance


@compiled
def compute_felt(pressure: float, curve: PressureCurve) -> float:
    """Return the part of a pressure that changes the counts [kPa]."""
    return max(pressure - curve.unfelt, 0.5 * pressure)


@compiled
def add_unfelt(felt: float, curve: PressureCurve) -> float:
    """Return the pressure of which a part changes the counts [kPa]."""
    return felt + min(felt, curve.unfelt)


@compiled
def compute_pressures(
    above: Values, gain: Values, curve: PressureCurve, out: Values
) -> None:
    """Write the pressures [kPa] at counts above rest."""
    for i in range(len(above)):
        out[i] = add_unfelt(linearise_counts(above[i], curve) * gain[i], curve)


@compiled
def compute_counts(
    pressure: Values, gain: Values, curve: PressureCurve, out: Values
) -> None:
    """Write the counts above rest at pressures [kPa]."""
    scale = curve.full_scale
    for i in range(len(pressure)):
        out[i] = compute_felt(pressure[i], curve) / gain[i]
        if scale < np.inf:
            conductance = (out[i] / scale) ** curve.exponent
            if curve.span > 0.0:
                grown = math.log1p(curve.span * conductance)
                out[i] = scale * grown / math.log1p(curve.span)
            else:
                out[i] = scale * conductance / (1.0 + conductance)
