"""Compiled kernels that weigh the evidence of a contact that it is no noise."""

from typing import no_type_check

import numpy as np

from eskin.compiled import compiled
from eskin.touch.fault_kernels import CLEAR_FACTOR, MAX_STEP_INTERVAL
from eskin.touch.records import KernelReading, TrackerContext
from eskin.touch.track_kernels import RecordBuffer
from eskin.units import NS_PER_S

SLOW_NS = round(MAX_STEP_INTERVAL * NS_PER_S)
"""Time between two readings from which a touch may last for one of them [ns]."""
FADE_SECONDS = 2.0
"""Time constant with which the evidence of a track fades [s]: what has given none for
some seconds may be a taxel that does not return to its rest, and joins no other."""
MIN_NOISE = 0.1
"""Smallest pressure that is taken for noise [kPa]."""


@compiled
@no_type_check
def weigh_contact(
    contact: np.void,
    reading: KernelReading,
    context: TrackerContext,
    buffer: RecordBuffer,
) -> float:
    """Return the evidence of a contact in one reading that it is no noise.

    Each taxel adds the logarithm of its pressure in units of its noise, within limits.
    Where only one of them is well above its noise, that counts only while its pressure
    rises above what it was before, since the offset of a taxel may jump, and then stays
    or swings. In readings without noise every contact is evidence enough.
    """
    parameters, state = context.parameters, context.state
    evidence, clear, strongest, changed = 0.0, 0, 0.0, False
    span = contact.loads
    for k in range(span[0], span[1]):
        load = buffer.loads[k]
        if reading.floor[load.taxel] == 0.0:
            return np.inf
        noise = max(reading.floor[load.taxel], MIN_NOISE)
        strength = np.log(max(load.pressure / noise, 1.0))
        strength = min(strength, parameters.max_taxel_llr)
        evidence += strength
        clear += load.pressure >= CLEAR_FACTOR * noise
        if strength > strongest:
            strongest, changed = strength, state.taxels[load.taxel].changed
    return evidence if clear > 1 or changed else 0.0
