"""Compiled kernels that estimate and remove the crosstalk of row-column arrays.

The current of a pressed taxel leaks into the others of its row and column. It also
takes detours over three taxels, so that a fourth, where touched rows and columns
cross, seems touched (a ghost). Both are proportional to the conductance of the others,
with coefficients that are the same all over a device. They are observed whenever it is
touched, as most of the taxels concerned are not touched themselves.
"""

# pyright: reportAttributeAccessIssue=false, reportReturnType=false
# Fields of records, and the types of what is computed, are known to numba only.
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import Packed, compiled
from eskin.touch.context import Crosstalk, FrontEndContext
from eskin.touch.pressure_kernels import add_unfelt, compute_felt, linearise_counts
from eskin.touch.taxel_kernels import select

Taxels = Int[np.ndarray, "some"]
Values = Float[np.ndarray, "taxel"]
Flags = Bool[np.ndarray, "taxel"]

EPSILON = 1e-9
"""Negligible conductance that prevents a division by zero."""
LEAK = 0
GHOST = 1
"""Indices of the two coefficients: leakage along lines, and ghosts by detours."""


@final
class CrosstalkObservation(NamedTuple):
    """A small touch shows the two coefficients on the taxels that it does not touch."""

    min_pressure: float = 1.5
    """Greatest pressure of a patch up to which crosstalk is ignored [kPa]."""
    min_touched: float = 0.3
    """Conductance of a touched taxel over the largest of its patch: crosstalk along the
    lines of a hand shows less."""
    max_touched_share: float = 0.25
    """Largest fraction of a patch that may be touched."""
    min_others: float = 0.3
    """Smallest conductance of the others, relative to half scale."""
    min_shares: int = 8
    """Smallest number of taxels that show it."""
    quantiles: tuple[float, float] = (0.4, 0.25)
    """Quantile of the shares of all taxels that is taken for each coefficient."""
    most: tuple[float, float] = (0.08, 0.15)
    """Largest value of each coefficient; a larger one is due to a touch and is
    discarded."""
    ghost_factor: float = 2.5
    """Factor by which ghosts are subtracted. Taxels that the bend of the skin presses
    at rest conduct detours too, but do not show in pressures above rest. Touched taxels
    lose little by the factor."""


CROSSTALK = CrosstalkObservation()


@compiled
def compensate(pressure: Values, valid: Flags, packed_context: Packed) -> None:
    """Update the estimate, and remove crosstalk from pressures [kPa].

    Pressures are zero where not valid.
    """
    context = packed_context.fields
    groups = context.places.patches
    for n in range(len(groups.sizes)):
        members = groups.order[groups.starts[n] : groups.starts[n + 1]]
        greatest = 0.0
        for i in members:
            greatest = max(greatest, float(pressure[i]))
        if greatest > CROSSTALK.min_pressure:
            compensate_patch(members, pressure, valid, context)


@compiled
def compensate_patch(
    members: Taxels, pressure: Values, valid: Flags, context: FrontEndContext
) -> None:
    """Update the estimate from one patch, and remove crosstalk from its pressures."""
    shown = context.crosstalk.shown
    exponent = context.curve.exponent
    largest = 0.0
    for i in members:
        felt = compute_felt(np.float64(pressure[i]), context.curve)
        scale = context.constants[i].gain * context.full_scale
        shown[i] = (felt / scale) ** exponent if felt > 0.0 else 0.0
        largest = max(largest, shown[i])
    touched = CROSSTALK.min_touched * largest
    count = 0
    for i in members:
        count += shown[i] > touched
    is_small = count <= CROSSTALK.max_touched_share * len(members)
    if is_small:
        observe_leak(members, touched, valid, context)
    remove_leak(members, context)
    write_detours(members, context)
    if is_small:
        observe_ghost(members, valid, context)
    for i in members:
        own = remove_ghost(i, context.crosstalk)
        scale = context.constants[i].gain * context.full_scale
        pressure[i] = add_unfelt(own ** (1.0 / exponent) * scale, context.curve)


@compiled
def find_own(members: Taxels, counts: Taxels, context: FrontEndContext) -> None:
    """Write the conductances of a patch by its counts above rest, without crosstalk."""
    for i in members:
        above = counts[i] - context.taxels[i].rest
        context.crosstalk.shown[i] = compute_conductance(above, context)
    remove_leak(members, context)
    write_detours(members, context)
    for i in members:
        context.crosstalk.own[i] = remove_ghost(i, context.crosstalk)


@compiled
def compute_conductance(above: float, context: FrontEndContext) -> float:
    """Return the conductance at counts above rest, relative to half scale."""
    share = linearise_counts(above, context.curve) / context.full_scale
    return share**context.curve.exponent


@compiled
def remove_ghost(i: int, crosstalk: Crosstalk) -> float:
    """Return the own conductance of a taxel without its ghost."""
    ghost = CROSSTALK.ghost_factor * crosstalk.value[GHOST] * crosstalk.detours[i]
    return max(crosstalk.own[i] - ghost, 0.0)


@compiled
def sum_lines(
    members: Taxels, values: Values, least: float, context: FrontEndContext
) -> float:
    """Write the sums of the values above a least one along lines; return their sum."""
    rows = context.places.rows.group_index
    columns = context.places.columns.group_index
    row_sums = context.crosstalk.row_sums
    column_sums = context.crosstalk.column_sums
    for i in members:
        row_sums[rows[i]] = 0.0
        column_sums[columns[i]] = 0.0
    total = 0.0
    for i in members:
        if values[i] > least:
            row_sums[rows[i]] += values[i]
            column_sums[columns[i]] += values[i]
            total += values[i]
    return total


@compiled
def observe_leak(
    members: Taxels, touched: float, valid: Flags, context: FrontEndContext
) -> None:
    """Observe leakage on taxels of which one line is touched, and the other is not."""
    crosstalk = context.crosstalk
    rows = context.places.rows.group_index
    columns = context.places.columns.group_index
    sum_lines(members, crosstalk.shown, touched, context)
    count = 0
    for i in members:
        row = crosstalk.row_sums[rows[i]]
        column = crosstalk.column_sums[columns[i]]
        line = max(row, column)
        if min(row, column) == 0.0 and line > CROSSTALK.min_others and valid[i]:
            crosstalk.shares[count] = crosstalk.shown[i] / line
            count += 1
    add_observation(LEAK, count, crosstalk)


@compiled
def remove_leak(members: Taxels, context: FrontEndContext) -> None:
    """Write the conductances that show as measured once lines have leaked.

    A taxel shows its own conductance and a share of all others of its row and
    column. Sums over rows, columns and the patch solve these equations where each
    crossing has a taxel, and nearly so elsewhere.
    """
    crosstalk = context.crosstalk
    rows = context.places.rows
    columns = context.places.columns
    leak = crosstalk.value[LEAK]
    kept = 1.0 - 2.0 * leak
    total = sum_lines(members, crosstalk.shown, 0.0, context)
    sizes = 0.0
    for i in members:
        sizes += rows.sizes[rows.group_index[i]]
        sizes += columns.sizes[columns.group_index[i]]
    total /= kept + leak * sizes / len(members)
    for i in members:
        row = rows.group_index[i]
        column = columns.group_index[i]
        in_row = crosstalk.row_sums[row] - leak * total
        in_row /= kept + leak * rows.sizes[row]
        in_column = crosstalk.column_sums[column] - leak * total
        in_column /= kept + leak * columns.sizes[column]
        others = max(in_row, 0.0) + max(in_column, 0.0)
        own = (crosstalk.shown[i] - leak * others) / kept
        crosstalk.own[i] = min(max(own, 0.0), crosstalk.shown[i])


@compiled
def write_detours(members: Taxels, context: FrontEndContext) -> None:
    """Write the conductance of the detours of each taxel over three others."""
    crosstalk = context.crosstalk
    rows = context.places.rows.group_index
    columns = context.places.columns.group_index
    total = sum_lines(members, crosstalk.own, 0.0, context)
    for i in members:
        own = crosstalk.own[i]
        row = crosstalk.row_sums[rows[i]] - own
        column = crosstalk.column_sums[columns[i]] - own
        rest = max(total - row - column - own, 0.0)
        resistance = 1.0 / (row + EPSILON) + 1.0 / (column + EPSILON)
        crosstalk.detours[i] = 1.0 / (resistance + 1.0 / (rest + EPSILON))


@compiled
def observe_ghost(members: Taxels, valid: Flags, context: FrontEndContext) -> None:
    """Observe ghosts where detours conduct much."""
    crosstalk = context.crosstalk
    count = 0
    for i in members:
        if crosstalk.detours[i] > 0.5 * CROSSTALK.min_others and valid[i]:
            crosstalk.shares[count] = crosstalk.own[i] / crosstalk.detours[i]
            count += 1
    add_observation(GHOST, count, crosstalk)


@compiled
def add_observation(part: int, count: int, crosstalk: Crosstalk) -> None:
    """Add a quantile of the shares as an observation, unless it is due to a touch."""
    if count < CROSSTALK.min_shares:
        return
    place = int(CROSSTALK.quantiles[part] * (count - 1))
    observed = select(crosstalk.shares[:count], place)
    if observed > CROSSTALK.most[part]:
        return
    ring = crosstalk.observed[part]
    ring[crosstalk.seen[part] % len(ring)] = max(observed, 0.0)
    crosstalk.seen[part] += 1
    used = min(crosstalk.seen[part], len(ring))
    for k in range(used):
        crosstalk.ranked[k] = ring[k]
    ranked = crosstalk.ranked[:used]
    low = select(ranked, (used - 1) // 2)
    high = select(ranked, used // 2)
    crosstalk.value[part] = (low + high) / 2.0
