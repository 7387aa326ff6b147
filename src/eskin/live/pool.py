"""The windows of all sequences of a stream, in one set of arrays."""

from typing import NamedTuple

import numpy as np

from eskin.live.head import HeadMemory, HeadWeights, head_memory

FREE = -1
"""In place of a key: no sequence uses the row."""

LONG_AGO = -(2**62)
"""Number of the slot of the reading before the first: nothing in a window is as old."""


class Pool(NamedTuple):
    """A row of memory for each sequence; whoever gets a row starts afresh."""

    keys: np.ndarray
    """(row) the sequence that uses it, or `FREE`."""
    slots: np.ndarray
    """(row) number of the slot of its latest reading."""
    memory: HeadMemory
    """(row, ...)"""


def fresh_pool(weights: HeadWeights, slots: int, rows: int) -> Pool:
    """Room for the windows of so many sequences."""
    return Pool(
        keys=np.full(rows, FREE, np.int64),
        slots=np.full(rows, LONG_AGO, np.int64),
        memory=head_memory(weights, slots, rows),
    )


def larger_pool(pool: Pool, weights: HeadWeights, rows: int) -> Pool:
    """The same windows with room for more."""
    slots = pool.memory.fine_seen.shape[1]
    larger = fresh_pool(weights, slots, rows)
    parts = (pool.keys, pool.slots, *pool.memory)
    new = (larger.keys, larger.slots, *larger.memory)
    for part, place in zip(parts, new, strict=True):
        place[: len(part)] = part
    return larger
