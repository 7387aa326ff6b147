"""Compiled crosstalk of one row-column array."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float

from eskin.compiled import compiled

LEAST = 1e-9
"""Conductance below which a detour is open."""


@compiled(error_model="numpy")
@no_type_check
def add_ghosts(
    conductance: Float[np.ndarray, "row column"],
    ghost: float,
    out: Float[np.ndarray, "row column"],
) -> None:
    """Add to each cell (i, j) a part of the detours by other columns and rows.

    All other rows are taken to be at one voltage, and all other columns. Then the
    detours are three conductances in series: the others of row i, all cells in neither
    row i nor column j, the others of column j. That is exact for evenly pressed blocks
    and for one detour, and never less than the network's own conductance.
    """
    rows, columns = conductance.shape
    along, across, total = np.zeros(rows), np.zeros(columns), 0.0
    for i in range(rows):
        for j in range(columns):
            cell = np.float64(conductance[i, j])
            along[i] += cell
            across[j] += cell
            total += cell
    for i in range(rows):
        for j in range(columns):
            own = np.float64(conductance[i, j])
            there, back = along[i] - own, across[j] - own
            between = total - along[i] - across[j] + own
            if there > LEAST and between > LEAST and back > LEAST:
                detours = 1.0 / (1.0 / there + 1.0 / between + 1.0 / back)
                out[i, j] += np.float32(ghost * detours)


@compiled(error_model="numpy")
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


@compiled(error_model="numpy")
@no_type_check
def read_array(
    conductance: Float[np.ndarray, "row column"],
    ghost: float,
    leak: float,
    out: Float[np.ndarray, "row column"],
) -> None:
    """What an array reads of its cells, all of it written to `out`."""
    out[:] = conductance
    if ghost > 0.0:
        add_ghosts(conductance, ghost, out)
    if leak > 0.0:
        add_leak(conductance, leak, out)
