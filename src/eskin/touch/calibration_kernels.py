"""Compiled kernels that turn counts into pressure and subtract crosstalk.

`no_type_check` keeps the type checks of the tests off compiled functions.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled


class PressureCurve(NamedTuple):
    """A curve tells how pressure grows with counts; see `Calibration`."""

    full_scale: float
    """Counts at which a divider saturates; infinite where there is none."""
    exponent: float
    """Exponent of conductance over pressure; 1 for a linear device."""
    unfelt: float
    """Pressure that it takes to close the sensor [kPa]."""


class BaselineParameters(NamedTuple):
    """Parameters of `calibrate` have the names and values of `CalibrationConfig`."""

    tare_seconds: float
    tare_samples: int
    tare_rank: float
    drift_seconds: float
    low_seconds: float
    freeze_seconds: float
    longest_seconds: float
    stale_seconds: float
    after_fraction: float
    fade_seconds: float
    steady_seconds: float
    still: float
    kept: float
    settle_seconds: float
    relearn_seconds: float
    silence_seconds: float


class BaselineState(NamedTuple):
    """Arrays that hold what `calibrate` remembers of each taxel, in counts and seconds.

    All have the shape (taxel) but `samples`.
    """

    baseline: np.ndarray
    """Counts at rest."""
    peak: np.ndarray
    """Greatest recent counts above the baseline, which fade."""
    low: np.ndarray
    """Counts of the last scan if they were too low, else infinite."""
    last_received: np.ndarray
    """Time at which the taxel was last received."""
    touched_since: np.ndarray
    """Time at which it began to be touched, infinite while it is not."""
    last_touched: np.ndarray
    """Time at which it or a neighbour was last touched."""
    steady_level: np.ndarray
    """Counts near which it has stayed."""
    steady_since: np.ndarray
    """Time since which it has stayed near `steady_level`."""
    next_sample: np.ndarray
    """Time at which the next sample of the tare is taken."""
    sample_count: np.ndarray
    """Number of samples that the tare has."""
    samples: np.ndarray
    """(taxel, sample) samples of the tare, ascending."""


SURE_SAMPLES = 4
"""Number of samples from which one above the margin does not raise the tare."""

MAX_SCALE_SHARE = 0.999
"""Part of a divider's full scale above which pressures are indistinguishable."""


@compiled
@no_type_check
def linearise_counts(above: float, curve: PressureCurve) -> float:
    """Return the counts above rest that a linear device of the same gain would give."""
    if above <= 0.0 or curve.full_scale == np.inf:
        return max(above, 0.0)
    share = min(above / curve.full_scale, MAX_SCALE_SHARE)
    conductance = share / (1.0 - share)
    if curve.exponent != 1.0:
        conductance **= 1.0 / curve.exponent
    return curve.full_scale * conductance


@compiled
@no_type_check
def calibrate(
    counts: Int[np.ndarray, "taxel"],
    use: Bool[np.ndarray, "taxel"],
    now: float,
    gain: Float[np.ndarray, "taxel"],
    curve: PressureCurve,
    margin: Float[np.ndarray, "taxel"],
    starts: Int[np.ndarray, "taxel_and_one"],
    neighbours: Int[np.ndarray, "pair"],
    state: BaselineState,
    parameters: BaselineParameters,
    out: Float[np.ndarray, "taxel"],
) -> None:
    """Update the baselines with one scan and write the pressures [kPa] to `out`."""
    # Arrays are taken out of the tuples first: the compiled loops are faster so.
    baseline, peak = state.baseline, state.peak
    last_received, sample_count = state.last_received, state.sample_count
    touched_since, last_touched = state.touched_since, state.last_touched
    after, silence = parameters.after_fraction, parameters.silence_seconds
    size = state.samples.shape[1]
    for i in range(len(counts)):
        if not use[i]:
            out[i] = 0.0
            continue
        if sample_count[i] < size or now - last_received[i] > silence:
            update_tare(i, counts[i], now, margin[i], state, parameters)
        above = counts[i] - baseline[i]
        felt = linearise_counts(above, curve) * gain[i]
        out[i] = felt + min(felt, curve.unfelt)
        if above > margin[i] and above > after * peak[i]:
            if touched_since[i] == np.inf:
                touched_since[i] = now
            if not is_residual(i, above, now, margin, state, parameters):
                last_touched[i] = now
                for k in range(starts[i], starts[i + 1]):
                    last_touched[neighbours[k]] = now
        else:
            touched_since[i] = np.inf
    update_baselines(counts, use, now, margin, state, parameters)


@compiled
@no_type_check
def update_tare(
    i: int,
    count: int,
    now: float,
    margin: float,
    state: BaselineState,
    parameters: BaselineParameters,
) -> None:
    """Take a sample for the tare if one is due; start anew after long silence."""
    if now - state.last_received[i] > parameters.silence_seconds:
        state.sample_count[i] = 0
        state.next_sample[i] = now
        state.peak[i] = 0.0
        state.touched_since[i] = np.inf
        state.low[i] = np.inf
    size = state.sample_count[i]
    if now < state.next_sample[i]:
        return
    sample = float(count)
    if size >= SURE_SAMPLES and sample > state.baseline[i] + margin:
        sample = state.baseline[i]
    k = size
    while k > 0 and state.samples[i, k - 1] > sample:
        state.samples[i, k] = state.samples[i, k - 1]
        k -= 1
    state.samples[i, k] = sample
    state.sample_count[i] = size + 1
    state.baseline[i] = state.samples[i, int(parameters.tare_rank * (size + 1))]
    step = parameters.tare_seconds / parameters.tare_samples
    state.next_sample[i] = now + step


@compiled
@no_type_check
def is_residual(
    i: int,
    above: float,
    now: float,
    margin: Float[np.ndarray, "taxel"],
    state: BaselineState,
    parameters: BaselineParameters,
) -> bool:
    """Return whether counts show the residual of an earlier touch, and none now."""
    if now - state.steady_since[i] <= parameters.steady_seconds:
        return False
    return parameters.still * margin[i] < above < parameters.kept * margin[i]


@compiled
@no_type_check
def update_baselines(
    counts: Int[np.ndarray, "taxel"],
    use: Bool[np.ndarray, "taxel"],
    now: float,
    margin: Float[np.ndarray, "taxel"],
    state: BaselineState,
    parameters: BaselineParameters,
) -> None:
    """Let each baseline follow the counts as far as the taxel is untouched."""
    baseline, peak, low = state.baseline, state.peak, state.low
    last_received, sample_count = state.last_received, state.sample_count
    touched_since, last_touched = state.touched_since, state.last_touched
    steady_level, steady_since = state.steady_level, state.steady_since
    drift, relearn = parameters.drift_seconds, parameters.relearn_seconds
    freeze, fade = parameters.freeze_seconds, parameters.fade_seconds
    size = state.samples.shape[1]
    dt, drift_step, fading = 0.0, 0.0, 1.0
    for i in range(len(counts)):
        if not use[i]:
            continue
        if now - last_received[i] != dt:
            # Taxels of one patch have the same dt, and dividing is what costs.
            dt = now - last_received[i]
            drift_step, fading = dt / (drift + dt), fade / (fade + dt)
        last_received[i] = now
        if sample_count[i] < size:
            continue
        above = counts[i] - baseline[i]
        if abs(counts[i] - steady_level[i]) > parameters.still * margin[i]:
            steady_level[i], steady_since[i] = counts[i], now
        was_low = low[i]
        low[i] = np.inf
        step = 0.0
        if above < -margin[i] or (was_low < np.inf and above < 0.0):
            low[i] = counts[i]
            if was_low < np.inf:
                above = max(above, was_low - baseline[i])
                step = dt / (parameters.low_seconds + dt)
        elif last_touched[i] < now and is_residual(
            i, above, now, margin, state, parameters
        ):
            step = dt / (parameters.settle_seconds + dt)
        elif touched_since[i] < np.inf:
            if now - touched_since[i] > parameters.longest_seconds:
                step = dt / (parameters.stale_seconds + dt)
        elif now - last_touched[i] > freeze:
            step = drift_step if above <= margin[i] else dt / (relearn + dt)
        baseline[i] += step * above
        peak[i] *= fading
        if above > margin[i]:
            peak[i] = max(peak[i], above)
        elif peak[i] < margin[i]:
            peak[i] = 0.0


MIN_OTHERS = 0.3
"""Conductance of others, relative to half scale, whose share stands out of noise."""

MAX_DETOUR_SHARE = 0.02
"""Ratio of detours to lines below which a taxel shows leakage alone."""

MAX_CONDUCTANCE = 6.0
"""Conductance, relative to half scale, that a converter cannot resolve."""

MIN_SHARES = 8
"""Number of taxels of a patch that one observation needs."""

MAX_TOUCHED_SHARE = 0.25
"""Share of a patch that may be touched while crosstalk is estimated from it."""

MIN_TOUCHED = 0.1
"""Conductance from which a taxel counts as touched, relative to the patch's largest."""

SUBTRACTED = 2.5
"""How many times the estimate is subtracted. Taxels that the bend of the skin presses
at rest conduct detours, too, and rest does not show; from what is truly touched this
takes little."""

EPSILON = 1e-9
"""Conductance that is as good as none."""

LEAK, GHOST = 0, 1
"""The two parts that are estimated: leakage along lines, and ghosts by detours."""

MAX_ESTIMATE = (0.03, 0.15)
"""Greatest share that is believed of either part; above it a taxel is touched itself,
and nothing is learned."""

RANK = (0.4, 0.25)
"""Quantile of the shares that taxels show at one instant that is believed."""


class MatrixPatch(NamedTuple):
    """A patch has rows and columns that are read out together; with working buffers."""

    taxels: np.ndarray
    """(taxel) indices of its taxels in the skin."""
    rows: np.ndarray
    """(taxel) row of each, from 0."""
    columns: np.ndarray
    """(taxel) column of each, from 0."""
    half_scale: np.ndarray
    """(taxel) pressure at half scale, of a linear device at full scale [kPa]."""
    shown: np.ndarray
    """(row, column) measured conductance, relative to half scale; zero without a
    taxel."""
    own: np.ndarray
    """(row, column) the same without leakage."""
    row_sums: np.ndarray
    """(row) sums of `own`."""
    column_sums: np.ndarray
    """(column) sums of `own`."""
    lines: np.ndarray
    """(taxel) conductance of the others of its row and column."""
    detours: np.ndarray
    """(taxel) conductance of the paths over three others."""
    shares: np.ndarray
    """(taxel) ratio of its conductance to that of the others."""


class CrosstalkEstimate(NamedTuple):
    """An estimate holds the crosstalk of a device, and the observations behind it."""

    value: np.ndarray
    """(part) estimated shares."""
    seen: np.ndarray
    """(part) number of observations so far."""
    observed: np.ndarray
    """(part, observation) ring buffer of the latest of them."""


@compiled
@no_type_check
def compensate_patch(
    pressure: Float[np.ndarray, "skin"],
    valid: Bool[np.ndarray, "skin"],
    curve: PressureCurve,
    patch: MatrixPatch,
    estimate: CrosstalkEstimate,
) -> None:
    """Update the estimate from one patch, and subtract crosstalk from its pressures.

    Args:
        pressure: of the skin, zero where not valid [kPa]; written to.
        valid: which of it is valid.
        curve: of the device.
        patch: the patch.
        estimate: of the device; updated.
    """
    largest = write_conductance(pressure, curve, patch)
    patch.own[:] = patch.shown
    sum_others(patch)
    # The conductance of others contains leakage, too; the second pass is without it.
    leak = estimate.value[LEAK]
    for k in range(len(patch.taxels)):
        i, j = patch.rows[k], patch.columns[k]
        patch.own[i, j] = max(patch.shown[i, j] - leak * patch.lines[k], 0.0)
    sum_others(patch)
    few = compute_touched_share(patch, largest) <= MAX_TOUCHED_SHARE
    if largest < MAX_CONDUCTANCE and few:
        update_estimate(valid, patch, estimate)
    leak, ghost = estimate.value[LEAK], estimate.value[GHOST]
    for k in range(len(patch.taxels)):
        foreign = leak * patch.lines[k] + ghost * patch.detours[k]
        own = max(
            patch.shown[patch.rows[k], patch.columns[k]] - SUBTRACTED * foreign, 0.0
        )
        felt = own ** (1.0 / curve.exponent) * patch.half_scale[k]
        pressure[patch.taxels[k]] = felt + min(felt, curve.unfelt)


@compiled
@no_type_check
def write_conductance(
    pressure: Float[np.ndarray, "skin"], curve: PressureCurve, patch: MatrixPatch
) -> float:
    """Write the conductance that each taxel shows, and return the largest."""
    largest = 0.0
    for k in range(len(patch.taxels)):
        p = np.float64(pressure[patch.taxels[k]])
        felt = max(p - curve.unfelt, 0.5 * p)
        conductance = 0.0
        if felt > 0.0:
            conductance = (felt / patch.half_scale[k]) ** curve.exponent
        patch.shown[patch.rows[k], patch.columns[k]] = conductance
        largest = max(largest, conductance)
    return largest


@compiled
@no_type_check
def sum_others(patch: MatrixPatch) -> None:
    """Write the conductance of the others of each taxel's lines, and of detours."""
    own, row_sums, column_sums = patch.own, patch.row_sums, patch.column_sums
    row_sums[:] = 0.0
    column_sums[:] = 0.0
    total = 0.0
    for k in range(len(patch.taxels)):
        i, j = patch.rows[k], patch.columns[k]
        row_sums[i] += own[i, j]
        column_sums[j] += own[i, j]
        total += own[i, j]
    for k in range(len(patch.taxels)):
        i, j = patch.rows[k], patch.columns[k]
        row, column = row_sums[i] - own[i, j], column_sums[j] - own[i, j]
        rest = max(total - row - column - own[i, j], 0.0)
        series = (
            1.0 / (row + EPSILON) + 1.0 / (rest + EPSILON) + 1.0 / (column + EPSILON)
        )
        patch.lines[k] = row + column
        patch.detours[k] = 1.0 / series


@compiled
@no_type_check
def compute_touched_share(patch: MatrixPatch, largest: float) -> float:
    """Return the share of the patch's taxels that count as touched."""
    count = 0
    for k in range(len(patch.taxels)):
        shown = patch.shown[patch.rows[k], patch.columns[k]]
        count += shown > MIN_TOUCHED * largest
    return count / len(patch.taxels)


@compiled
@no_type_check
def update_estimate(
    valid: Bool[np.ndarray, "skin"], patch: MatrixPatch, estimate: CrosstalkEstimate
) -> None:
    """Observe leakage where there are no detours, then ghosts where there are."""
    lines, detours, count = patch.lines, patch.detours, 0
    for k in range(len(patch.taxels)):
        direct = lines[k] > MIN_OTHERS and detours[k] < MAX_DETOUR_SHARE * lines[k]
        if direct and valid[patch.taxels[k]]:
            shown = patch.shown[patch.rows[k], patch.columns[k]]
            patch.shares[count] = shown / lines[k]
            count += 1
    add_observation(LEAK, patch.shares[:count], estimate)
    leak, count = estimate.value[LEAK], 0
    for k in range(len(patch.taxels)):
        if detours[k] > 0.5 * MIN_OTHERS and valid[patch.taxels[k]]:
            shown = patch.shown[patch.rows[k], patch.columns[k]]
            patch.shares[count] = (shown - leak * lines[k]) / detours[k]
            count += 1
    add_observation(GHOST, patch.shares[:count], estimate)


@compiled
@no_type_check
def add_observation(
    part: int, shares: Float[np.ndarray, "some"], estimate: CrosstalkEstimate
) -> None:
    """Take a low quantile of the shares as an observation, if it is no touch."""
    if len(shares) < MIN_SHARES:
        return
    place = int(RANK[part] * (len(shares) - 1))
    observed = np.partition(shares, place)[place]
    if observed > MAX_ESTIMATE[part]:
        return
    ring = estimate.observed[part]
    ring[estimate.seen[part] % len(ring)] = max(observed, 0.0)
    estimate.seen[part] += 1
    used = min(estimate.seen[part], len(ring))
    estimate.value[part] = np.median(ring[:used])
