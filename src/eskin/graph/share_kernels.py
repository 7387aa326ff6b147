"""From the records of touches to what each of them has a share of, compiled."""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.graph.batch import CM_PER_M, HISTORY, NANOSECOND
from eskin.graph.shares import Shares
from eskin.structref_kernels import Packed

COLUMNS = len(HISTORY)


@compiled
@no_type_check
def shares_of(packed_records: Packed, stamp: int) -> tuple[Packed, int]:
    """The share of each open touch.

    Args:
        packed_records: `TouchRecords` of a reading.
        stamp: of that reading [ns since the epoch].

    Returns:
        `Shares`, and the taxels of one touch at most, now and a reading ago together.
    """
    records = packed_records.parts
    touches, loads = records.touches, records.loads
    count = 0
    while count < len(touches) and not touches[count].closed:
        count += 1
    active, now = spans_of(touches.loads[:count], loads)
    earlier, before = spans_of(touches.before[:count], loads)
    keys, histories = np.empty(count, np.int64), np.empty((count, COLUMNS))
    most = 0
    for n in range(count):
        keys[n] = touches[n].id
        write_history(touches[n], stamp, histories[n])
        most = max(most, now[n, 1] - now[n, 0] + before[n, 1] - before[n, 0])
    shares = Shares(keys, active, earlier, now, before, histories)
    return Packed(shares), most


@compiled
@no_type_check
def spans_of(
    spans: Int[np.ndarray, "touch 2"], loads: np.ndarray
) -> tuple[Int[np.ndarray, "load"], Int[np.ndarray, "touch 2"]]:
    """The taxels of some spans of loads, one after another, and their spans now."""
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
    """Write the history of an open touch, as in `eskin.graph.batch.HISTORY`."""
    far = 0.0
    for d in range(3):
        far += (touch.latest[d] - touch.start[d]) ** 2
    out[0] = (stamp - touch.onset) * NANOSECOND
    out[1] = (stamp - touch.last) * NANOSECOND
    out[2] = touch.contacts
    out[3] = math.sqrt(far) * CM_PER_M
    out[4] = touch.farthest * CM_PER_M
    out[5], out[6] = touch.impulse, touch.peak_force
