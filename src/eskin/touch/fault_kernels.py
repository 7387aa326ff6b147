"""Compiled kernels that update the history of counts for the detection of faults."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration_kernels import find_near

Taxels = Int[np.ndarray, "some"]
Values = Float[np.ndarray, "taxel"]

LEVEL_SECONDS = 0.3
"""Time constant of the mean counts above rest of a taxel [s]."""
DEVIATION_SPEED = 0.8
"""Largest change of the running median of deviations [1/s], in units of itself or of
the counts at which contact begins, whichever is larger: the few scans in which a touch
begins and ends change it by less than what is noisy."""
DEVIATION_STEP = 0.016
"""Largest change from one scan to the next, in the same units: at low rates the median
needs as many scans."""
NOISE_PART, NOISE_LEAST = 0.25, 0.1
"""Speed of the noise in units of that of the deviation, and the counts at which contact
begins that limit it from below."""
BELOW_FACTOR = 15.0
"""Speed at which the noise of a taxel falls while it is below rest, in units of its
usual speed: what pressed there when the skin was switched on has lifted, and its noise
was that of a hand."""
MEDIAN_SHARE = 0.85
"""Median of the deviations of white noise, in units of their mean."""
CLEAR_FACTOR = 2.0
"""Smallest signal that is clearly no noise, in units of what may be noise."""
SLOW_NOISE_SPEED, SLOW_NOISE_STEP = 0.1, 0.002
"""Largest change of the running median of the depth below rest, in a second and in a
scan, in units of itself or of the counts at which contact begins, whichever is
larger."""
SLOW_NOISE_START_FACTOR, SLOW_NOISE_START_SECONDS = 20.0, 5.0
"""Factor of that change after the first data, and the time from it on [s]."""
SLOW_NOISE_SECONDS = 2.0
"""Longest time below rest that is slow noise, and not another rest [s]."""
SLOW_NOISE_DEPTH = 4.0
"""Greatest depth that is, in units of the counts at which contact begins."""
PRESS_CONTACTS, PRESS_SLOW_NOISES = 4.0, 6.0
"""Smallest mean counts above rest of a press, in units of those at which contact begins
and of the running median of the depth below rest, whichever is larger."""
DIP_SECONDS = 20.0
"""Time after a press in which counts below rest may be a dip of the sensor [s]; not in
the first seconds, when noise may be as large as a press."""
START_SECONDS = 1.0
"""Time in which noise that is not calibrated is learned at first [s]."""
MAX_GAP = 0.15
"""Largest time between two scans whose counts are compared [s]."""
MAX_STEPS = 3.0
"""Largest number of isolated steps that is remembered."""
STEP_FACTOR = 4.0
"""Smallest step, in units of the running median of the deviations."""
RECENT = 4
"""Number of scans whose counts are compared."""
MAX_STEP_INTERVAL = 0.03
"""Largest time between two scans in which no finger lands or lifts completely [s]."""
FLAT = 0.25
"""Largest change of the counts before and after a step, in units of the step."""
FOLLOWS = 0.2
"""Smallest change of a neighbour that takes part in a step, in units of the step."""
MIN_ISOLATED_STEP, ISOLATED_FACTOR = 16.0, 20.0
"""Smallest isolated step after which a taxel is followed: in counts, and in units of
the running median of the deviations; noise hides whether a smaller one is flat."""
ISOLATED_FLAT = 0.1
"""Largest change of the counts of such a taxel, in units of the step."""
ISOLATED_SECONDS, SLOW_ISOLATED_SECONDS = 0.15, 0.3
"""Time of flat counts after which such a taxel is a fault [s]; the second where a scan
takes longer than `MAX_STEP_INTERVAL`."""
MAX_ISOLATED_INTERVAL = 0.042
"""Largest time between two scans at which flat counts alone are a fault [s]."""
FLAT_STEPS = 2.0
"""Isolated steps that a taxel counts for which stays flat after one."""
NEVER = -1e9
"""Time before all others [s]."""


class CountHistory(NamedTuple):
    """Arrays (taxel) hold the history of counts of the fault detector; times in [s]."""

    counts: np.ndarray
    """Counts last received."""
    first_received: np.ndarray
    """Time of the first data, or of the first after a long silence."""
    last_received: np.ndarray
    """Time of the last data."""
    last_changed: np.ndarray
    """Time of the last change of the counts."""
    last_negative: np.ndarray
    """Time at which the counts were last negative."""
    last_below_full: np.ndarray
    """Time at which the counts were last below full scale."""
    last_nonzero: np.ndarray
    """Time at which the counts were last above zero."""
    last_zero: np.ndarray
    """Time at which the counts were last zero."""
    least: np.ndarray
    """Smallest counts above zero; zero after the counts left zero, until they are
    measured again some time later."""
    last_unpressed: np.ndarray
    """Time at which none of the neighbours was last pressed."""
    unanswered: np.ndarray
    """Time without response while the neighbours were pressed."""
    recent: np.ndarray
    """Counts (`RECENT`, taxel) of the latest scans, written in turn; NaN where a taxel
    was not received, or the scan lies too far back."""
    deviation: np.ndarray
    """Running median of the deviation of the counts from a straight course."""
    noise: np.ndarray
    """The same, followed more slowly, so that touches hardly change it."""
    start_noise: np.ndarray
    """Noise at the first data and after a long silence, as calibrated; 0 where it is
    learned from the first second."""
    slow_noise: np.ndarray
    """Running median of the depth below rest of a taxel that wanders about it: slow
    noise is as large above rest, while a hand presses above it alone."""
    last_above: np.ndarray
    """Time at which the counts were last above rest."""
    last_pressed: np.ndarray
    """Time of the latest press."""
    level: np.ndarray
    """Mean counts above rest of the latest scans."""
    in_contact: np.ndarray
    """Whether a taxel and a neighbour are pressed."""
    last_straight: np.ndarray
    """Time at which the deviation was last below what is noisy."""
    steps: np.ndarray
    """Number of isolated steps, each of which counts for less as it becomes older."""
    isolated_since: np.ndarray
    """Time of the isolated step since which the counts are flat; `NEVER` without."""
    isolated_level: np.ndarray
    """Counts after that step."""
    isolated_step: np.ndarray
    """Size of that step [counts]."""


class CountScan(NamedTuple):
    """A scan is passed to the kernels in this form."""

    counts: np.ndarray
    """(taxel) counts."""
    received: np.ndarray
    """(taxel) which counts are new."""
    rest: np.ndarray
    """(taxel) counts at rest."""
    rest_band: np.ndarray
    """(taxel) counts from which it is away from rest."""
    mask: np.ndarray
    """(taxel) which are faulty; those with negative counts are added."""
    now: float
    """Time at which it was taken, since the first scan [s]."""
    elapsed: float
    """Time since the last scan [s]."""
    turn: int
    """Index of the scan in `CountHistory.recent`."""


class CountLimits(NamedTuple):
    """Limits tell what is faulty and what is noisy; see `FaultConfig`."""

    full_scale: int
    """Counts at which the converter saturates."""
    contact: np.ndarray
    """Counts above rest (taxel) at which contact begins."""
    deviation: np.ndarray
    """Deviation (taxel) from a straight course that makes a taxel noisy [counts]."""
    cut: np.ndarray
    """Counts (taxel) that a converter which cuts small values may swing by about
    zero."""
    step_seconds: float
    """Time constant with which an isolated step counts for less [s]."""
    silence_seconds: float
    """Time without data after which the history restarts [s]."""
    saturated_seconds: float
    """Time above zero after which `CountHistory.least` is measured again [s]."""
    pressed: float
    """Pressure on neighbours at which a taxel is expected to respond [kPa]."""
    pressed_share: float
    """Share of neighbours that must have that pressure."""


@compiled
def update_history(scan: CountScan, limits: CountLimits, history: CountHistory) -> None:
    """Update the history with a scan, and mask negative counts at once."""
    counts, now = scan.counts, scan.now
    last_received, least = history.last_received, history.least
    last_nonzero, last_zero = history.last_nonzero, history.last_zero
    for i in range(len(counts)):
        if not scan.received[i]:
            continue
        count = counts[i]
        if now - last_received[i] > limits.silence_seconds:
            reset_taxel(i, count, now, history)
        last_received[i] = now
        if count != history.counts[i]:
            history.counts[i] = count
            history.last_changed[i] = now
            history.unanswered[i] = 0.0
        if count < limits.full_scale:
            history.last_below_full[i] = now
        if count > 0:
            if last_nonzero[i] < last_zero[i]:
                least[i] = 0.0
            elif least[i] == 0.0 and now - last_zero[i] > limits.saturated_seconds:
                least[i] = count
            elif count < least[i]:
                least[i] = count
            last_nonzero[i] = now
        elif count == 0:
            last_zero[i] = now
        else:
            history.last_negative[i] = now
            scan.mask[i] = True


@compiled
def reset_taxel(i: int, count: int, now: float, history: CountHistory) -> None:
    """Reset the history of a taxel at its first data or the first after a silence."""
    history.first_received[i] = now
    history.last_changed[i] = now
    history.counts[i] = count
    history.last_below_full[i] = -np.inf
    history.last_nonzero[i] = -np.inf
    history.last_zero[i] = -np.inf
    history.least[i] = np.inf
    history.last_unpressed[i] = -np.inf
    history.unanswered[i] = 0.0
    history.recent[:, i] = np.nan
    history.deviation[i] = 0.0
    history.noise[i] = history.start_noise[i]
    history.slow_noise[i] = 0.0
    history.last_above[i] = history.last_pressed[i] = NEVER
    history.level[i] = 0.0
    history.in_contact[i] = False
    history.last_straight[i] = now
    history.steps[i] = 0.0
    history.isolated_since[i] = NEVER


@compiled(error_model="numpy")
def update_noise(
    scan: CountScan, limits: CountLimits, adjacency: Adjacency, history: CountHistory
) -> int:
    """Follow how far the counts of each taxel deviate from a straight course.

    The deviation of three scans is the second difference of their counts. Half of the
    deviations of a taxel lie above its running median, which moves by the same amount
    towards each of them, so that a single one, however large, moves it little. Swings
    between zero and small values, as of a converter that cuts those, are no deviation.

    Returns:
        How many taxels are away from rest, below it.
    """
    counts, rest, rest_band = scan.counts, scan.rest, scan.rest_band
    now, elapsed = scan.now, scan.elapsed
    latest = history.recent[scan.turn]
    first = history.recent[(scan.turn - 1) % RECENT]
    second = history.recent[(scan.turn - 2) % RECENT]
    third = history.recent[(scan.turn - 3) % RECENT]
    deviation, level, steps = history.deviation, history.level, history.steps
    last_straight, noise = history.last_straight, history.noise
    first_received, start_noise = history.first_received, history.start_noise
    slow_noise, last_above = history.slow_noise, history.last_above
    last_pressed = history.last_pressed
    in_contact = history.in_contact
    contacts, noisy, cut = limits.contact, limits.deviation, limits.cut
    speed = min(DEVIATION_SPEED * elapsed, DEVIATION_STEP)
    slow_speed = min(SLOW_NOISE_SPEED * elapsed, SLOW_NOISE_STEP)
    keep = LEVEL_SECONDS / (LEVEL_SECONDS + elapsed)
    forget = np.exp(-elapsed / limits.step_seconds)
    if elapsed > MAX_GAP:
        first[:] = np.nan
    is_slow = elapsed > MAX_STEP_INTERVAL
    low = 0
    for i in range(len(counts)):
        if not scan.received[i]:
            latest[i] = np.nan
            continue
        count, contact, usual = float(counts[i]), contacts[i], deviation[i]
        latest[i] = count
        above = count - rest[i]
        low += above < -rest_band[i]
        bend = abs(count - 2.0 * first[i] + second[i])
        highest = max(count, first[i], second[i])
        is_cut = count * first[i] * second[i] == 0.0 and highest < cut[i]
        seen = 0.0 if is_cut else bend
        change = speed * max(contact, usual)
        if seen > usual:
            usual = min(usual + change, seen)
        elif seen < usual:
            usual = max(usual - change, seen)
        deviation[i] = usual
        slow = NOISE_PART * speed * max(NOISE_LEAST * contact, noise[i])
        since = now - first_received[i]
        if since < START_SECONDS and start_noise[i] == 0.0:
            part = elapsed / (since + elapsed)
            if not np.isnan(bend):
                noise[i] += part * (MEDIAN_SHARE * bend - noise[i])
        elif in_contact[i]:
            # Noise is that at rest; that of touched taxels may be ten times as large.
            pass
        elif bend < noise[i]:
            fall = slow * BELOW_FACTOR if above < -rest_band[i] else slow
            noise[i] = max(noise[i] - fall, bend)
        elif bend > noise[i]:
            noise[i] = min(noise[i] + slow, bend)
        if above >= 0.0:
            last_above[i] = now
        elif (
            now - last_above[i] < SLOW_NOISE_SECONDS
            and above > -SLOW_NOISE_DEPTH * contact
        ):
            most = slow_speed * max(contact, slow_noise[i])
            if now - first_received[i] < SLOW_NOISE_START_SECONDS:
                most *= SLOW_NOISE_START_FACTOR
            elif now - last_pressed[i] < DIP_SECONDS:
                most = 0.0
            slow_noise[i] += min(max(-above - slow_noise[i], -most), most)
        level[i] = keep * level[i] + (1.0 - keep) * max(above, 0.0)
        if level[i] > max(PRESS_CONTACTS * contact, PRESS_SLOW_NOISES * slow_noise[i]):
            last_pressed[i] = now
        if in_contact[i]:
            if level[i] < contact:
                in_contact[i] = False
                usual = deviation[i] = min(usual, noise[i])
        elif level[i] >= contact and usual < level[i]:
            near = find_near(i, adjacency)
            in_contact[i] = any_pressed(near, level, deviation, contacts)
        if usual < noisy[i]:
            last_straight[i] = now
        steps[i] *= forget
        step = abs(first[i] - second[i])
        least = max(contact, rest_band[i], STEP_FACTOR * usual)
        if is_slow or is_cut or step < least:
            continue
        stays = min(abs(count - first[i]), abs(count - second[i]))
        flat = FLAT * step
        if stays <= flat and abs(second[i] - third[i]) <= flat:
            if is_alone(i, step, first, second, adjacency):
                steps[i] = min(steps[i] + 1.0, MAX_STEPS)
    update_isolated(scan, limits, adjacency, history)
    return low


@compiled
def any_pressed(
    taxels: Taxels, level: Values, deviation: Values, contacts: Values
) -> bool:
    """Return whether any of some taxels is pressed for a while, rather than noisy."""
    for i in taxels:
        if level[i] >= contacts[i] and deviation[i] < level[i]:
            return True
    return False


@compiled
def update_isolated(
    scan: CountScan, limits: CountLimits, adjacency: Adjacency, history: CountHistory
) -> None:
    """Follow taxels that stepped up alone in one scan while their counts are flat.

    So does a taxel whose contact is intermittent. What touches goes on to press harder
    or more lightly, within a scan or two. A taxel that stays flat for longer counts as
    if it had made `FLAT_STEPS` isolated steps. Where scans are slower, a finger lands
    within one; at full scale all that presses is flat.

    `update_noise` has updated the history.
    """
    counts, now = scan.counts, scan.now
    latest = history.recent[scan.turn]
    first = history.recent[(scan.turn - 1) % RECENT]
    second = history.recent[(scan.turn - 2) % RECENT]
    since, size = history.isolated_since, history.isolated_step
    level = history.isolated_level
    is_slow = scan.elapsed > MAX_STEP_INTERVAL
    longest = SLOW_ISOLATED_SECONDS if is_slow else ISOLATED_SECONDS
    if scan.elapsed > MAX_ISOLATED_INTERVAL:
        since[:] = NEVER
        return
    for i in range(len(counts)):
        if not scan.received[i] or scan.mask[i] or counts[i] >= limits.full_scale:
            since[i] = NEVER
            continue
        count, usual = latest[i], history.deviation[i]
        if since[i] > NEVER:
            flat = max(ISOLATED_FLAT * size[i], STEP_FACTOR * usual)
            if abs(count - level[i]) > min(flat, FLAT * size[i]):
                since[i] = NEVER
            elif now - since[i] >= longest:
                history.steps[i] = max(history.steps[i], FLAT_STEPS)
                since[i] = NEVER
            continue
        step = count - first[i]
        least = max(MIN_ISOLATED_STEP, ISOLATED_FACTOR * usual)
        least = max(least, limits.contact[i], scan.rest_band[i])
        rises = step >= least and count - scan.rest[i] >= least
        if rises and abs(first[i] - second[i]) <= ISOLATED_FLAT * step:
            if is_alone(i, step, latest, first, adjacency):
                since[i], level[i], size[i] = now, count, step


@compiled
def is_alone(
    i: int, step: float, after: Values, before: Values, adjacency: Adjacency
) -> bool:
    """Return whether no neighbour of a taxel took part in its step.

    `after` and `before` are the counts after and before the step.
    """
    for j in find_near(i, adjacency):
        if abs(after[j] - before[j]) >= FOLLOWS * step:
            return False
    return True


@compiled
def update_unanswered(
    pressure: Values,
    elapsed: float,
    scan: CountScan,
    limits: CountLimits,
    adjacency: Adjacency,
    history: CountHistory,
) -> None:
    """Add the elapsed time to taxels that do not respond while neighbours are pressed.

    Such a taxel has not changed since all its neighbours were at rest; one that is held
    down steadily changed when it was pressed.
    """
    for i in range(len(pressure)):
        known, count = 0, 0
        for j in find_near(i, adjacency):
            if scan.received[j] and not scan.mask[j]:
                known += 1
                count += pressure[j] >= limits.pressed
        if count == 0:
            history.last_unpressed[i] = scan.now
        elif known >= 3 and count >= limits.pressed_share * known:
            if history.last_changed[i] <= history.last_unpressed[i]:
                history.unanswered[i] += elapsed


@compiled
def find_noisier(
    candidates: Taxels, factor: float, adjacency: Adjacency, history: CountHistory
) -> Taxels:
    """Return the candidates that deviate more than their neighbours, by a factor.

    The deviation is compared with the median of the neighbours; that of a taxel under a
    hand with those of them that are under it too.
    """
    deviation, in_contact = history.deviation, history.in_contact
    found = np.zeros(len(candidates), np.bool_)
    for n, taxel in enumerate(candidates):
        near = find_near(taxel, adjacency)
        if in_contact[taxel]:
            near = near[in_contact[near]]
        usual = np.median(deviation[near]) if len(near) else 0.0
        is_compared = len(near) > 0 or not in_contact[taxel]
        found[n] = is_compared and deviation[taxel] >= factor * usual
    return candidates[found]
