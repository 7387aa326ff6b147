"""Compiled kernels that find faults: what a taxel, line or patch does, and no touch.

A touch changes counts from scan to scan, and takes neighbours along. What a taxel does
alone in one step, and what a line or patch does as a whole, is its own.
"""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

from collections import namedtuple
from dataclasses import dataclass, fields
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import Packed, compiled
from eskin.touch.adjacency import TaxelGroups
from eskin.touch.context import FrontEndContext, KernelScan
from eskin.touch.noise_kernels import (
    FOLLOWS,
    NOISE,
    SUSPICION,
    find_side,
    follow_noise,
    is_alone,
    limit_noise,
)
from eskin.touch.taxel_kernels import NEVER, NO_FAULT, find_near, select

Values = Float[np.ndarray, "taxel"]
Flags = Bool[np.ndarray, "taxel"]
Taxels = Int[np.ndarray, "some"]

STUCK, DEAD, NEGATIVE, SATURATED, NOISY = range(5)
"""Codes of the faults of a taxel."""
MIN_LEARNED = 0.3
"""Time from which the noise is known well enough to tell what is away from rest [s]:
before, whole patches would be doubted."""
SWING_SHARE = 0.25
"""Share of a patch that is above rest by more than noise, and soon after below it, as
no hand does."""


@final
class LoneStep(NamedTuple):
    """A step that one taxel makes alone is no touch, if it ends or stays flat."""

    sigmas: float = 6.6
    """Smallest step, in standard deviations of the noise."""
    max_interval: float = 0.03
    """Largest time between two scans in which no finger lands or lifts completely
    [s]."""
    flat: float = 0.25
    """Largest change of the counts in the scan before the step and in the scan after
    it, in units of the step. One end of it is as near to rest: a hand that is on a
    taxel changes its counts as it moves."""
    flat_seconds: float = 0.15
    """Time with flat counts after which the step is no touch [s]."""
    flat_scans: int = 7
    """Number of scans with flat counts after which the step is no touch."""
    max_flat_interval: float = 0.042
    """Largest time between two scans at which flat counts tell anything [s]."""


@final
class FaultyLine(NamedTuple):
    """A row or column is at fault as a whole by what many of its taxels do."""

    share: float = 1 / 3
    """Share of the line above which what its taxels do is taken for its own: more are
    faulty, or active. It is not connected, though some taxels do not show it at zero or
    full scale."""
    least: int = 3
    """Number of taxels from which a line can be faulty as a whole, and of its taxels
    away from rest or faulty from which it is doubted: beside a pressed taxel, one that
    was released may be below rest for a while."""
    mixed_share: float = 0.2
    """Share of the line above rest by more than noise, and another below it, that makes
    it doubtful: it is not connected."""
    even_size: int = 6
    """Number of its taxels from which it must not be pressed evenly."""
    even_spread: float = 0.2
    """Standard deviation of its counts above rest, in units of their mean, below which
    it is pressed evenly, as by hum and by no hand."""


LONE_STEP = LoneStep()
LINE = FaultyLine()


@dataclass(frozen=True)
class FaultConfig:
    """Thresholds define how clear signs of a fault must be. All times are in [s]."""

    check_seconds: float = 0.1
    """Period of the checks; negative counts are masked at once."""
    stuck_seconds: float = 5.0
    """Smallest time of constant counts of a stuck taxel while others of its patch show
    noise."""
    stuck_factor: float = 20.0
    """Smallest ratio of that time to the third quartile of its patch."""
    stuck_noise: float = 12.0**-0.5
    """Noise that three quarters of a patch must show for a taxel that stays at its rest
    to be stuck [counts], which is the deviation of rounding. Sound taxels of a quieter
    patch may show the same count for minutes."""
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
    """Time at zero from which a row or column is dead if it or its patch has an offset,
    and time without data from which a patch is silent."""
    recover_seconds: float = 30.0
    """Time without a sign of it after which a taxel is valid again, or no longer
    doubtful."""
    negative_seconds: float = 1.0
    """The same after negative counts, which are invalid one by one."""


FaultParameters = namedtuple(
    "FaultParameters", [field.name for field in fields(FaultConfig)]
)
"""The fields of a `FaultConfig` for compiled code."""


@compiled
def follow_faults(scan: KernelScan, packed_context: Packed) -> None:
    """Update the noise and the signs of faults of each taxel by a scan.

    Negative counts are faulty at once.
    """
    context = packed_context.fields
    note_counts(scan, context)
    low = follow_noise(scan, context)
    follow_steps(scan, context)
    is_known = scan.now >= MIN_LEARNED
    if is_known and (low > 0 or is_turned(context) or has_outage(scan)):
        find_swings(scan, context)


@compiled
def note_counts(scan: KernelScan, context: FrontEndContext) -> None:
    """Note when the counts of each taxel last did what tells of a fault."""
    taxels = context.taxels
    now = scan.now
    longest = context.faults.line_seconds
    for i in range(len(taxels)):
        if not scan.received[i]:
            continue
        taxel = taxels[i]
        count = scan.counts[i]
        if taxel.first_received == np.inf:
            taxel.first_received = taxel.last_changed = now
            taxel.counts = count
        # Time without data tells nothing of a taxel that shows the same count after it.
        unheard = now - taxel.last_received - min(scan.elapsed, longest)
        if taxel.last_received > NEVER and unheard > 0.0:
            taxel.last_changed += unheard
        taxel.last_received = now
        if count != taxel.counts:
            taxel.counts = count
            taxel.last_changed = now
            taxel.unanswered = 0.0
        if count < context.full_scale:
            taxel.last_below_full = now
        if count > 0:
            if taxel.last_nonzero < taxel.last_zero:
                taxel.least = 0.0
            elif taxel.least == 0.0:
                if now - taxel.last_zero > context.faults.saturated_seconds:
                    taxel.least = count
            elif count < taxel.least:
                taxel.least = count
            taxel.last_nonzero = now
        elif count == 0:
            taxel.last_zero = now
        else:
            taxel.last_negative = now
            scan.faulty[i] = True


@compiled
def follow_steps(scan: KernelScan, context: FrontEndContext) -> None:
    """Suspect taxels that stepped alone between the last two scans, or stay flat.

    So does one whose contact is intermittent. What touches goes on to press harder or
    more lightly, within a scan or two. At full scale all that presses is flat.
    """
    taxels = context.taxels
    forget = np.exp(-scan.elapsed / SUSPICION.fade_seconds)
    follows = scan.elapsed <= LONE_STEP.max_flat_interval
    for i in range(len(taxels)):
        taxel = taxels[i]
        taxel.suspicion *= forget
        if not scan.received[i]:
            taxel.flat_since = NEVER
            continue
        if not follows or scan.now - taxel.first_received < NOISE.seconds:
            taxel.flat_since = NEVER
            continue
        if taxel.flat_since > NEVER:
            follow_flat(i, scan, context)
        if abs(taxel.second - taxel.third) >= taxel.band:
            judge_step(i, scan, context)


@compiled
def follow_flat(i: int, scan: KernelScan, context: FrontEndContext) -> None:
    """Suspect a taxel that stays flat after a lone step for long enough."""
    taxel = context.taxels[i]
    long_flat = max(LONE_STEP.flat_seconds, LONE_STEP.flat_scans * scan.elapsed)
    if taxel.first >= context.full_scale:
        taxel.flat_since = NEVER
    elif abs(taxel.first - taxel.flat_level) > FOLLOWS * taxel.flat_step:
        taxel.flat_since = NEVER
    elif scan.now - taxel.flat_since >= long_flat:
        taxel.suspicion = SUSPICION.most
        taxel.flat_since = NEVER


@compiled
def judge_step(i: int, scan: KernelScan, context: FrontEndContext) -> None:
    """Suspect a taxel whose step was alone, and follow whether it stays flat."""
    taxel = context.taxels[i]
    step = taxel.second - taxel.third
    size = abs(step)
    contact = context.constants[i].contact
    least = max(LONE_STEP.sigmas * taxel.noise, contact, taxel.band)
    flat = LONE_STEP.flat * size
    rest = taxel.rest
    off_rest = min(abs(taxel.second - rest), abs(taxel.third - rest))
    before = abs(taxel.third - taxel.fourth)
    # A comparison with counts that are not known, which are NaN, is never true.
    if size < least or not max(off_rest, before) <= flat:
        return
    if not is_alone(i, size, context):
        return
    goes_on = abs(taxel.first - taxel.second) <= flat
    if scan.elapsed <= LONE_STEP.max_interval:
        if goes_on or abs(taxel.first - taxel.third) <= flat:
            taxel.suspicion = min(taxel.suspicion + 1.0, SUSPICION.most)
    least = max(least, LONE_STEP.sigmas / FOLLOWS * taxel.noise)
    if goes_on and min(step, taxel.second - rest) >= least:
        if taxel.first < context.full_scale:
            taxel.flat_since = scan.now - scan.elapsed
            taxel.flat_step = step
            taxel.flat_level = taxel.second


@compiled
def is_turned(context: FrontEndContext) -> bool:
    """Return whether it is known on which side of rest a part of a patch was."""
    for patch in context.patches:
        if patch.side != 0:
            return True
    return False


@compiled
def has_outage(scan: KernelScan) -> bool:
    """Return whether data of a scan counts as not received."""
    for i in range(len(scan.heard)):
        if scan.heard[i] != scan.received[i]:
            return True
    return False


@compiled
def find_swings(scan: KernelScan, context: FrontEndContext) -> None:
    """Find patches that swing about rest, and lines that are on both sides of it.

    Data of an outage swings with its patch. What the touched taxels of its lines may
    add to a taxel tells of no swing.
    """
    taxels = context.taxels
    away = np.empty(len(taxels), np.int64)
    count = 0
    for i in range(len(taxels)):
        above = abs(scan.counts[i] - taxels[i].rest)
        if scan.heard[i] and above > taxels[i].band + context.taxels[i].bound:
            away[count] = i
            count += 1
    places = context.places
    sides = count_sides(scan, away[:count], scan.heard, places.patches, context)
    follow_swings(scan.now, sides, context)
    for lines in (places.rows, places.columns):
        sides = count_sides(scan, away[:count], scan.received, lines, context)
        doubt_mixed_lines(scan.now, sides, lines, context)


@compiled
def count_sides(
    scan: KernelScan,
    away: Taxels,
    chosen: Flags,
    groups: TaxelGroups,
    context: FrontEndContext,
) -> Float[np.ndarray, "2 group"]:
    """Count the chosen ones of taxels away from rest: above it, and below it."""
    sides = np.zeros((2, len(groups.sizes)))
    for i in away:
        if chosen[i]:
            is_low = int(scan.counts[i] < context.taxels[i].rest)
            sides[is_low, groups.group_index[i]] += 1.0
    return sides


@compiled
def follow_swings(
    now: float, sides: Float[np.ndarray, "2 patch"], context: FrontEndContext
) -> None:
    """Suspect the taxels of patches that turn about rest, as by mains hum."""
    groups = context.places.patches
    for n in range(len(groups.sizes)):
        size = groups.sizes[n]
        patch = context.patches[n]
        side = 0
        if sides[0, n] / size >= SWING_SHARE:
            side = 1
        if sides[1, n] / size >= SWING_SHARE:
            side = -1
        if side not in (0, patch.side):
            if patch.side != 0:
                for i in groups.order[groups.starts[n] : groups.starts[n + 1]]:
                    taxel = context.taxels[i]
                    taxel.suspicion = min(taxel.suspicion + 1.0, SUSPICION.most)
            patch.side = side
            patch.turned_at = now
        if now - patch.turned_at > SUSPICION.fade_seconds:
            patch.side = 0


@compiled
def doubt_mixed_lines(
    now: float,
    sides: Float[np.ndarray, "2 line"],
    lines: TaxelGroups,
    context: FrontEndContext,
) -> None:
    """Doubt rows or columns that are partly above rest and partly below it.

    So does a line that is not connected, of which at least `LINE.least` taxels are away
    from rest. A hand presses, and presses nothing below rest.
    """
    for line in range(len(lines.sizes)):
        size = lines.sizes[line]
        high = sides[0, line]
        low = sides[1, line]
        is_mixed = high / size >= LINE.mixed_share and low / size >= LINE.mixed_share
        if high + low >= LINE.least and is_mixed:
            doubt_line(line, now, lines, context)


@compiled
def doubt_line(
    line: int, now: float, lines: TaxelGroups, context: FrontEndContext
) -> None:
    """Doubt all taxels of a row or column."""
    for i in lines.order[lines.starts[line] : lines.starts[line + 1]]:
        context.taxels[i].last_doubted = now


@compiled
def doubt_even_lines(scan: KernelScan, context: FrontEndContext) -> None:
    """Doubt rows and columns that are pressed evenly from end to end.

    That is where all taxels of one are about as far above rest.
    """
    taxels = context.taxels
    count = 0
    for i in range(len(taxels)):
        count += scan.received[i] and scan.counts[i] - taxels[i].rest > taxels[i].band
    if count < LINE.even_size:
        return
    for lines in (context.places.rows, context.places.columns):
        for line in range(len(lines.sizes)):
            if lines.sizes[line] < LINE.even_size:
                continue
            if is_even(line, scan, lines, context):
                doubt_line(line, scan.now, lines, context)


@compiled
def is_even(
    line: int, scan: KernelScan, lines: TaxelGroups, context: FrontEndContext
) -> bool:
    """Return whether a row or column is pressed evenly from end to end."""
    total = 0.0
    squares = 0.0
    for i in lines.order[lines.starts[line] : lines.starts[line + 1]]:
        above = scan.counts[i] - context.taxels[i].rest
        if not (scan.received[i] and above > context.taxels[i].band):
            return False
        total += above
        squares += above**2
    size = lines.sizes[line]
    mean = total / size
    return squares / size <= (1.0 + LINE.even_spread**2) * mean**2


@compiled
def check_faults(
    scan: KernelScan,
    pressure: Values,
    last_check: float,
    elapsed: float,
    packed_context: Packed,
) -> None:
    """Update what may be noise, and the fault of each taxel, by the signs of one.

    Args:
        scan: latest scan, whose faulty taxels are written.
        pressure: pressure of the taxels [kPa].
        last_check: time of the last check [s].
        elapsed: time since then that counts [s].
        packed_context: `FrontEndContext`.
    """
    context = packed_context.fields
    count = len(context.taxels)
    noisy = np.empty(count, np.bool_)
    lifted = np.empty(count, np.bool_)
    doubt_even_lines(scan, context)
    limit_noise(scan, context, noisy, lifted)
    update_unanswered(pressure, elapsed, scan, context)
    update_codes(last_check, scan, noisy, lifted, context)
    any_noisy = False
    for i in range(count):
        code = context.taxels[i].code
        scan.faulty[i] = code != NO_FAULT
        noisy[i] = code == NOISY
        any_noisy |= noisy[i]
    if any_noisy:
        for lines in (context.places.rows, context.places.columns):
            spread_line_faults(scan, noisy, lines, context)


@compiled
def spread_line_faults(
    scan: KernelScan, noisy: Flags, lines: TaxelGroups, context: FrontEndContext
) -> None:
    """Mark the taxels of rows or columns as faulty that are noisy in part.

    A line explains what is measured on it alone: a taxel that a hand presses or has
    left together with a sound one beside the line is doubtful instead.
    """
    index = lines.group_index
    counts = np.zeros(len(lines.sizes))
    for i in range(len(noisy)):
        counts[index[i]] += noisy[i]
    for line in range(len(counts)):
        count = counts[line]
        if count < LINE.least or count / lines.sizes[line] <= LINE.share:
            continue
        for i in lines.order[lines.starts[line] : lines.starts[line + 1]]:
            if is_touched_beside(i, line, noisy, lines, context):
                context.taxels[i].last_doubted = scan.now
            else:
                scan.faulty[i] = True


@compiled
def is_touched_beside(
    i: int, line: int, noisy: Flags, lines: TaxelGroups, context: FrontEndContext
) -> bool:
    """Return whether a taxel is away from rest as a sound one beside its line is."""
    side = find_side(i, context)
    if side != 0:
        for j in find_near(i, context.places.adjacency):
            if lines.group_index[j] != line and not noisy[j]:
                if find_side(j, context) == side:
                    return True
    return False


@compiled
def update_unanswered(
    pressure: Values, elapsed: float, scan: KernelScan, context: FrontEndContext
) -> None:
    """Add the elapsed time to taxels that do not respond while neighbours are pressed.

    Such a taxel has not changed since all its neighbours were at rest; one that is held
    down steadily changed when it was pressed.
    """
    taxels = context.taxels
    adjacency = context.places.adjacency
    least = context.faults.pressed
    highest = 0.0
    for each in pressure:
        highest = max(highest, each)
    for i in range(len(taxels)):
        taxel = taxels[i]
        known = 0
        count = 0
        if highest >= least:
            for j in find_near(i, adjacency):
                if scan.received[j] and not scan.faulty[j]:
                    known += 1
                    count += pressure[j] >= least
        if count == 0:
            taxel.last_unpressed = scan.now
        elif known >= 3 and count >= context.faults.pressed_share * known:
            if taxel.last_changed <= taxel.last_unpressed:
                taxel.unanswered += elapsed


@compiled
def has_offset(i: int, context: FrontEndContext) -> bool:
    """Return whether a taxel has had counts well above zero for long enough."""
    taxel = context.taxels[i]
    parameters = context.faults
    seconds = taxel.last_nonzero - taxel.first_received
    is_above = taxel.least >= parameters.offset * context.full_scale
    return seconds >= NOISE.seconds and is_above and taxel.least < np.inf


@compiled
def compute_stuck_seconds(context: FrontEndContext) -> Float[np.ndarray, "2 patch"]:
    """Return the seconds without a change that make a taxel of each patch stuck.

    Returns:
        Array of shape (2, number of patches) [s]: of a taxel away from its rest, and of
        one at its rest.
    """
    taxels = context.taxels
    patches = context.places.patches
    parameters = context.faults
    limits = np.full((2, len(patches.sizes)), np.inf)
    ages = np.empty(len(taxels))
    noises = np.empty(len(taxels))
    for patch in range(len(patches.sizes)):
        count = 0
        for i in patches.order[patches.starts[patch] : patches.starts[patch + 1]]:
            taxel = taxels[i]
            if taxel.counts > 0 and taxel.last_received > NEVER:
                ages[count] = taxel.last_received - taxel.last_changed
                noises[count] = taxel.noise
                count += 1
        if count > 0:
            usual = select(ages[:count], 3 * count // 4)
            seconds = max(parameters.stuck_seconds, parameters.stuck_factor * usual)
            limits[0, patch] = seconds
            if select(noises[:count], count // 4) >= parameters.stuck_noise:
                limits[1, patch] = seconds
    return limits


@compiled
def update_codes(
    last_check: float,
    scan: KernelScan,
    noisy: Flags,
    lifted: Flags,
    context: FrontEndContext,
) -> None:
    """Update the code of the fault of each taxel by the signs of one.

    Args:
        last_check: time of the last update [s].
        scan: latest scan.
        noisy: taxels that are noisy.
        lifted: taxels from which a hand has lifted that was taken for their rest.
        context: what is kept between scans.
    """
    now = scan.now
    taxels = context.taxels
    parameters = context.faults
    patches = context.places.patches
    rows = context.places.rows
    columns = context.places.columns
    stuck_seconds = compute_stuck_seconds(context)
    offsets = np.zeros(len(patches.sizes), np.int64)
    lost_rows = np.zeros(len(rows.sizes), np.int64)
    lost_columns = np.zeros(len(columns.sizes), np.int64)
    for i in range(len(taxels)):
        if has_offset(i, context):
            offsets[patches.group_index[i]] += 1
    has_rest = offsets / patches.sizes >= parameters.offset_share
    for i in range(len(taxels)):
        taxel = taxels[i]
        is_expected = has_rest[patches.group_index[i]] or has_offset(i, context)
        if taxel.counts == 0 and is_expected:
            since = max(taxel.last_nonzero, taxel.first_received)
            if taxel.last_received - since >= parameters.line_seconds:
                lost_rows[rows.group_index[i]] += 1
                lost_columns[columns.group_index[i]] += 1
    for i in range(len(taxels)):
        taxel = taxels[i]
        patch = patches.group_index[i]
        count = taxel.counts
        is_known = taxel.last_received > NEVER
        if not noisy[i]:
            taxel.last_sound = now
        age = taxel.last_received - taxel.last_changed
        rests = count > 0 and abs(count - taxel.rest) <= taxel.band
        still = (count > 0 or has_rest[patch]) and age > stuck_seconds[
            int(rests), patch
        ]
        still |= taxel.unanswered >= parameters.ignored_seconds
        still &= 0 <= count < context.full_scale
        row = rows.group_index[i]
        column = columns.group_index[i]
        lost = lost_rows[row] == rows.sizes[row] >= LINE.least
        lost |= lost_columns[column] == columns.sizes[column] >= LINE.least
        full = count >= context.full_scale and is_full_long(i, context)
        if is_known and still and count != 0:
            set_code(i, STUCK, taxel.last_changed, now, taxels)
        if is_known and ((still and count == 0) or lost):
            set_code(i, DEAD, taxel.last_changed, now, taxels)
        if is_known and taxel.last_negative > last_check:
            set_code(i, NEGATIVE, taxel.last_negative, now, taxels)
        if is_known and full:
            set_code(i, SATURATED, taxel.last_below_full, now, taxels)
        if is_known and noisy[i]:
            set_code(i, NOISY, taxel.last_sound, now, taxels)
        recover = parameters.recover_seconds
        if taxel.code == NEGATIVE:
            recover = parameters.negative_seconds
        is_over = now - taxel.last_found > recover
        if taxel.code == NOISY or taxel.code == SATURATED:
            is_over |= lifted[i] and not noisy[i]
        if is_over:
            taxel.code = NO_FAULT


@compiled
def is_full_long(i: int, context: FrontEndContext) -> bool:
    """Return whether a taxel is at full scale for longer than a touch, or still is."""
    taxel = context.taxels[i]
    begun = taxel.last_below_full
    limit = context.faults.saturated_seconds
    if begun < taxel.first_received:
        begun = taxel.first_received
        limit = context.faults.saturated_start_seconds
    return taxel.last_received - begun >= limit or taxel.code == SATURATED


@compiled
def set_code(i: int, code: int, begun: float, now: float, taxels: np.ndarray) -> None:
    """Set the code of the fault of a taxel that shows signs of it now."""
    taxel = taxels[i]
    if taxel.code != code:
        taxel.code = code
        taxel.since = max(begun, taxel.first_received)
    taxel.last_found = now
