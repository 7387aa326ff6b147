"""Compiled kernels that simulate the sensor over time and taxels."""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled

MIN_DETOUR_CONDUCTANCE = 1e-9
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
    along = np.zeros(rows)
    across = np.zeros(columns)
    total = 0.0
    for i in range(rows):
        for j in range(columns):
            cell = np.float64(conductance[i, j])
            along[i] += cell
            across[j] += cell
            total += cell
    for i in range(rows):
        for j in range(columns):
            own = np.float64(conductance[i, j])
            there = along[i] - own
            back = across[j] - own
            between = total - along[i] - across[j] + own
            if (
                there > MIN_DETOUR_CONDUCTANCE
                and between > MIN_DETOUR_CONDUCTANCE
                and back > MIN_DETOUR_CONDUCTANCE
            ):
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
    along = np.zeros(rows, np.float32)
    across = np.zeros(columns, np.float32)
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
    """Write to `out` what an array reads of its cells."""
    out[:] = conductance
    if ghost > 0.0:
        add_ghosts(conductance, ghost, out)
    if leak > 0.0:
        add_leak(conductance, leak, out)


class SensorLayer(NamedTuple):
    """This tuple holds the laminate under the live taxels for `update_conductance`."""

    load: np.ndarray
    """Load of an untouched taxel less its activation, by half pressure; negative
    where the gap is open (live)."""
    half_pressure: float
    exponent: np.ndarray
    gain: np.ndarray
    play_widths: np.ndarray
    play_weights: np.ndarray
    play_min_load: float
    creep: np.ndarray
    """Relative growth under lasting load (live, process)."""
    creep_part: np.ndarray
    """Part of the way to full creep in one step (process)."""
    recovery_keep: np.ndarray
    """Part of creep that is kept in one step after release (fast, slow)."""
    recovery_share: float
    after: np.ndarray
    """Shifts of the baseline after each touch, in turn (touch, live)."""
    after_whole: float
    after_keep: np.ndarray
    """Part of such a shift that is kept in one step (live)."""


class LayerState(NamedTuple):
    """This tuple holds what live taxels keep between calls of `update_conductance`."""

    play_positions: np.ndarray
    """Positions of the play operators (live, operator)."""
    creep: np.ndarray
    """Shares of full creep (live, process)."""
    slow_creep: np.ndarray
    """Share of creep that decays slowly after release (live, process)."""
    max_load: np.ndarray
    """Largest load of the touch (live)."""
    play_output: np.ndarray
    """Output of the operators at the last load (live)."""
    power: np.ndarray
    """Output of the operators to the power of the exponent (live)."""
    peak: np.ndarray
    """Largest signal of the touch, by full scale (live)."""
    baseline_shift: np.ndarray
    """Shift of the baseline, by full scale (live)."""
    touches: np.ndarray
    """Number of touches that are over (live)."""
    loaded: np.ndarray
    """Whether the taxel conducts (live)."""
    touched: np.ndarray
    """Whether the taxel is touched (live)."""


MIN_STATE = 1e-30
"""Size below which state is set to zero, since denormal numbers are slow."""


@compiled(error_model="numpy")
@no_type_check
def update_conductance(
    pressure: Float[np.ndarray, "time active"],
    column: Int[np.ndarray, "live"],
    layer: SensorLayer,
    state: LayerState,
    conductance: Float[np.ndarray, "time live"],
    shift: Float[np.ndarray, "time live"],
) -> None:
    """Write conductance and the shift of the baseline of each live taxel.

    Args:
        pressure: pressure of the active taxels [kPa].
        column: column of each live taxel in `pressure`, -1 if it is never touched.
        layer: laminate.
        state: state after the steps before, updated in place.
        conductance: written; 1 is half scale.
        shift: written, relative to full scale.
    """
    steps, live = conductance.shape
    operators = len(layer.play_widths)
    processes = len(layer.creep_part)
    for a in range(live):
        positions = state.play_positions[a]
        crept = state.creep[a]
        slow = state.slow_creep[a]
        rest = max(layer.load[a], 0.0)
        largest = state.max_load[a]
        loaded = state.loaded[a]
        touched = state.touched[a]
        last_output = state.play_output[a]
        power = state.power[a]
        peak = state.peak[a]
        shifted = state.baseline_shift[a]
        touches = state.touches[a]
        for t in range(steps):
            push = pressure[t, column[a]] if column[a] >= 0 else 0.0
            q = max(layer.load[a] + push / layer.half_pressure, 0.0)
            shifted *= layer.after_keep[a]
            if abs(shifted) < MIN_STATE:
                shifted = 0.0
            is_touched = push > 0.0 and q > 0.0
            if touched and not is_touched:
                share = min(peak / layer.after_whole, 1.0)
                shifted += share * layer.after[touches % len(layer.after), a]
                touches += 1
                peak = 0.0
                largest = max(rest, layer.play_min_load)
            touched = is_touched
            if q == 0.0:
                if loaded:
                    for k in range(processes):
                        slow[k] = (1.0 - layer.recovery_share) * crept[k]
                        crept[k] *= layer.recovery_share
                    positions[:] = 0.0
                    loaded = False
                for k in range(processes):
                    crept[k] *= layer.recovery_keep[0]
                    slow[k] *= layer.recovery_keep[1]
                    if crept[k] < MIN_STATE:
                        crept[k] = 0.0
                    if slow[k] < MIN_STATE:
                        slow[k] = 0.0
                conductance[t, a] = 0.0
                shift[t, a] = shifted
                continue
            if not loaded:
                for k in range(processes):
                    crept[k] += slow[k]
                    slow[k] = 0.0
                loaded = True
            largest = max(largest, q)
            output = 0.0
            for j in range(operators):
                width = layer.play_widths[j] * largest
                positions[j] = max(q - width, min(q + width, positions[j]))
                output += layer.play_weights[j] * positions[j]
            if output != last_output:
                power = output ** layer.exponent[a]
                last_output = output
            grown = 1.0
            for k in range(processes):
                grown += layer.creep[a, k] * crept[k]
                crept[k] += layer.creep_part[k] * (1.0 - crept[k])
            value = layer.gain[a] * power * grown
            if touched:
                peak = max(peak, value / (1.0 + value))
            conductance[t, a] = value
            shift[t, a] = shifted
        state.max_load[a] = largest
        state.loaded[a] = loaded
        state.touched[a] = touched
        state.play_output[a] = last_output
        state.power[a] = power
        state.peak[a] = peak
        state.baseline_shift[a] = shifted
        state.touches[a] = touches


class TaxelArrays(NamedTuple):
    """This tuple holds where the live taxels lie in the arrays of their patches."""

    starts: np.ndarray
    """First live taxel of each live patch, and one more (array_and_one)."""
    patch: np.ndarray
    """Patch of each array (array)."""
    row: np.ndarray
    """Row in its array (live)."""
    column: np.ndarray
    """Column in its array (live)."""
    age: np.ndarray
    """Time of its scan before the reading is assembled [s] (live)."""
    taxel: np.ndarray
    """Taxel at each place, -1 where there is none (array, row, column)."""
    rows: np.ndarray
    """Rows of each array (array)."""
    columns: np.ndarray
    """Columns of each array (array)."""


@compiled
@no_type_check
def interpolate_series(
    series: Float[np.ndarray, "time live"], first: int, a: int, place: float
) -> float:
    """Interpolate a series that starts at step `first`, constant beyond its ends."""
    last = len(series) - 1
    if place <= first:
        return series[0, a]
    if place >= first + last:
        return series[last, a]
    index = int(place)
    part = place - index
    index -= first
    return (1.0 - part) * series[index, a] + part * series[index + 1, a]


class Converter(NamedTuple):
    """This tuple holds the curve of a converter for `scan_arrays`."""

    curve: int
    """`IN_PROPORTION`, `DIVIDER` or `LOGARITHMIC`."""
    span: float
    """Span of a logarithmic converter."""


IN_PROPORTION = 0
DIVIDER = 1
LOGARITHMIC = 2
"""Curves of converters, from conductance to a level relative to full scale."""


@compiled(error_model="numpy")
@no_type_check
def convert_conductance(x: float, converter: Converter) -> float:
    """Return the level of a conductance in single precision."""
    if converter.curve == DIVIDER:
        return x / (x + np.float32(1.0))
    if converter.curve == LOGARITHMIC:
        return np.float32(math.log1p(converter.span * x) / math.log1p(converter.span))
    return x


@compiled(error_model="numpy")
@no_type_check
def scan_arrays(
    conductance: Float[np.ndarray, "time live"],
    shift: Float[np.ndarray, "time live"],
    arrays: TaxelArrays,
    places: Float[np.ndarray, "reading"],
    late: Float[np.ndarray, "reading patch"],
    step: float,
    ghost: float,
    leak: float,
    converter: Converter,
    first: int,
    level: Float[np.ndarray, "reading taxel"],
    shifts: Float[np.ndarray, "reading taxel"],
) -> None:
    """Read all arrays: write each taxel's level relative to full scale, and its shift.

    Args:
        conductance: conductance of the live taxels.
        shift: shift of their baselines, relative to full scale.
        arrays: positions of the taxels.
        places: time of each reading, in steps since the beginning.
        late: delay of a patch's scan beyond the usual [s].
        step: step of the series [s].
        ghost: part of detours that is read.
        leak: part of rows and columns that is read.
        converter: converter after the arrays.
        first: step since the beginning at which the series start.
        level: zeros that are written to.
        shifts: zeros that are written to.
    """
    for m in range(len(arrays.patch)):
        begin, end = arrays.starts[m], arrays.starts[m + 1]
        rows, columns = arrays.rows[m], arrays.columns[m]
        cells = np.zeros((rows, columns), np.float32)
        read = np.zeros((rows, columns), np.float32)
        for r in range(len(places)):
            is_new = False
            for a in range(begin, end):
                delay = late[r, arrays.patch[m]] - arrays.age[a]
                place = places[r] + delay / step
                cell = np.float32(interpolate_series(conductance, first, a, place))
                row, column = arrays.row[a], arrays.column[a]
                is_new = is_new or cell != cells[row, column]
                cells[row, column] = cell
                shifts[r, arrays.taxel[m, row, column]] = interpolate_series(
                    shift, first, a, place
                )
            if is_new:
                read_array(cells, ghost, leak, read)
            for i in range(rows):
                for j in range(columns):
                    x = read[i, j]
                    if x > 0.0 and arrays.taxel[m, i, j] >= 0:
                        x = convert_conductance(x, converter)
                        level[r, arrays.taxel[m, i, j]] = x


class Readout(NamedTuple):
    """This tuple holds the converter for `convert_to_counts`."""

    full: float
    base: np.ndarray
    """Baseline [counts] (taxel)."""
    walk: float
    """Step of the random walk [counts]."""
    noise: np.ndarray
    """Standard deviation of a reading [counts] (taxel)."""
    noise_relative: float
    touched_noise: float
    """Standard deviation of what a touch adds to the noise [counts]."""
    touched_level: np.ndarray
    """Level relative to full scale from which it does (taxel)."""
    cut: int
    """Counts below which it gives zero."""
    sensitivity: np.ndarray
    """Sensitivity of a taxel: 1, or 0 if it is dead (taxel)."""
    stuck: np.ndarray
    """Counts of a stuck taxel, -1 of the others (taxel)."""


@compiled(error_model="numpy")
@no_type_check
def convert_to_counts(
    level: Float[np.ndarray, "reading taxel"],
    shifts: Float[np.ndarray, "reading taxel"],
    chances: Int[np.ndarray, "reading taxel"],
    signs: Int[np.ndarray, "reading word"],
    quantiles: Float[np.ndarray, "chance"],
    drift: Float[np.ndarray, "taxel"],
    readout: Readout,
    out: Int[np.ndarray, "reading taxel"],
) -> None:
    """Convert levels to counts.

    Args:
        level: level relative to full scale.
        shifts: shift of the baseline, relative to full scale.
        chances: uniform numbers by which noise is looked up in `quantiles`.
        signs: random words of 64 bits, each bit the direction of one step of the walk.
        quantiles: quantiles of the normal law.
        drift: random walk [counts], updated in place.
        readout: converter.
        out: counts, written.
    """
    full = np.float32(readout.full)
    walk = np.float32(readout.walk)
    part = np.float32(readout.noise_relative)
    added = np.float32(readout.touched_noise)
    added *= added
    zero = np.float32(0.0)
    half = np.float32(0.5)
    squares = readout.noise * readout.noise
    for r in range(len(level)):
        if added > zero:
            for i in range(level.shape[1]):
                own = readout.noise[i]
                is_touched = level[r, i] > readout.touched_level[i]
                squares[i] = own * own + (added if is_touched else zero)
        for i in range(level.shape[1]):
            is_up = (signs[r, i >> 6] >> np.uint64(i & 63)) & np.uint64(1)
            drift[i] += walk if is_up else -walk
            signal = full * (level[r, i] + shifts[r, i]) * readout.sensitivity[i]
            value = readout.base[i] + drift[i] + signal
            rough = part * value
            value += np.sqrt(squares[i] + rough * rough) * quantiles[chances[r, i]]
            out[r, i] = np.int32(min(max(np.floor(value + half), zero), full))
        if readout.cut > 0:
            for i in range(level.shape[1]):
                out[r, i] *= out[r, i] >= readout.cut
        for i in range(level.shape[1]):
            if readout.stuck[i] >= 0:
                out[r, i] = readout.stuck[i]
