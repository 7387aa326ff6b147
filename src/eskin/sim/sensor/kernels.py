"""Compiled kernels that simulate the sensor over time and taxels."""

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


class SensorLayer(NamedTuple):
    """The laminate under the live taxels, as `update_conductance` wants it."""

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
    """(live, process)"""
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
    """What the live taxels keep of the steps before, as `update_conductance` goes on with it."""

    play_positions: np.ndarray
    """Places of the play operators (live, operator)."""
    creep: np.ndarray
    """Shares of full creep (live, process)."""
    slow_creep: np.ndarray
    """The part of them that is slow to be forgotten after release (live, process)."""
    max_load: np.ndarray
    """Largest load of the touch (live)."""
    play_output: np.ndarray
    """What the operators held at the last load (live)."""
    power: np.ndarray
    """That to the power of the exponent (live)."""
    peak: np.ndarray
    """Largest signal of the touch, by full scale (live)."""
    baseline_shift: np.ndarray
    """Shift of the baseline, by full scale (live)."""
    touches: np.ndarray
    """Touches that are over (live)."""
    loaded: np.ndarray
    """Whether it conducts (live)."""
    touched: np.ndarray
    """Whether it is touched (live)."""


MIN_STATE = 1e-30
"""What is smaller is as good as nothing; ever smaller numbers would be slow."""


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
        pressure: of the active taxels [kPa].
        column: of each live taxel in `pressure`, -1 if it is never touched.
        layer: the laminate.
        state: what it keeps of the steps before; carried on.
        conductance: written; 1 is half scale.
        shift: written, by full scale.
    """
    steps, live = conductance.shape
    operators, processes = len(layer.play_widths), len(layer.creep_part)
    for a in range(live):
        still, crept, slow = (
            state.play_positions[a],
            state.creep[a],
            state.slow_creep[a],
        )
        rest, largest = max(layer.load[a], 0.0), state.max_load[a]
        loaded, touched = state.loaded[a], state.touched[a]
        held_before, power = state.play_output[a], state.power[a]
        peak, shifted, touches = (
            state.peak[a],
            state.baseline_shift[a],
            state.touches[a],
        )
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
                    still[:] = 0.0
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
            held = 0.0
            for j in range(operators):
                width = layer.play_widths[j] * largest
                still[j] = max(q - width, min(q + width, still[j]))
                held += layer.play_weights[j] * still[j]
            if held != held_before:
                power = held ** layer.exponent[a]
                held_before = held
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
        state.loaded[a], state.touched[a] = loaded, touched
        state.play_output[a], state.power[a] = held_before, power
        state.peak[a], state.baseline_shift[a], state.touches[a] = (
            peak,
            shifted,
            touches,
        )


class TaxelArrays(NamedTuple):
    """Where the live taxels lie in the arrays of their patches."""

    starts: np.ndarray
    """First live taxel of each live patch, and one more (array_and_one)."""
    patch: np.ndarray
    """The patch of each array (array)."""
    row: np.ndarray
    """Place in its array's rows (live)."""
    column: np.ndarray
    """Place in its array's columns (live)."""
    age: np.ndarray
    """When it is scanned, before the reading is put together [s] (live)."""
    taxel: np.ndarray
    """Taxel at each place, -1 where there is none (array, row, column)."""
    rows: np.ndarray
    """Rows of each array (array)."""
    columns: np.ndarray
    """Columns of each array (array)."""


@compiled
@no_type_check
def at(
    series: Float[np.ndarray, "time live"], first: int, a: int, place: float
) -> float:
    """A series whose first step is `first` between its steps, constant beyond them."""
    last = len(series) - 1
    if place <= first:
        return series[0, a]
    if place >= first + last:
        return series[last, a]
    before = int(place)
    part = place - before
    before -= first
    return (1.0 - part) * series[before, a] + part * series[before + 1, a]


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
    divide: bool,
    first: int,
    level: Float[np.ndarray, "reading taxel"],
    shifts: Float[np.ndarray, "reading taxel"],
) -> None:
    """Read all arrays: write the level of each taxel by full scale, and its shift.

    Args:
        conductance: of the live taxels.
        shift: of their baselines, by full scale.
        arrays: where they are.
        places: of each reading, in steps since the beginning.
        late: how much later than usual a patch is scanned [s].
        step: of the series [s].
        ghost: part of detours.
        leak: part of rows and columns.
        divide: whether there is a divider.
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
                cell = np.float32(at(conductance, first, a, place))
                row, column = arrays.row[a], arrays.column[a]
                is_new = is_new or cell != cells[row, column]
                cells[row, column] = cell
                shifts[r, arrays.taxel[m, row, column]] = at(shift, first, a, place)
            if is_new:
                read_array(cells, ghost, leak, read)
            for i in range(rows):
                for j in range(columns):
                    x = read[i, j]
                    if x > 0.0 and arrays.taxel[m, i, j] >= 0:
                        if divide:
                            x = x / (x + np.float32(1.0))
                        level[r, arrays.taxel[m, i, j]] = x


class Readout(NamedTuple):
    """The converter, as `convert_to_counts` wants it."""

    full: float
    base: np.ndarray
    """[counts] (taxel)"""
    walk: float
    """[counts]"""
    noise: float
    """[counts]"""
    noise_relative: float
    feels: np.ndarray
    """Whether a taxel feels anything: 1 or 0 (taxel)."""
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
    """Turn levels into counts.

    Args:
        level: by full scale.
        shifts: of the baseline, by full scale.
        chances: from which noise is looked up in `quantiles`, all alike.
        signs: random words of 64 bits, each the direction of one step of the walk.
        quantiles: of the normal law.
        drift: the random walk [counts], moved on by the readings.
        readout: the converter.
        out: counts, written.
    """
    full, walk = np.float32(readout.full), np.float32(readout.walk)
    own, part = np.float32(readout.noise), np.float32(readout.noise_relative)
    zero, half = np.float32(0.0), np.float32(0.5)
    for r in range(len(level)):
        for i in range(level.shape[1]):
            is_up = (signs[r, i >> 6] >> np.uint64(i & 63)) & np.uint64(1)
            drift[i] += walk if is_up else -walk
            signal = full * (level[r, i] + shifts[r, i]) * readout.feels[i]
            value = readout.base[i] + drift[i] + signal
            rough = part * value
            value += np.sqrt(own * own + rough * rough) * quantiles[chances[r, i]]
            out[r, i] = np.int32(min(max(np.floor(value + half), zero), full))
        for i in range(level.shape[1]):
            if readout.stuck[i] >= 0:
                out[r, i] = readout.stuck[i]
