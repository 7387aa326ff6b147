"""Compiled kernels that follow the counts of each taxel, and find invalid data."""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

from collections import namedtuple
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.belief_kernels import MIN_LINE, NEVER, CountScan
from eskin.touch.calibration_kernels import SILENCE_SECONDS, find_near, select

Values = Float[np.ndarray, "taxel"]
Flags = Bool[np.ndarray, "taxel"]
Index = Int[np.ndarray, "taxel"]

STUCK, DEAD, NEGATIVE, SATURATED, NOISY = range(5)
"""Codes of the faults of a taxel; -1 for none."""

HISTORY = np.dtype(
    [("counts", np.int64), ("code", np.int64)]
    + [
        (name, np.float64)
        for name in (
            *("first_received", "last_received", "last_changed", "last_negative"),
            *("last_below_full", "last_nonzero", "last_zero", "least"),
            *("last_unpressed", "unanswered", "last_sound", "since", "last_found"),
        )
    ]
)
"""The history of a taxel: its counts last received; the code of its fault; and times
[s]: of its first data, or of the first after a long silence; of its last data, of the
last change of its counts, and at which they were last negative, below full scale, above
zero and zero; `least`, its smallest counts above zero, zero after they left zero until
they are measured again some time later; when none of its neighbours was last pressed,
and for how long it did not respond while they were; when it was last no noisy taxel;
from when on it is faulty, and when evidence of that was last found."""


@dataclass(frozen=True)
class FaultConfig:
    """Thresholds define the evidence that a fault needs. All times are in [s]."""

    check_seconds: float = 0.1
    """Period of the checks; negative counts are masked at once."""
    stuck_seconds: float = 5.0
    """Smallest time of constant counts of a stuck taxel while others of its patch show
    noise."""
    stuck_factor: float = 20.0
    """Smallest ratio of that time to the third quartile of its patch."""
    offset: float = 0.01
    """Part of full scale from which rest differs from zero. A taxel with such an offset
    must not read zero; one that rests about zero may."""
    offset_share: float = 0.7
    """Share of a patch with such an offset from which a taxel that was always at zero
    is dead."""
    pressed: float = 10.0
    """Pressure on neighbours at which a taxel is expected to respond [kPa]."""
    pressed_share: float = 0.9
    """Share of neighbours that must have that pressure."""
    ignored_seconds: float = 1.0
    """Time without response to them from which a taxel is stuck or dead."""
    saturated_start_seconds: float = 5.0
    """Time at full scale, from the start on, that is no fault."""
    saturated_seconds: float = 60.0
    """Time at full scale, later on, that is no fault."""
    line_seconds: float = 0.5
    """Time at zero from which a row or column with an offset is dead, and time without
    data from which a patch is silent."""
    recover_seconds: float = 30.0
    """Time without evidence after which a taxel is valid again, or no longer
    doubtful."""
    negative_seconds: float = 1.0
    """The same after negative counts, which are invalid one by one."""
    offset_seconds: float = 1.0
    """Time above zero after which an offset of a taxel is known."""


FaultParameters = namedtuple(
    "FaultParameters", [field.name for field in fields(FaultConfig)]
)
"""The fields of a `FaultConfig` for compiled code."""


class FaultContext(NamedTuple):
    """A context holds the arguments of the kernels that are kept between scans."""

    full_scale: int  # Counts at which the converter saturates
    parameters: FaultParameters  # Thresholds
    adjacency: Adjacency  # Neighbours of each taxel
    patches: TaxelGroups  # Patches of the taxels
    rows: TaxelGroups  # Rows of the taxels
    columns: TaxelGroups  # Columns of the taxels
    history: np.ndarray  # (taxel) `HISTORY`, which is updated


def build_history(count: int) -> np.ndarray:
    """Build the history of a skin before its first scan."""
    history = np.zeros(count, HISTORY)
    for name in HISTORY.names or ():
        if name.startswith("last"):
            history[name] = NEVER
    history["last_sound"] = 0.0
    history["code"] = -1
    history["first_received"] = history["least"] = np.inf
    return history


@compiled
def update_history(
    scan: CountScan,
    full_scale: int,
    saturated_seconds: float,
    history: np.ndarray,
) -> None:
    """Update the history with a scan, and mask negative counts at once.

    At full scale for `saturated_seconds` is no fault.
    """
    counts, now = scan.counts, scan.now
    for i in range(len(counts)):
        if not scan.received[i]:
            continue
        taxel, count = history[i], counts[i]
        if now - taxel.last_received > SILENCE_SECONDS:
            reset_taxel(i, count, now, history)
        taxel.last_received = now
        if count != taxel.counts:
            taxel.counts, taxel.last_changed, taxel.unanswered = count, now, 0.0
        if count < full_scale:
            taxel.last_below_full = now
        if count > 0:
            if taxel.last_nonzero < taxel.last_zero:
                taxel.least = 0.0
            elif taxel.least == 0.0 and now - taxel.last_zero > saturated_seconds:
                taxel.least = count
            elif count < taxel.least:
                taxel.least = count
            taxel.last_nonzero = now
        elif count == 0:
            taxel.last_zero = now
        else:
            taxel.last_negative = now
            scan.mask[i] = True


@compiled
def reset_taxel(i: int, count: int, now: float, history: np.ndarray) -> None:
    """Reset the history of a taxel at its first data or the first after a silence."""
    taxel = history[i]
    taxel.first_received = taxel.last_changed = now
    taxel.counts, taxel.least, taxel.unanswered = count, np.inf, 0.0
    taxel.last_below_full = taxel.last_nonzero = -np.inf
    taxel.last_zero = taxel.last_unpressed = -np.inf


@compiled
def update_unanswered(
    pressure: Values, elapsed: float, scan: CountScan, context: FaultContext
) -> None:
    """Add the elapsed time to taxels that do not respond while neighbours are pressed.

    Such a taxel has not changed since all its neighbours were at rest; one that is held
    down steadily changed when it was pressed.
    """
    history, adjacency = context.history, context.adjacency
    least, highest = context.parameters.pressed, 0.0
    for each in pressure:
        highest = max(highest, each)
    for i in range(len(pressure)):
        taxel, known, count = history[i], 0, 0
        if highest >= least:
            for j in find_near(i, adjacency):
                if scan.received[j] and not scan.mask[j]:
                    known += 1
                    count += pressure[j] >= least
        if count == 0:
            taxel.last_unpressed = scan.now
        elif known >= 3 and count >= context.parameters.pressed_share * known:
            if taxel.last_changed <= taxel.last_unpressed:
                taxel.unanswered += elapsed


@compiled
def has_offset(taxel: np.void, full_scale: int, parameters: FaultParameters) -> bool:
    """Return whether a taxel has had counts well above zero for long enough."""
    seconds = taxel.last_nonzero - taxel.first_received
    is_above = taxel.least >= parameters.offset * full_scale
    return seconds >= parameters.offset_seconds and is_above and taxel.least < np.inf


@compiled
def compute_stuck_seconds(context: FaultContext) -> Values:
    """Return the seconds without a change that make a taxel of each patch stuck."""
    parameters, patches = context.parameters, context.patches
    history = context.history
    limits, ages = np.empty(len(patches.sizes)), np.empty(len(history))
    for patch in range(len(limits)):
        count = 0
        for i in patches.order[patches.starts[patch] : patches.starts[patch + 1]]:
            taxel = history[i]
            if taxel.counts > 0 and taxel.last_received > NEVER:
                ages[count] = taxel.last_received - taxel.last_changed
                count += 1
        limits[patch] = np.inf
        if count > 0:
            usual = select(ages[:count], 3 * count // 4)
            least = parameters.stuck_seconds
            limits[patch] = max(least, parameters.stuck_factor * usual)
    return limits


@compiled
def update_codes(
    pressure: Values,
    last_check: float,
    elapsed: float,
    scan: CountScan,
    noisy: Flags,
    lifted: Flags,
    context: FaultContext,
) -> None:
    """Update the code of the fault of each taxel by the evidence for it.

    Args:
        pressure: pressure of the taxels [kPa].
        last_check: time of the last update [s].
        elapsed: time since then that counts [s].
        scan: latest scan.
        noisy: taxels that are noisy.
        lifted: taxels from which a hand has lifted that was taken for their rest.
        context: what is kept between scans.
    """
    now, history, parameters = scan.now, context.history, context.parameters
    patches, rows, columns = context.patches, context.rows, context.columns
    update_unanswered(pressure, elapsed, scan, context)
    stuck_seconds = compute_stuck_seconds(context)
    offsets = np.zeros(len(patches.sizes), np.int64)
    lost_rows = np.zeros(len(rows.sizes), np.int64)
    lost_columns = np.zeros(len(columns.sizes), np.int64)
    row_index, column_index = rows.group_index, columns.group_index
    full_scale, patch_index = context.full_scale, patches.group_index
    for i in range(len(history)):
        taxel = history[i]
        if has_offset(taxel, full_scale, parameters):
            offsets[patch_index[i]] += 1
            seconds = taxel.last_received - taxel.last_nonzero
            if taxel.counts == 0 and seconds >= parameters.line_seconds:
                lost_rows[row_index[i]] += 1
                lost_columns[column_index[i]] += 1
    for i in range(len(history)):
        taxel, patch = history[i], patch_index[i]
        count, is_known = taxel.counts, taxel.last_received > NEVER
        if not noisy[i]:
            taxel.last_sound = now
        age = taxel.last_received - taxel.last_changed
        inside = 0 <= count < full_scale
        has_rest = offsets[patch] / patches.sizes[patch] >= parameters.offset_share
        still = (count > 0 or has_rest) and age > stuck_seconds[patch]
        still |= taxel.unanswered >= parameters.ignored_seconds
        still &= inside
        row, column = row_index[i], column_index[i]
        lost = lost_rows[row] == rows.sizes[row] >= MIN_LINE
        lost |= lost_columns[column] == columns.sizes[column] >= MIN_LINE
        full = count >= full_scale and is_full_long(taxel, parameters)
        if is_known and still and count != 0:
            set_code(taxel, STUCK, taxel.last_changed, now)
        if is_known and ((still and count == 0) or lost):
            set_code(taxel, DEAD, taxel.last_changed, now)
        if is_known and taxel.last_negative > last_check:
            set_code(taxel, NEGATIVE, taxel.last_negative, now)
        if is_known and full:
            set_code(taxel, SATURATED, taxel.last_below_full, now)
        if is_known and noisy[i]:
            set_code(taxel, NOISY, taxel.last_sound, now)
        recover = parameters.recover_seconds
        if taxel.code == NEGATIVE:
            recover = parameters.negative_seconds
        is_over = now - taxel.last_found > recover
        if taxel.code == NOISY or taxel.code == SATURATED:
            is_over |= lifted[i] and not noisy[i]
        if is_over:
            taxel.code = -1


@compiled
def is_full_long(taxel: np.void, parameters: FaultParameters) -> bool:
    """Return whether a taxel is at full scale for longer than a touch, or still is."""
    begun, limit = taxel.last_below_full, parameters.saturated_seconds
    if begun < taxel.first_received:
        begun, limit = taxel.first_received, parameters.saturated_start_seconds
    return taxel.last_received - begun >= limit or taxel.code == SATURATED


@compiled
def set_code(taxel: np.void, code: int, begun: float, now: float) -> None:
    """Set the code of the fault of a taxel, for which there is evidence now."""
    if taxel.code != code:
        taxel.code, taxel.since = code, max(begun, taxel.first_received)
    taxel.last_found = now
