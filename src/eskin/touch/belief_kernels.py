"""Compiled kernels that follow what each taxel does at rest, and what no touch does.

A touch presses: it raises counts above rest, changes them from scan to scan, and takes
neighbours along. All that a taxel does below rest, or alone in one step, is its own.
"""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.calibration_kernels import (
    SHORTEST_PRESS,
    PressureCurve,
    add_unfelt,
    find_near,
    linearise_counts,
    select,
)

Taxels = Int[np.ndarray, "some"]
Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]

CLEAR_FACTOR = 2.0
"""Smallest signal that is clearly no noise, in units of what may be noise."""
NOISE_SECONDS, WANDER_SECONDS = 1.0, 20.0
"""Time constants of the estimates of fast noise and of wandering about rest [s]. Noise
that is not calibrated is learned for the first of them after the first data."""
MOST_PART = 0.04
"""Largest weight of one scan in the estimate of the noise; of wandering in
proportion: no memory moves far by one scan, however long ago the last one was."""
OUTLIER, LEAST_OUTLIER = 3.0, 0.5
"""Largest value that an estimate takes in as it is, in units of itself, and of the
counts at which contact begins."""
BELOW_FACTOR = 5.0
"""Factor of the weight by which the noise falls while a taxel is below rest: what
pressed there when the skin was switched on has lifted, and its noise was that of a
hand."""
BEND_SIGMAS = 6.0**0.5
"""Standard deviation of the second difference of white noise, in units of its own."""
MAX_GAP = 0.15
"""Largest time between two scans whose counts are compared [s]."""
ODDS_SECONDS = 10.0
"""Time constant with which evidence of a fault counts for less [s]."""
MOST_ODDS = 2.0
"""Largest evidence, as of a lone step after which a taxel stays flat; a lone step that
lasts two scans, or is gone after one, counts for one."""
FOLLOWS = 0.2
"""Smallest change that counts beside a step, in units of it: of a neighbour that takes
part in it, or of counts that were flat after a lone rise. A rise of which noise hides
such a change tells nothing."""
STEP_SIGMAS, FLAT = 6.6, 0.25
"""Smallest lone step, in standard deviations of the noise, and largest change of the
counts in the scan before it and in that after it, in units of the step. One end of it
is as near to rest: a hand that is on a taxel changes its counts as it moves."""
FLAT_SECONDS, FLAT_SCANS = 0.15, 7
"""Time [s] and number of scans with flat counts after which such a step is no touch."""
MAX_STEP_INTERVAL, MAX_FLAT_INTERVAL = 0.03, 0.042
"""Largest time between two scans in which no finger lands or lifts completely, and at
which flat counts tell anything [s]."""
NEVER = -1e9
"""Time before all others [s]."""

MIN_NOISE, MIN_NOISE_CONTACTS = (2.0, 4.0), 2.0
"""Limits of the smallest difference from rest that may be noise [counts], and what it
is between them, in units of the counts at which contact begins: converters round, and
coarse ones would feel no light touch."""
NOISE_SIGMAS, WANDER_SIGMAS = 6.0, 5.0
"""Signal that may be noise, in standard deviations of the noise from scan to scan, and
of wandering about rest."""
WANDER_SHARE = 0.7
"""Smallest wandering of a taxel, in units of the median of its patch: where rest was
learned too low, none is seen below it."""
MAX_BAND, MAX_WANDER_BAND = 4.0, 1.5
"""Largest distance from rest that is left to noise, and to wandering, in units of the
counts at which contact begins: a patch that swings further feels no touch."""
LINE_SHARE = 1 / 3
"""Share of a row or column above which what its taxels do is taken for its own: more
are faulty, or active. It is not connected, though some taxels do not show it at zero
or full scale."""
MIN_LINE = 3
"""Number of taxels from which a row or column can be faulty as a whole, and of its
taxels away from rest or faulty from which it is doubted: beside a pressed taxel, one
that was released may be below rest for a while."""
MIN_LEARNED = 0.3
"""Time from which the noise is known well enough to tell what is away from rest [s]."""
LEARN_SCANS = 40
"""Number of scans from which noise is known well enough for a fault."""
START_FLOOR = 7.0
"""Pressure that may be noise while the noise is neither calibrated nor learned yet
[kPa]."""
NOISY_CONTACTS, DOUBTFUL_SHARE = 0.55, 0.5
"""Noise that makes a taxel a fault, in units of the counts at which contact begins, but
at least what rounding converters may show of any sound taxel; and share of it from
which a taxel is doubtful: it may stop an arm, and nothing else."""
NOISIER = 2.5
"""Smallest ratio of the noise of such a taxel to the median of its patch."""
FAULTY = 1.5
"""Evidence from which a taxel is a fault."""
SWING_SHARE = 0.25
"""Share of a patch that is above rest by more than noise, and soon after below it, as
no hand does."""
MIXED_SHARE = 0.2
"""Share of a row or column above rest by more than noise, and another below it, that
makes it doubtful: it is not connected."""
EVEN_SIZE, EVEN_SPREAD = 6, 0.2
"""Number of taxels of a row or column from which it must not be pressed evenly, and
standard deviation of its counts above rest, in units of their mean, below which it is
pressed evenly, as by hum and by no hand."""
BELIEF = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("first", "second", "third", "fourth"),
            *("noise", "start_noise", "wander", "odds"),
            *("flat_since", "flat_level", "flat_step"),
        )
    ]
)
"""What is believed of a taxel: its counts in the latest four scans, NaN where they are
not known; standard deviations of its noise from scan to scan, of that as calibrated (0
for none), and of its wandering about rest [counts]; the evidence that it is faulty;
and since when it has been flat after a lone step [s],
at which counts, after which step."""

SWING = np.dtype([("sign", np.int64), ("turned_at", np.float64)])
"""What is believed of a patch: on which side of rest a part of it was, 1 above, -1
below, 0 if it is not known, and since when [s]."""


class BeliefContext(NamedTuple):
    """A context holds the arguments of the kernels that are kept between scans."""

    contact: np.ndarray  # (taxel) counts above rest at which contact begins
    least: np.ndarray  # (taxel) smallest counts above rest that may be noise
    gain: np.ndarray  # (taxel) gain [kPa/count]
    curve: PressureCurve  # Relation of pressure and counts
    adjacency: Adjacency  # Neighbours of each taxel
    patches: TaxelGroups  # Patches of the taxels
    rows: TaxelGroups  # Rows of the taxels
    columns: TaxelGroups  # Columns of the taxels
    belief: np.ndarray  # (taxel) `BELIEF`
    swings: np.ndarray  # (patch) `SWING`
    last_doubted: np.ndarray  # (taxel) time at which it was last doubtful [s]


class NoiseLimits(NamedTuple):
    """Limits (taxel) tell what may be noise, and which taxels are noisy."""

    counts: np.ndarray
    """Counts above rest up to which they are noise."""
    band: np.ndarray
    """Counts from which a taxel is away from rest, for faults."""
    floor: np.ndarray
    """Pressure up to which it is noise, larger while noise is learned [kPa]."""
    noisy: np.ndarray
    """Whether the taxel is faulty."""
    lifted: np.ndarray
    """Whether the taxel and a neighbour have been below rest in the latest scans. A
    hand was on them when the skin was switched on, and has lifted: its pressure was
    taken for the rest, and its noise for that of the taxel."""


class CountScan(NamedTuple):
    """A scan is passed to the kernels in this form."""

    counts: np.ndarray
    """(taxel) counts."""
    received: np.ndarray
    """(taxel) which counts are new."""
    rest: np.ndarray
    """(taxel) counts at rest."""
    peak: np.ndarray
    """(taxel) recent peak of its counts above rest, which fades."""
    dip_share: float
    """Share of it by which its sensor may fall below rest after a press."""
    band: np.ndarray
    """(taxel) counts from which it is away from rest."""
    mask: np.ndarray
    """(taxel) which are faulty; those with negative counts are added."""
    first_received: np.ndarray
    """(taxel) time of the first data, or of the first after a long silence [s]."""
    now: float
    """Time at which it was taken, since the first scan [s]."""
    elapsed: float
    """Time since the last scan [s]."""


@compiled(error_model="numpy")
def update_belief(
    scan: CountScan,
    contact: Values,
    full_scale: float,
    adjacency: Adjacency,
    belief: np.ndarray,
) -> int:
    """Update what is believed of each taxel by a scan.

    The noise is the root mean square of second differences, as of white noise, where no
    touch can cause them: the first and third scan not above the band about rest, nor,
    where a press may lie between slow scans, the second with that of a neighbour; and
    where the noise of a noisy taxel falls, or it is masked and scans are too fast for a
    press. The depth below rest, beyond the dip after a press, gives the wandering. Lone
    steps are evidence of a fault.

    Returns:
        How many taxels are away from rest, below it.
    """
    now, elapsed, counts = scan.now, scan.elapsed, scan.counts
    fast = min(elapsed / NOISE_SECONDS, MOST_PART)
    slow = fast * NOISE_SECONDS / WANDER_SECONDS
    forget = np.exp(-elapsed / ODDS_SECONDS)
    follows = elapsed <= MAX_FLAT_INTERVAL
    is_fast = 2.0 * elapsed <= SHORTEST_PRESS
    alone, count_alone, low = np.empty(len(counts), np.int64), 0, 0
    for i in range(len(counts)):
        taxel = belief[i]
        if scan.first_received[i] == now:
            reset_belief(i, belief)
        taxel.fourth, taxel.third = taxel.third, taxel.second
        taxel.second = taxel.first
        if elapsed > MAX_GAP:
            taxel.second = np.nan
        taxel.first = counts[i] if scan.received[i] else np.nan
        taxel.odds *= forget
    for i in range(len(counts)):
        taxel = belief[i]
        if not scan.received[i]:
            taxel.flat_since = NEVER
            continue
        band, rest, limit = scan.band[i], scan.rest[i], LEAST_OUTLIER * contact[i]
        above = taxel.first - rest
        since = now - scan.first_received[i]
        bend = taxel.first - 2.0 * taxel.second + taxel.third
        learns = taxel.start_noise == 0.0
        starts = learns and since < NOISE_SECONDS
        seen = abs(bend) / BEND_SIGMAS
        calms = seen < taxel.noise and taxel.noise > limit
        rests = max(taxel.first, taxel.third) - rest <= band
        between = taxel.second - rest
        if rests and between > band and not is_fast:
            rests = is_alone(i, between, adjacency, belief)
        if starts or rests or calms or (is_fast and scan.mask[i]):
            part = max(fast, elapsed / (since + elapsed)) if learns else fast
            if above < -contact[i] and seen < taxel.noise:
                if is_lifted(i, scan.rest, contact, adjacency, belief):
                    part = min(BELOW_FACTOR * part, 1.0)
            taxel.noise = follow(taxel.noise, seen, limit, part)
        if above < 0.0:
            low += above < -band
            depth = -above - scan.dip_share * scan.peak[i]
            if depth > 0.0:
                part = max(slow, elapsed / (since + elapsed))
                taxel.wander = follow(taxel.wander, depth, limit, part)
        if not follows or since < NOISE_SECONDS:
            taxel.flat_since = NEVER
        elif taxel.flat_since > NEVER or abs(taxel.second - taxel.third) >= band:
            alone[count_alone] = i
            count_alone += 1
    for i in alone[:count_alone]:
        follow_steps(i, scan, contact[i], full_scale, adjacency, belief)
    return low


@compiled
def reset_belief(i: int, belief: np.ndarray) -> None:
    """Forget a taxel at its first data, or the first after a silence."""
    taxel = belief[i]
    taxel.first = taxel.second = taxel.third = taxel.fourth = np.nan
    taxel.noise = taxel.start_noise
    taxel.wander = taxel.odds = 0.0
    taxel.flat_since = NEVER


@compiled
def follow(estimate: float, seen: float, limit: float, part: float) -> float:
    """Return a root mean square after one more value; NaN is none."""
    if not seen >= 0.0:
        return estimate
    seen = min(seen, max(OUTLIER * estimate, limit))
    return np.sqrt(estimate**2 + part * (seen**2 - estimate**2))


@compiled
def follow_steps(
    i: int,
    scan: CountScan,
    contact: float,
    full_scale: float,
    adjacency: Adjacency,
    belief: np.ndarray,
) -> None:
    """Follow a taxel that stepped alone between the last two scans, or is flat since.

    So does one whose contact is intermittent. What touches goes on to press harder or
    more lightly, within a scan or two. At full scale all that presses is flat.
    """
    taxel, rest, band = belief[i], scan.rest[i], scan.band[i]
    if taxel.first >= full_scale:
        taxel.flat_since = NEVER
    if taxel.flat_since > NEVER:
        if abs(taxel.first - taxel.flat_level) > FOLLOWS * taxel.flat_step:
            taxel.flat_since = NEVER
        elif scan.now - taxel.flat_since >= max(
            FLAT_SECONDS, FLAT_SCANS * scan.elapsed
        ):
            taxel.odds, taxel.flat_since = MOST_ODDS, NEVER
    step = taxel.second - taxel.third
    size = abs(step)
    least, flat = max(STEP_SIGMAS * taxel.noise, contact, band), FLAT * size
    off_rest = min(abs(taxel.second - rest), abs(taxel.third - rest))
    if size < least or not max(off_rest, abs(taxel.third - taxel.fourth)) <= flat:
        return
    if is_alone(i, size, adjacency, belief):
        goes_on = abs(taxel.first - taxel.second) <= flat
        if scan.elapsed <= MAX_STEP_INTERVAL:
            if goes_on or abs(taxel.first - taxel.third) <= flat:
                taxel.odds = min(taxel.odds + 1.0, MOST_ODDS)
        least = max(least, STEP_SIGMAS / FOLLOWS * taxel.noise)
        if goes_on and min(step, taxel.second - rest) >= least:
            if taxel.first < full_scale:
                taxel.flat_since, taxel.flat_step = scan.now - scan.elapsed, step
                taxel.flat_level = taxel.second


@compiled
def is_alone(i: int, step: float, adjacency: Adjacency, belief: np.ndarray) -> bool:
    """Return whether no neighbour of a taxel took part in its step."""
    for j in find_near(i, adjacency):
        near = belief[j]
        change = abs(near.second - near.third)
        if change >= FOLLOWS * step:
            return False
    return True


@compiled
def find_swings(scan: CountScan, heard: Flags, context: BeliefContext) -> None:
    """Find patches that swing about rest, and lines that are on both sides of it.

    `heard` are the received taxels, and refused ones, which swing with their patch.
    """
    away, count = np.empty(len(heard), np.int64), 0
    for i in range(len(heard)):
        if heard[i] and abs(scan.counts[i] - scan.rest[i]) > scan.band[i]:
            away[count] = i
            count += 1
    sides = count_sides(scan, away[:count], heard, context.patches)
    follow_swings(scan.now, sides, context)
    for lines in (context.rows, context.columns):
        sides = count_sides(scan, away[:count], scan.received, lines)
        doubt_mixed_lines(scan.now, sides, lines, context.last_doubted)


@compiled
def count_sides(
    scan: CountScan, away: Taxels, chosen: Flags, groups: TaxelGroups
) -> Float[np.ndarray, "2 group"]:
    """Count the chosen ones of taxels away from rest: above it, and below it."""
    sides = np.zeros((2, len(groups.sizes)))
    for i in away:
        if chosen[i]:
            is_low = int(scan.counts[i] < scan.rest[i])
            sides[is_low, groups.group_index[i]] += 1.0
    return sides


@compiled
def follow_swings(
    now: float, sides: Float[np.ndarray, "2 patch"], context: BeliefContext
) -> None:
    """Take turns of whole patches about rest, as of mains hum, for evidence."""
    patches, belief = context.patches, context.belief
    for patch in range(len(patches.sizes)):
        size, swing, sign = patches.sizes[patch], context.swings[patch], 0
        if sides[0, patch] / size >= SWING_SHARE:
            sign = 1
        if sides[1, patch] / size >= SWING_SHARE:
            sign = -1
        if sign not in (0, swing.sign):
            if swing.sign != 0:
                first, end = patches.starts[patch], patches.starts[patch + 1]
                for i in patches.order[first:end]:
                    belief[i].odds = min(belief[i].odds + 1.0, MOST_ODDS)
            swing.sign, swing.turned_at = sign, now
        if now - swing.turned_at > ODDS_SECONDS:
            swing.sign = 0


@compiled
def doubt_mixed_lines(
    now: float,
    sides: Float[np.ndarray, "2 line"],
    lines: TaxelGroups,
    last_doubted: Values,
) -> None:
    """Doubt rows or columns that are partly above rest and partly below it.

    So does a line that is not connected, of which at least `MIN_LINE` taxels are away
    from rest; a hand presses, and presses nothing below rest.
    """
    for line in range(len(lines.sizes)):
        size, high, low = lines.sizes[line], sides[0, line], sides[1, line]
        is_mixed = high / size >= MIXED_SHARE and low / size >= MIXED_SHARE
        if high + low >= MIN_LINE and is_mixed:
            for i in lines.order[lines.starts[line] : lines.starts[line + 1]]:
                last_doubted[i] = now


@compiled
def spread_line_faults(
    scan: CountScan,
    faulty: Flags,
    lines: TaxelGroups,
    context: BeliefContext,
    out: Flags,
) -> None:
    """Mark the taxels of rows or columns that are faulty in part.

    A line explains what is measured on it alone: a taxel that a hand presses or has
    left together with a sound one beside the line is doubtful instead.
    """
    contact, belief, rest = context.contact, context.belief, scan.rest
    counts, index = np.zeros(len(lines.sizes)), lines.group_index
    for i in range(len(faulty)):
        counts[index[i]] += faulty[i]
    for line in range(len(counts)):
        count = counts[line]
        if count < MIN_LINE or count / lines.sizes[line] <= LINE_SHARE:
            continue
        for i in lines.order[lines.starts[line] : lines.starts[line + 1]]:
            side, is_touched = find_side(belief[i], rest[i], contact[i]), False
            if side != 0:
                for j in find_near(i, context.adjacency):
                    if index[j] != line and not faulty[j]:
                        is_touched |= find_side(belief[j], rest[j], contact[j]) == side
            if is_touched:
                context.last_doubted[i] = scan.now
            else:
                out[i] = True


@compiled
def find_side(taxel: np.void, rest: float, contact: float) -> int:
    """Return on which side of rest a taxel was in the latest three scans.

    It is 1 above rest, -1 below it, by more than the counts at which contact begins,
    and 0 if it is on neither side in all scans that were received.
    """
    lowest, highest = np.inf, -np.inf
    for each in (taxel.first, taxel.second, taxel.third):
        if each > highest:
            highest = each
        if each < lowest:
            lowest = each
    if highest == -np.inf:
        return 0
    return int(lowest > rest + contact) - int(highest < rest - contact)


@compiled
def is_lifted(
    i: int, rest: Values, contact: Values, adjacency: Adjacency, belief: np.ndarray
) -> bool:
    """Return whether a taxel is below rest together with a neighbour."""
    if find_side(belief[i], rest[i], contact[i]) == -1:
        for j in find_near(i, adjacency):
            if find_side(belief[j], rest[j], contact[j]) == -1:
                return True
    return False


@compiled(error_model="numpy")
def judge_noise(scan: CountScan, context: BeliefContext, out: NoiseLimits) -> None:
    """Write what may be noise, by the medians of each patch, and what is faulty."""
    belief, now = context.belief, scan.now
    usual, patch_index = find_usual(context), context.patches.group_index
    contacts, least = context.contact, context.least
    gain, curve, last_doubted = context.gain, context.curve, context.last_doubted
    learnt = max(NOISE_SECONDS, LEARN_SCANS * scan.elapsed)
    for i in range(len(belief)):
        taxel, contact, patch = belief[i], contacts[i], patch_index[i]
        noise, since = taxel.noise, now - scan.first_received[i]
        share = noise / max(NOISY_CONTACTS * contact, least[i])
        is_noisier = noise >= NOISIER * usual[0, patch]
        noisy = since >= learnt and share >= 1.0 and is_noisier
        noisy |= taxel.odds >= FAULTY
        restless = since >= learnt / 2.0 and share >= DOUBTFUL_SHARE
        restless &= is_noisier
        if noisy or restless:
            last_doubted[i] = now
        fast = max(NOISE_SIGMAS * noise, least[i])
        wander = max(taxel.wander / contact, WANDER_SHARE * usual[1, patch])
        slow = WANDER_SIGMAS * wander * contact
        counts = max(fast, slow)
        band = max(fast, min(slow, MAX_WANDER_BAND * contact))
        band = min(max(band, contact / 2.0), MAX_BAND * contact)
        floor = linearise_counts(counts, curve) * gain[i]
        floor = add_unfelt(floor, curve)
        if since < NOISE_SECONDS and taxel.start_noise == 0.0:
            floor = max(floor, START_FLOOR)
        out.counts[i], out.band[i], out.floor[i] = counts, band, floor
        out.noisy[i] = noisy
        # Most taxels fail at this, before the tuples are handed over.
        out.lifted[i] = taxel.first < scan.rest[i] - contact and is_lifted(
            i, scan.rest, contacts, context.adjacency, belief
        )


@compiled
def find_usual(context: BeliefContext) -> Float[np.ndarray, "2 patch"]:
    """Return the medians of noise and wandering of each patch.

    That of the noise is in counts, the other in units of the counts at which contact
    begins.
    """
    patches, belief, contact = context.patches, context.belief, context.contact
    usual, ranked = np.empty((2, len(patches.sizes))), np.empty((2, len(belief)))
    for patch in range(len(patches.sizes)):
        count = 0
        for i in patches.order[patches.starts[patch] : patches.starts[patch + 1]]:
            ranked[0, count] = belief[i].noise
            ranked[1, count] = belief[i].wander / contact[i]
            count += 1
        for row in range(2):
            usual[row, patch] = select(ranked[row, :count], count // 2)
    return usual
