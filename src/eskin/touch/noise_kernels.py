"""Compiled kernels that follow what each taxel does by itself: its noise.

A touch presses: it raises counts above rest, changes them from scan to scan, and takes
neighbours along. All that a taxel does below rest is its own.
"""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.context import FrontEndContext, KernelScan
from eskin.touch.pressure_kernels import add_unfelt, linearise_counts
from eskin.touch.taxel_kernels import SHORTEST_PRESS, find_near, reset_taxel, select

Taxels = Int[np.ndarray, "some"]
Flags = Bool[np.ndarray, "taxel"]

BEND_SIGMAS = 6.0**0.5
"""Standard deviation of the second difference of white noise, in units of its own."""
FOLLOWS = 0.2
"""Smallest change that counts beside a step, in units of it: of a neighbour that takes
part in it, or of counts that were flat after a lone rise. A rise of which noise hides
such a change tells nothing."""


@final
class NoiseEstimate(NamedTuple):
    """The estimate of noise follows a taxel that nothing touches."""

    seconds: float = 1.0
    """Time constant of the estimate of noise from scan to scan [s]. Noise that is not
    calibrated is learned for this time after the first data."""
    wander_seconds: float = 20.0
    """Time constant of the estimate of wandering about rest [s]."""
    most_part: float = 0.04
    """Largest weight of one scan in the estimate of the noise; of wandering in
    proportion: no memory moves far by one scan, however long ago the last one was."""
    outlier: float = 3.0
    """Largest value that an estimate takes in as it is, in units of itself."""
    least_outlier: float = 0.5
    """The same, in units of the counts at which contact begins, for small estimates."""
    below_factor: float = 5.0
    """Factor of the weight by which the noise falls while a taxel is below rest: what
    pressed there when the skin was switched on has lifted, and its noise was that of a
    hand."""
    max_gap: float = 0.15
    """Largest time between two scans whose counts are compared [s]."""


@final
class NoiseBand(NamedTuple):
    """The band about rest holds what may be noise; its limits follow the estimates."""

    least_counts: tuple[float, float] = (2.0, 4.0)
    """Limits of the smallest difference from rest that may be noise [counts]:
    converters round, and coarse ones would feel no light touch."""
    least_contacts: float = 2.0
    """Smallest difference from rest that may be noise, in units of the counts at which
    contact begins, within these limits."""
    noise_sigmas: float = 6.0
    """Signal that may be noise, in standard deviations of the noise from scan to
    scan."""
    wander_sigmas: float = 5.0
    """Signal that may be noise, in standard deviations of wandering about rest."""
    wander_share: float = 0.7
    """Smallest wandering of a taxel, in units of the median of its patch: where rest
    was learned too low, none is seen below it."""
    most_contacts: float = 4.0
    """Largest distance from rest that is left to noise, in units of the counts at which
    contact begins: a patch that swings further feels no touch."""
    most_wander_contacts: float = 1.5
    """Largest distance from rest that is left to wandering, in the same units."""
    clear_factor: float = 2.0
    """Smallest signal that is clearly a touch, in units of what may be noise, and of
    the pressure at which contact begins."""
    start_floor: float = 7.0
    """Pressure that may be noise while the noise is neither calibrated nor learned yet
    [kPa]."""


@final
class NoisyTaxel(NamedTuple):
    """A taxel is faulty or doubtful whose noise is large, and larger than usual."""

    learn_scans: int = 40
    """Number of scans from which noise is known well enough for a fault."""
    contacts: float = 0.55
    """Noise that makes a taxel a fault, in units of the counts at which contact begins,
    but at least what rounding converters may show of any sound taxel."""
    doubtful_share: float = 0.5
    """Share of that noise from which a taxel is doubtful: it may stop an arm, and
    nothing else."""
    ratio: float = 2.5
    """Smallest ratio of its noise to the median of its patch."""


@final
class Suspicion(NamedTuple):
    """Suspicion of a fault gathers with what no touch does, and fades."""

    fade_seconds: float = 10.0
    """Time constant with which it fades [s]."""
    most: float = 2.0
    """Largest suspicion, as of a lone step after which a taxel stays flat; a lone step
    that lasts two scans, or is gone after one, counts for one."""
    faulty: float = 1.5
    """Suspicion from which a taxel is a fault."""


NOISE = NoiseEstimate()
BAND = NoiseBand()
NOISY_TAXEL = NoisyTaxel()
SUSPICION = Suspicion()


@compiled(error_model="numpy")
def follow_noise(scan: KernelScan, context: FrontEndContext) -> int:
    """Update the noise of each taxel by a scan.

    The noise is the root mean square of second differences, as of white noise, where no
    touch can cause them: the first and third scan not above the band about rest, nor,
    where a press may lie between slow scans, the second with that of a neighbour; and
    where the noise of a noisy taxel falls, or it is faulty and scans are too fast for a
    press. The depth below rest, beyond the dip after a press, gives the wandering.

    Returns:
        How many taxels are away from rest, below it.
    """
    taxels = context.taxels
    constants = context.constants
    now = scan.now
    elapsed = scan.elapsed
    fast = min(elapsed / NOISE.seconds, NOISE.most_part)
    slow = fast * NOISE.seconds / NOISE.wander_seconds
    is_fast = 2.0 * elapsed <= SHORTEST_PRESS
    dip_share = context.rest.dip_share
    low = 0
    for i in range(len(taxels)):
        taxel = taxels[i]
        taxel.fourth = taxel.third
        taxel.third = taxel.second
        taxel.second = taxel.first
        if elapsed > NOISE.max_gap:
            taxel.second = np.nan
        is_known = scan.received[i] and scan.counts[i] >= 0
        taxel.first = scan.counts[i] if is_known else np.nan
    for i in range(len(taxels)):
        if not scan.received[i]:
            continue
        taxel = taxels[i]
        contact = constants[i].contact
        rest = taxel.rest
        limit = NOISE.least_outlier * contact
        above = taxel.first - rest
        since = now - taxel.first_received
        bend = taxel.first - 2.0 * taxel.second + taxel.third
        learns = constants[i].start_noise == 0.0
        starts = learns and since < NOISE.seconds
        seen = abs(bend) / BEND_SIGMAS
        calms = seen < taxel.noise and taxel.noise > limit
        rests = max(taxel.first, taxel.third) - rest <= taxel.band
        between = taxel.second - rest
        if rests and between > taxel.band and not is_fast:
            rests = is_alone(i, between, context)
        rests &= context.taxels[i].bound <= taxel.band
        if starts or rests or calms or (is_fast and scan.faulty[i]):
            part = max(fast, elapsed / (since + elapsed)) if learns else fast
            if above < -contact and seen < taxel.noise and is_lifted(i, context):
                part = min(NOISE.below_factor * part, 1.0)
            taxel.noise = follow(taxel.noise, seen, limit, part)
        if above < 0.0:
            low += above < -taxel.band
            depth = -above - dip_share * taxel.peak
            if depth > 0.0:
                part = max(slow, elapsed / (since + elapsed))
                taxel.wander = follow(taxel.wander, depth, limit, part)
    return low


@compiled
def follow(estimate: float, seen: float, limit: float, part: float) -> float:
    """Return a root mean square after one more value; NaN is none."""
    if not seen >= 0.0:
        return estimate
    seen = min(seen, max(NOISE.outlier * estimate, limit))
    return np.sqrt(estimate**2 + part * (seen**2 - estimate**2))


@compiled
def is_alone(i: int, step: float, context: FrontEndContext) -> bool:
    """Return whether no neighbour of a taxel took part in its step."""
    for j in find_near(i, context.places.adjacency):
        near = context.taxels[j]
        if abs(near.second - near.third) >= FOLLOWS * step:
            return False
    return True


@compiled
def find_side(i: int, context: FrontEndContext) -> int:
    """Return on which side of rest a taxel was in the latest three scans.

    It is 1 above rest, -1 below it, by more than the counts at which contact begins,
    and 0 if it is on neither side in all scans that were received.
    """
    taxel = context.taxels[i]
    contact = context.constants[i].contact
    lowest = np.inf
    highest = -np.inf
    for each in (taxel.first, taxel.second, taxel.third):
        if each > highest:
            highest = each
        if each < lowest:
            lowest = each
    if highest == -np.inf:
        return 0
    is_above = lowest > taxel.rest + contact
    is_below = highest < taxel.rest - contact
    return int(is_above) - int(is_below)


@compiled
def is_lifted(i: int, context: FrontEndContext) -> bool:
    """Return whether a taxel is below rest together with a neighbour."""
    if find_side(i, context) == -1:
        for j in find_near(i, context.places.adjacency):
            if find_side(j, context) == -1:
                return True
    return False


@compiled(error_model="numpy")
def limit_noise(
    scan: KernelScan, context: FrontEndContext, noisy: Flags, lifted: Flags
) -> None:
    """Update what may be noise, by the medians of each patch, and find what is faulty.

    Args:
        scan: latest scan.
        context: what is kept between scans.
        noisy: written with the taxels that are noisy, or suspect of another fault.
        lifted: written with those that are below rest with a neighbour. A hand was on
            them when the skin was switched on, and has lifted: its pressure was taken
            for rest, and its noise for that of the taxel.
    """
    taxels = context.taxels
    constants = context.constants
    curve = context.curve
    usual = find_usual(context)
    patch_index = context.places.patches.group_index
    learnt = max(NOISE.seconds, NOISY_TAXEL.learn_scans * scan.elapsed)
    for i in range(len(taxels)):
        taxel = taxels[i]
        contact = constants[i].contact
        least = constants[i].least_noise
        patch = patch_index[i]
        noise = taxel.noise
        since = scan.now - taxel.first_received
        share = noise / max(NOISY_TAXEL.contacts * contact, least)
        is_noisier = noise >= NOISY_TAXEL.ratio * usual[0, patch]
        noisy[i] = since >= learnt and share >= 1.0 and is_noisier
        noisy[i] |= taxel.suspicion >= SUSPICION.faulty
        restless = since >= learnt / 2.0 and share >= NOISY_TAXEL.doubtful_share
        restless &= is_noisier
        if noisy[i] or restless:
            taxel.last_doubted = scan.now
        limit_taxel(i, usual[1, patch], constants, taxels)
        floor = linearise_counts(taxel.noise_limit, curve) * constants[i].gain
        floor = add_unfelt(floor, curve)
        if since < NOISE.seconds and constants[i].start_noise == 0.0:
            floor = max(floor, BAND.start_floor)
        taxel.floor = floor
        # Most taxels fail at this, before the context is handed over.
        is_low = taxel.first < taxel.rest - contact
        lifted[i] = is_low and is_lifted(i, context)


@compiled(error_model="numpy")
def limit_taxel(
    i: int, usual: float, constants: np.ndarray, taxels: np.ndarray
) -> None:
    """Write the counts above rest at which a taxel may be noise, and may be touched.

    Noise from scan to scan is known of each taxel, wandering about rest only where it
    went below it: the others of the patch tell of that, too. Faults look at both sides
    of rest, where much wandering must not hide them: it counts less in the band.

    Args:
        i: index of the taxel.
        usual: median of the wandering of its patch, in units of the counts at which
            contact begins.
        constants: (taxel) `TAXEL_CONSTANTS`.
        taxels: (taxel) `TAXEL`, whose `noise_limit`, `band` and `margin` are written.
    """
    taxel = taxels[i]
    contact = constants[i].contact
    fast = max(BAND.noise_sigmas * taxel.noise, constants[i].least_noise)
    wander = max(taxel.wander / contact, BAND.wander_share * usual)
    slow = BAND.wander_sigmas * wander * contact
    taxel.noise_limit = max(fast, slow)
    band = max(fast, min(slow, BAND.most_wander_contacts * contact), contact / 2.0)
    taxel.band = min(band, BAND.most_contacts * contact)
    clear = BAND.clear_factor * taxel.noise_limit
    taxel.margin = max(constants[i].clear, clear)


@compiled
def begin_taxels(constants: np.ndarray, taxels: np.ndarray) -> None:
    """Begin the state of taxels of which no data has been received."""
    for i in range(len(taxels)):
        reset_taxel(i, constants, taxels)
        limit_taxel(i, 0.0, constants, taxels)
        # Nothing is known to be noise until the first check.
        taxels[i].band = constants[i].contact / 2.0


@compiled
def find_usual(context: FrontEndContext) -> Float[np.ndarray, "2 patch"]:
    """Return the medians of noise and wandering of each patch.

    Noise is in counts, wandering in units of the counts at which contact begins.
    """
    patches = context.places.patches
    taxels = context.taxels
    usual = np.empty((2, len(patches.sizes)))
    ranked = np.empty((2, len(taxels)))
    for patch in range(len(patches.sizes)):
        count = 0
        for i in patches.order[patches.starts[patch] : patches.starts[patch + 1]]:
            ranked[0, count] = taxels[i].noise
            ranked[1, count] = taxels[i].wander / context.constants[i].contact
            count += 1
        for row in range(2):
            usual[row, patch] = select(ranked[row, :count], count // 2)
    return usual
