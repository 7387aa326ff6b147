"""Compiled kernels that collect the taxels of each touch from the touch records."""

# pyright: reportAttributeAccessIssue=false
# Fields of records and of packed tuples are known to numba only.

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import Packed, compiled

COLUMNS = 7  # length of `eskin.live.HISTORY`
CM_PER_M = 100.0
S_PER_NS = 1e-9


class TouchNodeArrays(NamedTuple):
    """These arrays hold the taxels and histories of all sequences at one reading.

    A span is the first index and the end of a sequence's taxels.
    """

    keys: Int[np.ndarray, "sequence"]
    active: Int[np.ndarray, "load"]  # active taxels now, sequence after sequence
    earlier: Int[np.ndarray, "load"]  # active taxels one reading ago
    active_spans: Int[np.ndarray, "sequence 2"]
    earlier_spans: Int[np.ndarray, "sequence 2"]
    histories: Float[np.ndarray, "sequence column"]


@compiled
def collect_touch_nodes(packed_records: Packed, stamp: int) -> tuple[Packed, int]:
    """Return the taxels and the history of each open touch.

    Args:
        packed_records: `TouchRecords` of a reading.
        stamp: time of that reading [ns since the epoch].

    Returns:
        Packed `TouchNodeArrays`, and the largest number of taxels of one touch, now and
        one reading ago together.
    """
    records = packed_records.parts
    touches, loads = records.touches, records.loads
    count = 0
    while count < len(touches) and not touches[count].closed:
        count += 1
    active, now = concatenate_spans(touches.loads[:count], loads)
    earlier, before = concatenate_spans(touches.before[:count], loads)
    keys, histories = np.empty(count, np.int64), np.empty((count, COLUMNS))
    max_taxels = 0
    for n in range(count):
        keys[n] = touches[n].id
        write_history(touches[n], stamp, histories[n])
        taxels = now[n, 1] - now[n, 0] + before[n, 1] - before[n, 0]
        max_taxels = max(max_taxels, taxels)
    nodes = TouchNodeArrays(keys, active, earlier, now, before, histories)
    return Packed(nodes), max_taxels


@compiled
def concatenate_spans(
    spans: Int[np.ndarray, "touch 2"], loads: np.ndarray
) -> tuple[Int[np.ndarray, "load"], Int[np.ndarray, "touch 2"]]:
    """Copy the taxels of spans of loads into one array; return it and its spans."""
    total = 0
    for n in range(len(spans)):
        total += spans[n, 1] - spans[n, 0]
    taxels, new_spans = np.empty(total, np.int64), np.empty((len(spans), 2), np.int64)
    end = 0
    for n in range(len(spans)):
        new_spans[n, 0] = end
        for k in range(spans[n, 0], spans[n, 1]):
            taxels[end] = loads[k].taxel
            end += 1
        new_spans[n, 1] = end
    return taxels, new_spans


@compiled
def write_history(touch: np.void, stamp: int, out: Float[np.ndarray, "column"]) -> None:
    """Write the columns `eskin.live.HISTORY` of an open touch."""
    squared = 0.0
    for d in range(3):
        squared += (touch.latest[d] - touch.start[d]) ** 2
    out[0] = (stamp - touch.onset) * S_PER_NS
    out[1] = (stamp - touch.last) * S_PER_NS
    out[2] = touch.contacts
    out[3] = math.sqrt(squared) * CM_PER_M
    out[4] = touch.farthest * CM_PER_M
    out[5], out[6] = touch.impulse, touch.peak_force
