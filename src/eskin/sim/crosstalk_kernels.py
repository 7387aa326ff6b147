"""Compiled crosstalk of one row-column array."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit

OPEN = np.float32(1e30)
"""Resistance of a cell that does not conduct."""


@njit(cache=True, error_model="numpy")
@no_type_check
def add_ghosts(
    conductance: Float[np.ndarray, "row column"],
    resistance: Float[np.ndarray, "row column"],
    ghost: float,
    out: Float[np.ndarray, "row column"],
) -> None:
    """Add to each cell the detours over three others, row i - l - row k - j.

    The innermost loop has no sum across its cells, so that it runs in vector units
    and gives the same bytes on all of them.
    """
    rows, columns = conductance.shape
    detours = np.empty(columns, np.float32)
    pair = np.empty(columns, np.float32)
    one, eps = np.float32(1.0), np.float32(ghost)
    for i in range(rows):
        detours[:] = 0.0
        for k in range(rows):
            if k == i:
                continue
            back = resistance[k]
            for j in range(columns):
                pair[j] = resistance[i, j] + back[j]
            for via in range(columns):
                if pair[via] >= OPEN:
                    continue
                there = pair[via]
                for j in range(columns):
                    detours[j] += one / (there + back[j])
                detours[via] -= one / (there + back[via])
        for j in range(columns):
            out[i, j] += eps * detours[j]


@njit(cache=True, error_model="numpy")
@no_type_check
def add_leak(
    conductance: Float[np.ndarray, "row column"],
    leak: float,
    out: Float[np.ndarray, "row column"],
) -> None:
    """Add to each cell a part of all others of its row and column."""
    rows, columns = conductance.shape
    along, across = np.zeros(rows, np.float32), np.zeros(columns, np.float32)
    for i in range(rows):
        for j in range(columns):
            along[i] += conductance[i, j]
            across[j] += conductance[i, j]
    part = np.float32(leak)
    for i in range(rows):
        for j in range(columns):
            own = conductance[i, j]
            out[i, j] += part * max(along[i] + across[j] - own - own, np.float32(0.0))


@njit(cache=True)
@no_type_check
def busy(flags: Int[np.ndarray, "line"], out: Int[np.ndarray, "line"]) -> int:
    """Write which lines are flagged to `out` and say how many."""
    count = 0
    for line in range(len(flags)):
        if flags[line]:
            out[count] = line
            count += 1
    return count


@njit(cache=True, error_model="numpy")
@no_type_check
def read_array(
    conductance: Float[np.ndarray, "row column"],
    ghost: float,
    leak: float,
    out: Float[np.ndarray, "row column"],
) -> None:
    """What an array reads of its cells, all of it written to `out`.

    Only rows and columns with a cell that conducts are computed.
    """
    out[:] = conductance
    rows, columns = conductance.shape
    in_row, in_column = np.zeros(rows, np.uint8), np.zeros(columns, np.uint8)
    for i in range(rows):
        for j in range(columns):
            if conductance[i, j] > 0.0:
                in_row[i] = in_column[j] = 1
    row, column = np.empty(rows, np.int64), np.empty(columns, np.int64)
    some_rows, some_columns = busy(in_row, row), busy(in_column, column)
    if some_rows == 0:
        return
    if ghost > 0.0 and some_rows > 1 and some_columns > 1:
        small = np.empty((some_rows, some_columns), np.float32)
        resistance = np.empty((some_rows, some_columns), np.float32)
        read = np.zeros((some_rows, some_columns), np.float32)
        for a in range(some_rows):
            for b in range(some_columns):
                cell = conductance[row[a], column[b]]
                small[a, b] = cell
                resistance[a, b] = np.float32(1.0) / cell if cell > 0.0 else OPEN
        add_ghosts(small, resistance, ghost, read)
        for a in range(some_rows):
            for b in range(some_columns):
                out[row[a], column[b]] += read[a, b]
    if leak > 0.0:
        add_leak(conductance, leak, out)
