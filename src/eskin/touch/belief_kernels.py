"""A compiled kernel that follows what each taxel does at rest, and what no touch does.

A touch presses: it raises counts above rest, changes them from scan to scan, and takes
neighbours along. All that a taxel does below rest, or alone in one step, is its own.
"""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration_kernels import find_near

Taxels = Int[np.ndarray, "some"]
Values = Float[np.ndarray, "taxel"]

CLEAR_FACTOR = 2.0
"""Smallest signal that is clearly no noise, in units of what may be noise."""
NOISE_SECONDS, WANDER_SECONDS = 1.0, 20.0
"""Time constants of the estimates of fast noise and of wandering about rest [s]."""
MOST_PART = 0.04
"""Largest weight of one scan in the estimate of the noise; of wandering in
proportion: no memory moves far by one scan, however long ago the last one was."""
START_SECONDS = 1.0
"""Time after the first data in which noise that is not calibrated is learned [s]."""
OUTLIER, LEAST_OUTLIER = 3.0, 0.5
"""Largest value that an estimate takes in as it is, in units of itself, and of the
counts at which contact begins."""
BELOW_FACTOR = 5.0
"""Factor of the weight by which the noise falls while a taxel is below rest: what
pressed there when the skin was switched on has lifted, and its noise was that of a
hand."""
BEND_SIGMAS = 6.0**0.5
"""Standard deviation of the second difference of white noise, in units of its own."""
LOW_SECONDS = 2.0
"""Longest time below rest that is wandering, and not another rest [s]."""
MAX_GAP = 0.15
"""Largest time between two scans whose counts are compared [s]."""
ODDS_SECONDS = 10.0
"""Time constant with which evidence of a fault counts for less [s]."""
MOST_ODDS = 2.0
"""Largest evidence, as of a lone step after which a taxel stays flat; a lone step that
lasts two scans, or is gone after one, counts for one."""
FOLLOWS = 0.2
"""Smallest change of a neighbour that takes part in a step, in units of the step."""
STEP_SIGMAS, FLAT = 6.6, 0.25
"""Smallest lone step, in standard deviations of the noise, and largest change of the
counts in the scan before it and in that after it, in units of the step. One end of it
is as near to rest: a hand that is on a taxel changes its counts as it moves."""
LONG_STEP, LONG_SIGMAS = 16.0, 33.0
"""Smallest lone rise of which a taxel may stay flat: in counts, and in standard
deviations of the noise, which hides whether it does after a smaller one."""
LONG_FLAT, LONG_FLAT_SIGMAS = 0.2, 7.0
"""Largest change of flat counts, in units of the step, and in standard deviations of
the noise."""
FLAT_SECONDS, FLAT_SCANS = 0.15, 7
"""Time [s] and number of scans with flat counts after which such a step is no touch."""
MAX_STEP_INTERVAL, MAX_FLAT_INTERVAL = 0.03, 0.042
"""Largest time between two scans in which no finger lands or lifts completely, and at
which flat counts tell anything [s]."""
NEVER = -1e9
"""Time before all others [s]."""

BELIEF = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("first", "second", "third", "fourth"),
            *("noise", "start_noise", "wander", "odds"),
            *("above_at", "flat_since", "flat_level", "flat_step"),
        )
    ]
)
"""What is believed of a taxel: its counts in the latest four scans, NaN where they are
not known; standard deviations of its noise from scan to scan, of that as calibrated (0
for none), and of its wandering about rest [counts]; the evidence that it is faulty;
when it was last above rest [s]; and since when it has been flat after a lone step [s],
at which counts, after which step."""


class CountScan(NamedTuple):
    """A scan is passed to the kernels in this form."""

    counts: np.ndarray
    """(taxel) counts."""
    received: np.ndarray
    """(taxel) which counts are new."""
    rest: np.ndarray
    """(taxel) counts at rest."""
    dip: np.ndarray
    """(taxel) counts below rest to which its sensor may fall after a press."""
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
    touch can cause them: the first and third scan within the band about rest, or one
    below it; and where the noise of a noisy taxel falls, or it is masked. The
    depth below rest, beyond the dip after a press, gives the wandering. Lone steps are
    evidence of a fault.

    Returns:
        How many taxels are away from rest, below it.
    """
    now, elapsed, counts = scan.now, scan.elapsed, scan.counts
    fast = min(elapsed / NOISE_SECONDS, MOST_PART)
    slow = fast * NOISE_SECONDS / WANDER_SECONDS
    forget = np.exp(-elapsed / ODDS_SECONDS)
    follows = elapsed <= MAX_FLAT_INTERVAL
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
        if not scan.received[i]:
            taxel.flat_since = NEVER
            continue
        band, rest, limit = scan.band[i], scan.rest[i], LEAST_OUTLIER * contact[i]
        above = taxel.first - rest
        since = now - scan.first_received[i]
        bend = taxel.first - 2.0 * taxel.second + taxel.third
        lowest = min(taxel.first, taxel.second, taxel.third) - rest
        learns = taxel.start_noise == 0.0
        starts = learns and since < START_SECONDS
        seen = abs(bend) / BEND_SIGMAS
        calms = seen < taxel.noise and taxel.noise > limit
        rests = max(taxel.first, taxel.third) - rest <= band or lowest < -band
        if starts or rests or calms or scan.mask[i]:
            part = max(fast, elapsed / (since + elapsed)) if learns else fast
            if above < -band and seen < taxel.noise:
                part = min(BELOW_FACTOR * part, 1.0)
            taxel.noise = follow(taxel.noise, seen, limit, part)
        if above >= 0.0:
            taxel.above_at = now
        else:
            low += above < -band
            depth = -above - scan.dip[i]
            if depth > 0.0 and now - taxel.above_at < LOW_SECONDS:
                part = max(slow, elapsed / (since + elapsed))
                taxel.wander = follow(taxel.wander, depth, limit, part)
        if not follows or since < START_SECONDS:
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
    taxel.above_at = taxel.flat_since = NEVER


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
        flat = max(LONG_FLAT * taxel.flat_step, LONG_FLAT_SIGMAS * taxel.noise)
        if abs(taxel.first - taxel.flat_level) > flat:
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
        least = max(least, LONG_STEP, LONG_SIGMAS * taxel.noise)
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
