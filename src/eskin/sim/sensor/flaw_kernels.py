"""Compiled kernels that add the flaws of families to conductance, levels and counts."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.sim.sensor.kernels import TaxelArrays


class Release(NamedTuple):
    """This tuple holds how the signal of live taxels lags and what a release leaves."""

    rise_part: float
    """Part of the way up in one step."""
    fall_part: float
    """Part of the way down in one step."""
    residue: float
    """Part of the creep that a released taxel still shows."""
    creep: np.ndarray
    """Relative growth by each process of creep (live, process)."""
    creep_part: np.ndarray
    """Part of the way of each process in one step (process)."""


class ReleaseState(NamedTuple):
    """This tuple holds what live taxels keep between calls of `lag_conductance`."""

    signal: np.ndarray
    """Conductance that the taxel shows (live)."""
    crept: np.ndarray
    """Conductance by each process of creep (live, process)."""


@compiled(error_model="numpy")
@no_type_check
def lag_conductance(
    release: Release, state: ReleaseState, conductance: Float[np.ndarray, "time live"]
) -> None:
    """Let conductance rise and fall slowly, and leave a residue; in place."""
    steps, live = conductance.shape
    processes = len(release.creep_part)
    for a in range(live):
        signal = state.signal[a]
        crept = state.crept[a]
        for t in range(steps):
            x = np.float64(conductance[t, a])
            part = release.rise_part if x > signal else release.fall_part
            signal += part * (x - signal)
            left = 0.0
            for k in range(processes):
                crept[k] += release.creep_part[k] * (release.creep[a, k] * x - crept[k])
                left += crept[k]
            shown = max(signal, release.residue * left)
            if x == 0.0 and shown < MIN_SHOWN:
                signal = 0.0
                shown = 0.0
                crept[:] = 0.0
            conductance[t, a] = shown
        state.signal[a] = signal


MIN_SHOWN = 1e-6
"""Conductance below which a free taxel shows none; less than any converter resolves."""


class Coupling(NamedTuple):
    """This tuple holds how much of other taxels a taxel reads."""

    neighbours: float
    column_leak: float
    row_leak: float


@compiled(error_model="numpy")
@no_type_check
def couple_levels(
    coupling: Coupling, arrays: TaxelArrays, level: Float[np.ndarray, "reading taxel"]
) -> None:
    """Add to each taxel parts of its neighbours, its column and its row; in place."""
    for m in range(len(arrays.patch)):
        rows, columns = arrays.rows[m], arrays.columns[m]
        taxel = arrays.taxel[m]
        cells = np.zeros((rows + 2, columns + 2), np.float32)
        for r in range(len(level)):
            along = np.zeros(rows, np.float32)
            across = np.zeros(columns, np.float32)
            total = np.float32(0.0)
            for i in range(rows):
                for j in range(columns):
                    x = np.float32(0.0)
                    if taxel[i, j] >= 0:
                        x = level[r, taxel[i, j]]
                    cells[i + 1, j + 1] = x
                    along[i] += x
                    across[j] += x
                    total += x
            if total == 0.0:
                continue
            for i in range(rows):
                for j in range(columns):
                    if taxel[i, j] < 0:
                        continue
                    x = cells[i + 1, j + 1]
                    near = cells[i, j + 1] + cells[i + 2, j + 1]
                    near += cells[i + 1, j] + cells[i + 1, j + 2]
                    level[r, taxel[i, j]] = (
                        x
                        + np.float32(coupling.neighbours) * near
                        + np.float32(coupling.column_leak) * (across[j] - x)
                        + np.float32(coupling.row_leak) * (along[i] - x)
                    )


class Drift(NamedTuple):
    """This tuple holds how readings at rest move, relative to full scale."""

    keep: np.ndarray
    """Part of each slow process that is kept from one reading to the next (process)."""
    step: np.ndarray
    """Size of its random steps (process)."""
    warming: np.ndarray
    """Growth with temperature in one reading (taxel)."""
    line: np.ndarray
    """Number of each taxel's row (taxel)."""
    line_noise: np.ndarray
    """Deviation of the noise that its row shares (taxel)."""


@compiled(error_model="numpy")
@no_type_check
def move_rest(
    drift: Drift,
    words: Int[np.ndarray, "reading process word"],
    shared: Float[np.ndarray, "reading line"],
    slow: Float[np.ndarray, "process taxel"],
    offset: Float[np.ndarray, "taxel"],
    out: Float[np.ndarray, "reading taxel"],
) -> None:
    """Write how far readings at rest have moved.

    Args:
        drift: how they move.
        words: random words, of which each bit is the direction of one step of a taxel.
        shared: standard normal noise of each row.
        slow: slow processes, updated in place.
        offset: shift by temperature, updated in place.
        out: shifts, written.
    """
    one = np.uint64(1)
    for r in range(len(out)):
        for i in range(out.shape[1]):
            offset[i] += drift.warming[i]
            out[r, i] = offset[i] + drift.line_noise[i] * shared[r, drift.line[i]]
        for k in range(len(drift.keep)):
            keep = np.float32(drift.keep[k])
            step = np.float32(drift.step[k])
            for i in range(out.shape[1]):
                is_up = (words[r, k, i >> 6] >> np.uint64(i & 63)) & one
                moved = keep * slow[k, i] + (step if is_up else -step)
                slow[k, i] = moved
                out[r, i] += moved


@compiled
@no_type_check
def repeat_readings(
    again: Int[np.ndarray, "reading patch"],
    patch: Int[np.ndarray, "taxel"],
    last: Int[np.ndarray, "taxel"],
    counts: Int[np.ndarray, "reading taxel"],
) -> None:
    """Give patches the counts of their last reading again; both arrays in place."""
    for r in range(len(counts)):
        for i in range(counts.shape[1]):
            if again[r, patch[i]] and last[i] >= 0:
                counts[r, i] = last[i]
            last[i] = counts[r, i]
