"""Compiled kernels that follow the rest of each taxel, and measure counts above it."""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

from collections import namedtuple
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float, Int
from pydantic import Field

from eskin.compiled import Packed, compiled
from eskin.files import Duration, Factor, Share
from eskin.touch.context import FrontEndContext, KernelScan
from eskin.touch.pressure_kernels import add_unfelt, linearise_counts
from eskin.touch.taxel_kernels import SHORTEST_PRESS, find_near

Taxels = Int[np.ndarray, "some"]
Values = Float[np.ndarray, "taxel"]
Flags = Bool[np.ndarray, "taxel"]


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings describe how baselines are tared and tracked. All times are in [s]."""

    tare_seconds: Duration = 2.0
    """Duration of the tare, which begins when a taxel is first received."""
    tare_samples: Annotated[int, Interval(ge=1, le=1000)] = 16
    """Number of samples of the tare."""
    tare_rank: Annotated[float, Interval(ge=0.0, le=0.99)] = 0.25
    """Quantile of the samples that is the baseline: low, to exclude touches."""
    drift_seconds: Duration = 10.0
    """Time constant of tracking the drift of an untouched taxel."""
    freeze_seconds: Duration = 3.0
    """How long after a touch the baselines of a taxel and its neighbours stay fixed."""
    longest_seconds: Duration = 120.0
    """Duration from which an uninterrupted touch counts as a change of the baseline."""
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
    """Largest difference that counts as no change, in units of that from which a taxel
    is clearly touched."""
    settle_seconds: Duration = 0.3
    """Time constant of tracking counts that do not change, and of lowering a baseline
    that is too high."""


RestParameters = namedtuple(
    "RestParameters", [field.name for field in fields(CalibrationConfig)]
)
"""The fields of a `CalibrationConfig` for compiled code."""

STALE_SECONDS = 0.5
"""Time without data, as of a faulty taxel, after which it is no longer touched."""
MIN_TARE_SAMPLES = 4
"""Number of samples from which one above the margin no longer raises the tare."""
LOW_SECONDS = 0.06
"""Time below rest after which it is lowered [s]: a corrupt value is of one scan."""
MATRIX_LINE_SHARE = 0.05
"""Largest share of the counts of a taxel that its row and its column show elsewhere in
a matrix that is read out by rows and columns."""


@compiled
def follow_rest(scan: KernelScan, packed_context: Packed, pressure: Values) -> None:
    """Update the rest of each taxel with a scan, and write the pressures [kPa].

    The pressure of a taxel whose data is not used is 0.
    """
    # Local references to the arrays make the compiled loops faster.
    context = packed_context.fields
    constants = context.constants
    curve = context.curve
    taxels = context.taxels
    now = scan.now
    size = context.samples.shape[1]
    touched = False
    pressed = False
    for i in range(len(taxels)):
        taxel = taxels[i]
        if not scan.used[i]:
            pressure[i] = 0.0
            if now - taxel.last_used > STALE_SECONDS:
                taxel.above = 0.0
                taxel.touched_since = np.inf
            continue
        count = scan.counts[i]
        if taxel.sample_count < size:
            take_sample(i, count, now, context)
        above = count - taxel.rest
        is_fast = now - taxel.last_used <= SHORTEST_PRESS
        taxel.confirmed = min(above, taxel.above) if is_fast else above
        taxel.above = above
        felt = linearise_counts(above, curve) * constants[i].gain
        pressure[i] = add_unfelt(felt, curve)
        if above > taxel.margin:
            touched = True
            if taxel.touched_since == np.inf:
                taxel.touched_since = now
        else:
            taxel.touched_since = np.inf
        pressed |= taxel.clear != 0
    if touched or pressed:
        mark_touched(scan, context)
    if context.line_share > 0.0:
        if touched:
            bound_crosstalk(scan, context)
        else:
            taxels.bound[:] = 0.0
    move_rest(scan, context)


@compiled
def is_touched(i: int, taxels: np.ndarray) -> bool:
    """Return whether the latest counts of a taxel were above its margin.

    They tell of it for `STALE_SECONDS`.
    """
    return taxels[i].touched_since < np.inf


@compiled
def mark_touched(scan: KernelScan, context: FrontEndContext) -> None:
    """Mark taxels that are touched and their neighbours, and raise their peaks."""
    taxels = context.taxels
    now = scan.now
    chosen = np.zeros(len(taxels), np.bool_)
    for i in range(len(taxels)):
        if scan.used[i] and (is_touched(i, taxels) or taxels[i].clear):
            chosen[i] = not is_residual(i, now, context)
    # What is residual depends on peaks, which are raised once all is known.
    for i in range(len(taxels)):
        if chosen[i]:
            taxels[i].last_touched = now
            for j in find_near(i, context.places.adjacency):
                near = taxels[j]
                near.last_touched = now
                near.peak = max(near.peak, taxels[i].confirmed)


@compiled
def take_sample(i: int, count: int, now: float, context: FrontEndContext) -> None:
    """Take a sample of the tare of a taxel if one is due."""
    taxel = context.taxels[i]
    parameters = context.rest
    if now < taxel.next_sample:
        return
    samples = context.samples[i]
    size = taxel.sample_count
    sample = float(count)
    if size >= MIN_TARE_SAMPLES and sample > taxel.rest + taxel.margin:
        sample = taxel.rest
    k = size
    while k > 0 and samples[k - 1] > sample:
        samples[k] = samples[k - 1]
        k -= 1
    samples[k] = sample
    taxel.sample_count = size + 1
    rank = min(max(parameters.tare_rank, 0.0), 1.0) * (size + 1)
    taxel.rest = samples[min(int(rank), size)]
    taxel.next_sample = now + parameters.tare_seconds / parameters.tare_samples


@compiled
def is_residual(i: int, now: float, context: FrontEndContext) -> bool:
    """Return whether counts above rest are steady, and no touch.

    They are the residual of a touch that pressed far more, or the offset of a single
    taxel.
    """
    taxel = context.taxels[i]
    parameters = context.rest
    if now - taxel.steady_since <= parameters.steady_seconds:
        return False
    least = max(parameters.steady_band * taxel.margin, context.taxels[i].bound)
    if taxel.above <= least:
        return False
    if taxel.above < parameters.residual * taxel.peak:
        return True
    for j in find_near(i, context.places.adjacency):
        if is_touched(j, context.taxels):
            return False
    return True


@compiled
def bound_crosstalk(scan: KernelScan, context: FrontEndContext) -> None:
    """Write how many counts the touched taxels of its lines may add to each taxel.

    Rest and noise are not learned where this explains what is measured.
    """
    taxels = context.taxels
    rows = context.places.rows
    columns = context.places.columns
    row_sums = np.zeros(len(rows.sizes))
    column_sums = np.zeros(len(columns.sizes))
    for i in range(len(taxels)):
        if scan.used[i] and is_touched(i, taxels):
            row_sums[rows.group_index[i]] += taxels[i].above
            column_sums[columns.group_index[i]] += taxels[i].above
    for i in range(len(taxels)):
        others = row_sums[rows.group_index[i]] + column_sums[columns.group_index[i]]
        if scan.used[i] and is_touched(i, taxels):
            others -= 2.0 * taxels[i].above
        context.taxels[i].bound = context.line_share * others


@compiled
def move_rest(scan: KernelScan, context: FrontEndContext) -> None:
    """Move the rest of each taxel towards its counts while it is untouched."""
    taxels = context.taxels
    parameters = context.rest
    now = scan.now
    band = parameters.steady_band
    freeze = parameters.freeze_seconds
    size = context.samples.shape[1]
    dt = 0.0
    drift_step = 0.0
    fading = 1.0
    for i in range(len(taxels)):
        if not scan.used[i]:
            continue
        taxel = taxels[i]
        count = scan.counts[i]
        margin = taxel.margin
        if now - taxel.last_used != dt:
            # Taxels of one patch have the same dt; divisions are expensive.
            dt = now - taxel.last_used
            drift_step = dt / (parameters.drift_seconds + dt)
            fading = parameters.fade_seconds / (parameters.fade_seconds + dt)
        taxel.last_used = now
        if taxel.sample_count < size:
            continue
        above = taxel.above
        if abs(count - taxel.steady_level) > band * margin:
            taxel.steady_level = count
            taxel.steady_since = now
        foreign = context.taxels[i].bound
        is_brief = now - taxel.touched_since <= parameters.longest_seconds
        if foreign > band * margin and abs(above) <= foreign and is_brief:
            taxel.low = taxel.low_since = np.inf
            continue
        if abs(above) <= margin and taxel.peak == 0.0 and taxel.low_since == np.inf:
            # Nearly all taxels of nearly all scans.
            if above <= band * margin and now - taxel.last_touched > freeze:
                taxel.rest += drift_step * above
                continue
        was_low = taxel.low
        since = taxel.low_since
        taxel.low = taxel.low_since = np.inf
        step = 0.0
        dip = max(margin, parameters.dip_share * taxel.peak)
        if above < -dip or (now - dt - since >= LOW_SECONDS and above < 0.0):
            taxel.low = count
            taxel.low_since = min(since, now)
            if now - since >= LOW_SECONDS:
                above = max(above, was_low - taxel.rest)
                step = dt / (parameters.settle_seconds + dt)
        elif (
            # Most taxels fail at this, before the context is handed over.
            above > band * margin
            and taxel.last_touched < now
            and is_residual(i, now, context)
        ):
            step = dt / (parameters.settle_seconds + dt)
        elif is_touched(i, taxels):
            if now - taxel.touched_since > parameters.longest_seconds:
                step = drift_step
        elif now - taxel.last_touched > freeze:
            step = drift_step
        taxel.rest += step * above
        taxel.peak *= fading
        if is_touched(i, taxels):
            taxel.peak = max(taxel.peak, taxel.confirmed)
        elif taxel.peak < margin:
            taxel.peak = 0.0
