"""Compiled kernels that collect the taxels of each touch from the touch records."""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.structref_kernels import Packed

COLUMNS = 7  # of `eskin.graph.HISTORY`
CM_PER_M = 100.0
S_PER_NS = 1e-9


class TouchNodeArrays(NamedTuple):
    """These arrays hold the taxels and histories of all sequences at one reading.

    A span is the first index and the end.
    """

    keys: np.ndarray
    """(sequence) key of the sequence."""
    active: np.ndarray
    """(load) active taxels now, in the spans `now`."""
    earlier: np.ndarray
    """(load) active taxels one reading ago, in the spans `before`."""
    now: np.ndarray
    """(sequence, 2) span of its taxels in `active`."""
    before: np.ndarray
    """(sequence, 2) span of its taxels in `earlier`."""
    histories: np.ndarray
    """(sequence, column) its history so far."""


@compiled
@no_type_check
def collect_touch_nodes(packed_records: Packed, stamp: int) -> tuple[Packed, int]:
    """Return the taxels and the history of each open touch.

    Args:
        packed_records: `TouchRecords` of a reading.
        stamp: time of that reading [ns since the epoch].

    Returns:
        `TouchNodeArrays`, and the largest number of taxels of one touch, now and one
        reading ago together.
    """
    records = packed_records.parts
    touches, loads = records.touches, records.loads
    count = 0
    while count < len(touches) and not touches[count].closed:
        count += 1
    active, now = concatenate_spans(touches.loads[:count], loads)
    earlier, before = concatenate_spans(touches.before[:count], loads)
    keys, histories = np.empty(count, np.int64), np.empty((count, COLUMNS))
    most = 0
    for n in range(count):
        keys[n] = touches[n].id
        write_history(touches[n], stamp, histories[n])
        most = max(most, now[n, 1] - now[n, 0] + before[n, 1] - before[n, 0])
    nodes = TouchNodeArrays(keys, active, earlier, now, before, histories)
    return Packed(nodes), most


@compiled
@no_type_check
def concatenate_spans(
    spans: Int[np.ndarray, "touch 2"], loads: np.ndarray
) -> tuple[Int[np.ndarray, "load"], Int[np.ndarray, "touch 2"]]:
    """Return the taxels of some spans of loads one after another, and their spans."""
    total = 0
    for n in range(len(spans)):
        total += spans[n, 1] - spans[n, 0]
    taxels, found = np.empty(total, np.int64), np.empty((len(spans), 2), np.int64)
    end = 0
    for n in range(len(spans)):
        found[n, 0] = end
        for k in range(spans[n, 0], spans[n, 1]):
            taxels[end] = loads[k].taxel
            end += 1
        found[n, 1] = end
    return taxels, found


@compiled
@no_type_check
def write_history(touch: np.void, stamp: int, out: Float[np.ndarray, "column"]) -> None:
    """Write the columns `eskin.graph.HISTORY` of an open touch."""
    far = 0.0
    for d in range(3):
        far += (touch.latest[d] - touch.start[d]) ** 2
    out[0] = (stamp - touch.onset) * S_PER_NS
    out[1] = (stamp - touch.last) * S_PER_NS
    out[2] = touch.contacts
    out[3] = math.sqrt(far) * CM_PER_M
    out[4] = touch.farthest * CM_PER_M
    out[5], out[6] = touch.impulse, touch.peak_force
