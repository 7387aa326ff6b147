"""Compiled kernels that convert counts to pressure and subtract crosstalk."""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

import math
from collections import namedtuple
from dataclasses import dataclass, fields
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float, Int
from pydantic import Field

from eskin.compiled import compiled
from eskin.files import Duration, Factor, Pressure, Share
from eskin.touch.adjacency import Adjacency, TaxelGroups

Taxels = Int[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
Flags = Bool[np.ndarray, "taxel"]


class PressureCurve(NamedTuple):
    """A curve holds the relation of pressure and counts; see `Calibration`."""

    full_scale: float
    """Counts at which the device saturates; infinite for a linear one."""
    exponent: float
    """Exponent of conductance over pressure; 1 for a linear device."""
    unfelt: float
    """Pressure that closes the sensor without a change of the counts [kPa]."""
    span: float
    """Range of a logarithmic converter; 0 for other devices."""


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings describe how baselines are tared and tracked. All times are in [s]."""

    tare_seconds: Duration = 2.0
    """Duration of the tare, which begins when a taxel is first received."""
    tare_samples: Annotated[int, Interval(ge=1, le=1000)] = 16
    """Number of samples of the tare."""
    tare_rank: Annotated[float, Interval(ge=0.0, le=0.99)] = 0.25
    """Quantile of the samples that is the baseline: low, to exclude touches."""
    margin: Pressure = 1.5
    """Pressure above the baseline from which a taxel may be touched [kPa]; where it is
    as far below, the baseline is too high."""
    drift_seconds: Duration = 10.0
    """Time constant of tracking the drift of an untouched taxel."""
    freeze_seconds: Duration = 3.0
    """How long after a touch the baselines of a taxel and its neighbours stay fixed."""
    longest_seconds: Duration = 120.0
    """Duration from which an uninterrupted touch counts as a change of the baseline."""
    stale_seconds: Duration = 5.0
    """Time constant of tracking such a change."""
    fade_seconds: Duration = 20.0
    """Time constant of the decay of the recent peak."""
    steady_seconds: Duration = 1.0
    """Time without change above the baseline from which a taxel counts as at rest, with
    the residual of a touch, or with a new offset where it is alone. No finger keeps so
    still, while these remain."""
    residual: Share = 0.25
    """Largest residual of a touch, in units of its peak."""
    dip_share: Share = 0.15
    """Largest dip below the baseline after a touch, from which counts recover, in units
    of its peak, which fades."""
    steady_band: Annotated[Factor, Field(alias="still")] = 0.25
    """Largest difference that counts as no change, in units of `margin`."""
    settle_seconds: Duration = 0.3
    """Time constant of tracking counts that do not change, and of lowering a baseline
    that is too high."""


BaselineParameters = namedtuple(
    "BaselineParameters", [field.name for field in fields(CalibrationConfig)]
)
"""The fields of a `CalibrationConfig` for compiled code."""


BASELINE = np.dtype(
    [("sample_count", np.int64)]
    + [
        (name, np.float64)
        for name in (
            *("baseline", "above", "confirmed", "peak", "low", "low_since"),
            *("last_received", "touched_since", "last_touched"),
            *("steady_level", "steady_since", "next_sample"),
        )
    ]
)
"""The state of the baseline of a taxel, in counts and seconds: the number of samples
taken for the tare; the counts at rest; the counts above them at the last scan;
`confirmed`, the lesser of those of the last two scans if they are less than
`SHORTEST_PRESS` apart, as one alone may be corrupt; the recent peak of that of it and
its neighbours, which decays; the counts of the last scan where they were below the
baseline, and since when they are, infinite while they are not; when it was last
received; since when it is touched, infinite while it is not; when it or a neighbour was
last touched; the counts near which the latest ones have stayed, and since when; and
when the next sample of the tare is taken."""


class BaselineContext(NamedTuple):
    """A context holds the arguments of the kernels that are kept between scans."""

    gain: np.ndarray  # (taxel) gain [kPa/count]
    curve: PressureCurve  # Relation of pressure and counts
    adjacency: Adjacency  # Neighbours of each taxel
    state: np.ndarray  # (taxel) `BASELINE`, which is updated
    samples: np.ndarray  # (taxel, sample) samples of the tare, ascending
    parameters: BaselineParameters  # How baselines are tared and tracked
    rows: TaxelGroups  # Rows of the taxels
    columns: TaxelGroups  # Columns of the taxels
    crosstalk: np.ndarray
    """(taxel) counts that the touched taxels of its row and column may add, updated."""
    line_share: float
    """Largest share of the counts of a touched taxel on the others of its row, and of
    its column; 0 where taxels are not read out by rows and columns."""


SILENCE_SECONDS = 10.0
"""Time without data after which a taxel has no history, and is tared again [s]: its
patch may be new."""
STALE_SECONDS = 0.5
"""Time without data, as of a faulty taxel, after which it is no longer touched."""
MIN_TARE_SAMPLES = 4
"""Number of samples from which one above the margin no longer raises the tare."""
SHORTEST_PRESS = 0.05
"""Time between two scans up to which a press is seen in both [s]; what is seen in one
alone is corrupt, and its peak is not remembered."""
LOW_SECONDS = 0.06
"""Time below the baseline after which it is lowered [s]: a corrupt value is of one
scan."""
MATRIX_LINE_SHARE = 0.05
"""Largest share of the counts of a taxel that its row and its column show elsewhere in
a matrix that is read out by rows and columns."""
MAX_SCALE_SHARE = 0.999
"""Fraction of a divider's full scale above which pressures are indistinguishable."""


@compiled
def linearise_counts(above: float, curve: PressureCurve) -> float:
    """Return the counts above rest that a linear device of the same gain would give."""
    if above <= 0.0 or curve.full_scale == np.inf:
        return max(above, 0.0)
    if curve.span > 0.0:
        share = min(above / curve.full_scale, 1.0)
        conductance = math.expm1(share * math.log1p(curve.span)) / curve.span
    else:
        share = min(above / curve.full_scale, MAX_SCALE_SHARE)
        conductance = share / (1.0 - share)
    if curve.exponent != 1.0:
        # Pressures are kept in float32, whose powers take a third of the time.
        exponent = np.float32(1.0 / curve.exponent)
        conductance = float(np.float32(conductance) ** exponent)
    return curve.full_scale * conductance


@compiled
def compute_felt(pressure: float, curve: PressureCurve) -> float:
    """Return the part of a pressure that changes the counts [kPa]."""
    return max(pressure - curve.unfelt, 0.5 * pressure)


@compiled
def add_unfelt(felt: float, curve: PressureCurve) -> float:
    """Return the pressure of which a part changes the counts [kPa]."""
    return felt + min(felt, curve.unfelt)


@compiled
def compute_pressures(
    above: Values, gain: Values, curve: PressureCurve, out: Values
) -> None:
    """Write the pressures [kPa] at counts above rest."""
    for i in range(len(above)):
        out[i] = add_unfelt(linearise_counts(above[i], curve) * gain[i], curve)


@compiled
def compute_counts(
    pressure: Values, gain: Values, curve: PressureCurve, out: Values
) -> None:
    """Write the counts above rest at pressures [kPa]."""
    scale = curve.full_scale
    for i in range(len(pressure)):
        out[i] = compute_felt(pressure[i], curve) / gain[i]
        if scale < np.inf:
            conductance = (out[i] / scale) ** curve.exponent
            if curve.span > 0.0:
                grown = math.log1p(curve.span * conductance)
                out[i] = scale * grown / math.log1p(curve.span)
            else:
                out[i] = scale * conductance / (1.0 + conductance)


@compiled
def find_near(i: int, adjacency: Adjacency) -> Taxels:
    """Return the neighbours of a taxel."""
    return adjacency.neighbours[adjacency.starts[i] : adjacency.starts[i + 1]]


@compiled
def calibrate(
    counts: Taxels,
    use: Flags,
    now: float,
    margin: Values,
    latched: Taxels,
    context: BaselineContext,
    out: Values,
) -> None:
    """Update the baselines with one scan and write the pressures [kPa] to `out`.

    Taxels with `use` False are not received or faulty; `margin` is in counts; `latched`
    are those that were in contact at the last reading.
    """
    # Local references to the arrays make the compiled loops faster.
    gain, curve, state = context.gain, context.curve, context.state
    size = context.samples.shape[1]
    touched = False
    for i in range(len(counts)):
        taxel = state[i]
        if not use[i]:
            out[i] = 0.0
            if now - taxel.last_received > STALE_SECONDS:
                taxel.above, taxel.touched_since = 0.0, np.inf
            continue
        if taxel.sample_count < size or now - taxel.last_received > SILENCE_SECONDS:
            update_tare(i, counts[i], now, margin[i], context)
        above = counts[i] - taxel.baseline
        is_fast = now - taxel.last_received <= SHORTEST_PRESS
        taxel.confirmed = min(above, taxel.above) if is_fast else above
        taxel.above = above
        out[i] = add_unfelt(linearise_counts(above, curve) * gain[i], curve)
        if above > margin[i]:
            touched = True
            if taxel.touched_since == np.inf:
                taxel.touched_since = now
            if not is_residual(i, above, now, margin[i], context):
                mark_touched(i, now, context)
        else:
            taxel.touched_since = np.inf
    for i in latched:
        above = counts[i] - state[i].baseline
        if use[i] and not is_residual(i, above, now, margin[i], context):
            mark_touched(i, now, context)
    if context.line_share > 0.0:
        if touched:
            bound_crosstalk(use, margin, context)
        else:
            context.crosstalk[:] = 0.0
    update_baselines(counts, use, now, margin, context)


@compiled
def bound_crosstalk(use: Flags, margin: Values, context: BaselineContext) -> None:
    """Write how many counts the touched taxels of its lines may add to each taxel.

    Rest and noise are not learned where this explains what is measured.
    """
    rows, columns, state = context.rows, context.columns, context.state
    row_sums = np.zeros(len(rows.sizes))
    column_sums = np.zeros(len(columns.sizes))
    for i in range(len(state)):
        above = state[i].above
        if use[i] and above > margin[i]:
            row_sums[rows.group_index[i]] += above
            column_sums[columns.group_index[i]] += above
    for i in range(len(state)):
        own = 0.0
        if use[i] and state[i].above > margin[i]:
            own = state[i].above
        others = row_sums[rows.group_index[i]] + column_sums[columns.group_index[i]]
        context.crosstalk[i] = context.line_share * (others - 2.0 * own)


@compiled
def mark_touched(i: int, now: float, context: BaselineContext) -> None:
    """Mark a taxel and its neighbours as touched, and raise their peaks."""
    taxel = context.state[i]
    taxel.last_touched = now
    for j in find_near(i, context.adjacency):
        near = context.state[j]
        near.last_touched = now
        near.peak = max(near.peak, taxel.confirmed)


@compiled
def update_tare(
    i: int, count: int, now: float, margin: float, context: BaselineContext
) -> None:
    """Take a sample of the tare if one is due, and restart it after a long silence."""
    taxel, parameters = context.state[i], context.parameters
    samples = context.samples[i]
    if now - taxel.last_received > SILENCE_SECONDS:
        taxel.sample_count, taxel.next_sample = 0, now
        taxel.peak, taxel.touched_since = 0.0, np.inf
        taxel.low = taxel.low_since = np.inf
    size = taxel.sample_count
    if now < taxel.next_sample:
        return
    sample = float(count)
    if size >= MIN_TARE_SAMPLES and sample > taxel.baseline + margin:
        sample = taxel.baseline
    k = size
    while k > 0 and samples[k - 1] > sample:
        samples[k] = samples[k - 1]
        k -= 1
    samples[k] = sample
    taxel.sample_count = size + 1
    rank = min(max(parameters.tare_rank, 0.0), 1.0) * (size + 1)
    taxel.baseline = samples[min(int(rank), size)]
    taxel.next_sample = now + parameters.tare_seconds / parameters.tare_samples


@compiled
def is_residual(
    i: int, above: float, now: float, margin: float, context: BaselineContext
) -> bool:
    """Return whether counts above the baseline are steady, and no touch.

    They are the residual of a touch that pressed far more, or the offset of a single
    taxel.
    """
    taxel, parameters = context.state[i], context.parameters
    if now - taxel.steady_since <= parameters.steady_seconds:
        return False
    if above <= max(parameters.steady_band * margin, context.crosstalk[i]):
        return False
    if above < parameters.residual * taxel.peak:
        return True
    for j in find_near(i, context.adjacency):
        if context.state[j].touched_since < np.inf:
            return False
    return True


@compiled
def update_baselines(
    counts: Taxels, use: Flags, now: float, margin: Values, context: BaselineContext
) -> None:
    """Move each baseline towards the counts while the taxel is untouched."""
    state, parameters = context.state, context.parameters
    drift, fade = parameters.drift_seconds, parameters.fade_seconds
    freeze = parameters.freeze_seconds
    band, dip_share = parameters.steady_band, parameters.dip_share
    size = context.samples.shape[1]
    dt, drift_step, fading = 0.0, 0.0, 1.0
    for i in range(len(counts)):
        if not use[i]:
            continue
        taxel, least = state[i], margin[i]
        if now - taxel.last_received != dt:
            # Taxels of one patch have the same dt; divisions are expensive.
            dt = now - taxel.last_received
            drift_step, fading = dt / (drift + dt), fade / (fade + dt)
        taxel.last_received = now
        if taxel.sample_count < size:
            continue
        above = counts[i] - taxel.baseline
        foreign = context.crosstalk[i]
        if abs(counts[i] - taxel.steady_level) > band * least:
            taxel.steady_level, taxel.steady_since = counts[i], now
        if foreign > band * least and abs(above) <= foreign:
            taxel.low = taxel.low_since = np.inf
            continue
        if abs(above) <= least and taxel.peak == 0.0 and taxel.low_since == np.inf:
            # Nearly all taxels of nearly all scans.
            if above <= band * least and now - taxel.last_touched > freeze:
                taxel.baseline += drift_step * above
                continue
        was_low, since = taxel.low, taxel.low_since
        taxel.low = taxel.low_since = np.inf
        step = 0.0
        dip = max(least, dip_share * taxel.peak)
        if above < -dip or (now - dt - since >= LOW_SECONDS and above < 0.0):
            taxel.low, taxel.low_since = counts[i], min(since, now)
            if now - since >= LOW_SECONDS:
                above = max(above, was_low - taxel.baseline)
                step = dt / (parameters.settle_seconds + dt)
        elif (
            # Most taxels fail at this, before the context is handed over.
            above > band * least
            and taxel.last_touched < now
            and is_residual(i, above, now, least, context)
        ):
            step = dt / (parameters.settle_seconds + dt)
        elif taxel.touched_since < np.inf:
            if now - taxel.touched_since > parameters.longest_seconds:
                step = dt / (parameters.stale_seconds + dt)
        elif now - taxel.last_touched > freeze:
            step = drift_step
        taxel.baseline += step * above
        taxel.peak *= fading
        if above > least:
            taxel.peak = max(taxel.peak, taxel.confirmed)
        elif taxel.peak < least:
            taxel.peak = 0.0


MIN_OTHERS = 0.3
"""Smallest conductance of the others, relative to half scale, for an observation."""
MIN_SHARES = 8
"""Smallest number of taxels for an observation."""
MAX_TOUCHED_SHARE = 0.25
"""Largest fraction of a patch that may be touched for an observation."""
MIN_TOUCHED = 0.3
"""Conductance of a touched taxel over the largest of its patch: crosstalk along the
lines of a hand shows less."""
GHOST_FACTOR = 2.5
"""Factor by which ghosts are subtracted. Taxels that the bend of the skin presses at
rest conduct detours too, but do not show in pressures above rest. Touched taxels lose
little by the factor."""
EPSILON = 1e-9
"""Negligible conductance that prevents a division by zero."""
LEAK, GHOST = 0, 1
"""Indices of the two coefficients: leakage along lines, and ghosts by detours."""
MAX_ESTIMATE = (0.08, 0.15)
"""Largest value of each coefficient; a larger observation is due to a touch and is
discarded."""
SHARE_QUANTILE = (0.4, 0.25)
"""Quantile of the shares of all taxels that is an observation of each coefficient."""


class MatrixPatch(NamedTuple):
    """A patch has rows and columns that are read out together, and working buffers."""

    taxels: np.ndarray  # (taxel) indices of its taxels in the skin
    rows: np.ndarray  # (taxel) row, numbered from 0 without gaps
    columns: np.ndarray  # (taxel) column, numbered from 0 without gaps
    row_sizes: np.ndarray  # (row) number of its taxels
    column_sizes: np.ndarray  # (column) number of its taxels
    half_scale: np.ndarray
    """(taxel) pressure at half scale, or at full scale of a linear device [kPa]."""
    shown: np.ndarray  # (taxel) measured conductance, relative to half scale
    own: np.ndarray  # (taxel) that conductance without leakage
    row_sums: np.ndarray  # (row) sums of conductances
    column_sums: np.ndarray  # (column) sums of conductances
    detours: np.ndarray  # (taxel) conductance of the paths over three others
    shares: np.ndarray
    """(taxel) space for ratios of a taxel's conductance to that of the others."""


class CrosstalkEstimate(NamedTuple):
    """An estimate holds the crosstalk coefficients of a device, with observations."""

    value: np.ndarray  # (coefficient) median of the latest observations
    seen: np.ndarray  # (coefficient) number of observations so far
    observed: np.ndarray
    """(coefficient, observation) ring buffer of the latest observations."""
    ranked: np.ndarray  # (observation) space to rank them


@compiled
def compensate_patch(
    pressure: Values,
    valid: Flags,
    curve: PressureCurve,
    patch: MatrixPatch,
    estimate: CrosstalkEstimate,
) -> None:
    """Update the estimate from one patch, and remove crosstalk from its pressures.

    `pressure` [kPa] is that of the whole skin, zero where not valid.
    """
    largest = write_conductance(pressure, curve, patch)
    touched = MIN_TOUCHED * largest
    is_small = count_touched(patch, touched) <= MAX_TOUCHED_SHARE * len(patch.taxels)
    if is_small:
        observe_leak(touched, valid, patch, estimate)
    remove_leak(estimate.value[LEAK], patch)
    write_detours(patch)
    if is_small:
        observe_ghost(valid, patch, estimate)
    ghost = GHOST_FACTOR * estimate.value[GHOST]
    for k in range(len(patch.taxels)):
        own = max(patch.own[k] - ghost * patch.detours[k], 0.0)
        felt = own ** (1.0 / curve.exponent) * patch.half_scale[k]
        pressure[patch.taxels[k]] = add_unfelt(felt, curve)


@compiled
def write_conductance(
    pressure: Values, curve: PressureCurve, patch: MatrixPatch
) -> float:
    """Write the measured conductance of each taxel, and return the largest."""
    largest = 0.0
    for k in range(len(patch.taxels)):
        felt = compute_felt(np.float64(pressure[patch.taxels[k]]), curve)
        conductance = 0.0
        if felt > 0.0:
            conductance = (felt / patch.half_scale[k]) ** curve.exponent
        patch.shown[k] = conductance
        largest = max(largest, conductance)
    return largest


@compiled
def count_touched(patch: MatrixPatch, touched: float) -> int:
    """Return the number of taxels of a patch that show more than a conductance."""
    count = 0
    for shown in patch.shown:
        count += shown > touched
    return count


@compiled
def sum_lines(values: Values, least: float, patch: MatrixPatch) -> float:
    """Write the sums of the values above a least one along lines; return their sum."""
    patch.row_sums[:] = 0.0
    patch.column_sums[:] = 0.0
    total = 0.0
    for k in range(len(values)):
        if values[k] > least:
            patch.row_sums[patch.rows[k]] += values[k]
            patch.column_sums[patch.columns[k]] += values[k]
            total += values[k]
    return total


@compiled
def observe_leak(
    touched: float, valid: Flags, patch: MatrixPatch, estimate: CrosstalkEstimate
) -> None:
    """Observe leakage on taxels of which one line is touched, and the other is not."""
    sum_lines(patch.shown, touched, patch)
    count = 0
    for k in range(len(patch.taxels)):
        row = patch.row_sums[patch.rows[k]]
        column = patch.column_sums[patch.columns[k]]
        line = max(row, column)
        if min(row, column) == 0.0 and line > MIN_OTHERS and valid[patch.taxels[k]]:
            patch.shares[count] = patch.shown[k] / line
            count += 1
    add_observation(LEAK, patch.shares[:count], estimate)


@compiled
def remove_leak(leak: float, patch: MatrixPatch) -> None:
    """Write the conductances that show as measured once lines have leaked.

    A taxel shows its own conductance and a share of that of all others of its row and
    column. Sums over rows, columns and the patch solve these equations where each
    crossing has a taxel, and nearly so elsewhere.
    """
    total = sum_lines(patch.shown, 0.0, patch)
    kept = 1.0 - 2.0 * leak
    size = len(patch.taxels)
    sizes = size / len(patch.row_sizes) + size / len(patch.column_sizes)
    total /= kept + leak * sizes
    for row in range(len(patch.row_sizes)):
        own = patch.row_sums[row] - leak * total
        patch.row_sums[row] = max(own / (kept + leak * patch.row_sizes[row]), 0.0)
    for column in range(len(patch.column_sizes)):
        own = patch.column_sums[column] - leak * total
        own /= kept + leak * patch.column_sizes[column]
        patch.column_sums[column] = max(own, 0.0)
    for k in range(size):
        lines = patch.row_sums[patch.rows[k]] + patch.column_sums[patch.columns[k]]
        own = (patch.shown[k] - leak * lines) / kept
        patch.own[k] = min(max(own, 0.0), patch.shown[k])


@compiled
def write_detours(patch: MatrixPatch) -> None:
    """Write the conductance of the detours of each taxel over three others."""
    total = sum_lines(patch.own, 0.0, patch)
    for k in range(len(patch.taxels)):
        own = patch.own[k]
        row = patch.row_sums[patch.rows[k]] - own
        column = patch.column_sums[patch.columns[k]] - own
        rest = max(total - row - column - own, 0.0)
        a, b, c = row + EPSILON, rest + EPSILON, column + EPSILON
        patch.detours[k] = 1.0 / (1.0 / a + 1.0 / b + 1.0 / c)


@compiled
def observe_ghost(
    valid: Flags, patch: MatrixPatch, estimate: CrosstalkEstimate
) -> None:
    """Observe ghosts where detours conduct much."""
    count = 0
    for k in range(len(patch.taxels)):
        if patch.detours[k] > 0.5 * MIN_OTHERS and valid[patch.taxels[k]]:
            patch.shares[count] = patch.own[k] / patch.detours[k]
            count += 1
    add_observation(GHOST, patch.shares[:count], estimate)


@compiled
def add_observation(part: int, shares: Values, estimate: CrosstalkEstimate) -> None:
    """Add a quantile of the shares as an observation, unless it is due to a touch."""
    if len(shares) < MIN_SHARES:
        return
    observed = select(shares, int(SHARE_QUANTILE[part] * (len(shares) - 1)))
    if observed > MAX_ESTIMATE[part]:
        return
    ring = estimate.observed[part]
    ring[estimate.seen[part] % len(ring)] = max(observed, 0.0)
    estimate.seen[part] += 1
    used = min(estimate.seen[part], len(ring))
    for k in range(used):
        estimate.ranked[k] = ring[k]
    ranked = estimate.ranked[:used]
    low, high = select(ranked, (used - 1) // 2), select(ranked, used // 2)
    estimate.value[part] = (low + high) / 2.0


@compiled
def select(values: Values, place: int) -> float:
    """Return the value at a place in ascending order; the values change their places.

    Numba compiles `np.partition` and `np.median` for ten seconds.
    """
    first, last = 0, len(values) - 1
    while first < last:
        pivot, i, j = values[place], first, last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < place:
            first = i
        if i > place:
            last = j
    return values[place]
