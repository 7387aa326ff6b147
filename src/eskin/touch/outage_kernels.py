"""Compiled kernels that find the scans of a patch that no touch can cause."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.touch.belief_kernels import NEVER
from eskin.touch.calibration_kernels import SILENCE_SECONDS

Taxels = Int[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]

NEARLY_ALL = 0.8
"""Share of the received taxels of a patch that move at once."""
MAX_PRESSED = 12
"""Number of taxels that a hand may press within one scan."""
START_SECONDS = 10.0
"""Time after the first data in which zeros may come from a board that starts [s]; later
they are rest, and what leaves them is a press."""
MOVE_CONTACTS = 4.0
"""Smallest move of a taxel that counts, in units of the counts at which contact begins;
a move by one of these keeps a patch refused."""
USED, REFUSED, RESTARTED = range(3)
"""Outcomes of the check of a patch."""


class PatchState(NamedTuple):
    """Arrays hold what is known of each patch; times in [s]."""

    accepted: np.ndarray
    """(taxel) counts of the last scan that was used."""
    first_seen: np.ndarray
    """(patch) time of the first data, or of the first after a long silence."""
    last_seen: np.ndarray
    """(patch) time of the last data."""
    refused_since: np.ndarray
    """(patch) time from which its data is refused; infinite while it is used."""
    may_press: np.ndarray
    """(patch) whether a hand may have caused the data that is refused."""
    only_zeros: np.ndarray
    """(patch) whether all its counts were zero so far."""


class MovedScan(NamedTuple):
    """A scan is passed to the kernels in this form; arrays are (taxel)."""

    counts: np.ndarray
    received: np.ndarray
    rest: np.ndarray
    """Counts at rest."""
    noise: np.ndarray
    """Counts above rest up to which they may be noise."""
    tared: np.ndarray
    """Whether rest is known."""
    now: float
    """Time at which it was taken, since the first scan [s]."""


class MoveLimits(NamedTuple):
    """Limits tell which moves of a taxel count."""

    contact: np.ndarray
    """(taxel) counts above rest at which contact begins."""
    full_scale: int
    """Counts at which the converter saturates."""


class PatchMoves(NamedTuple):
    """Arrays (patch) count the received taxels, and those of them that moved."""

    received: np.ndarray
    known: np.ndarray
    """Taxels of known rest."""
    positive: np.ndarray
    """Above zero."""
    up: np.ndarray
    """Above the last counts that were used, by a step."""
    low: np.ndarray
    """Below those, by more than noise; and below rest by a step, or at zero."""
    zero: np.ndarray
    """At zero, where rest is above it by more than noise."""
    full: np.ndarray
    """At full scale."""


def build_patch_state(taxels: int, patches: int) -> PatchState:
    """Build the state of a skin before its first scan."""
    return PatchState(
        accepted=np.zeros(taxels),
        first_seen=np.full(patches, NEVER),
        last_seen=np.full(patches, NEVER),
        refused_since=np.full(patches, np.inf),
        may_press=np.zeros(patches, np.bool_),
        only_zeros=np.ones(patches, np.bool_),
    )


@compiled
def count_moves(
    scan: MovedScan, limits: MoveLimits, patch_index: Taxels, state: PatchState
) -> PatchMoves:
    """Count the taxels of each patch that moved; see `PatchMoves`."""
    n = len(state.last_seen)
    received, positive = np.zeros(n, np.int64), np.zeros(n, np.int64)
    up, low = np.zeros(n, np.int64), np.zeros(n, np.int64)
    zero, full = np.zeros(n, np.int64), np.zeros(n, np.int64)
    known = np.zeros(n, np.int64)
    for i in range(len(patch_index)):
        if not scan.received[i]:
            continue
        count, last, p = scan.counts[i], state.accepted[i], patch_index[i]
        step = limits.contact[i]
        if state.refused_since[p] == np.inf:
            step *= MOVE_CONTACTS
        received[p] += 1
        positive[p] += count > 0
        known[p] += scan.tared[i]
        full[p] += count >= limits.full_scale
        up[p] += count > last + step
        rest, noise = scan.rest[i], scan.noise[i]
        if count < last - noise:
            is_zero = count <= 0 and rest > noise
            zero[p] += is_zero
            low[p] += is_zero or count < rest - step
    return PatchMoves(received, known, positive, up, low, zero, full)


@compiled
def check_patches(
    scan: MovedScan,
    limits: MoveLimits,
    sizes: Int[np.ndarray, "patch"],
    patch_index: Taxels,
    state: PatchState,
    outcome: Int[np.ndarray, "patch"],
) -> bool:
    """Write to `outcome` whether the data of each patch is used, refused or restarts.

    Returns:
        Whether all data is used.
    """
    moves = count_moves(scan, limits, patch_index, state)
    now, all_used = scan.now, True
    outcome[:] = USED
    for p in range(len(sizes)):
        received = moves.received[p]
        if received == 0:
            continue
        least, is_wide = NEARLY_ALL * received, received > MAX_PRESSED
        is_low = moves.low[p] >= least and 2 * received > sizes[p]
        is_up = is_wide and moves.up[p] >= least
        is_full = is_wide and moves.full[p] >= least
        is_early = now - state.first_seen[p] <= START_SECONDS
        only_zeros, since = state.only_zeros[p], state.refused_since[p]
        state.only_zeros[p] = only_zeros and moves.positive[p] == 0
        state.refused_since[p] = np.inf
        if now - state.last_seen[p] > SILENCE_SECONDS:  # Then any counts are used.
            state.first_seen[p] = now
            state.only_zeros[p] = moves.positive[p] == 0
            outcome[p] = REFUSED if is_full else USED
        elif is_wide and only_zeros and is_early and moves.positive[p] >= least:
            outcome[p] = REFUSED if is_full else RESTARTED
            state.only_zeros[p] = is_full
        elif is_low or (is_wide and moves.up[p] + moves.low[p] >= least):
            outcome[p] = REFUSED
            if since < np.inf and moves.zero[p] + moves.full[p] < least:
                if moves.known[p] < least:
                    outcome[p] = RESTARTED
                elif is_up and state.may_press[p]:
                    outcome[p] = USED
        state.last_seen[p] = now
        if outcome[p] == REFUSED:
            state.refused_since[p] = min(since, now)
            state.may_press[p] = is_up and not is_full and since == np.inf
        all_used &= outcome[p] == USED
    for i in range(len(patch_index)):
        if scan.received[i] and outcome[patch_index[i]] != REFUSED:
            state.accepted[i] = scan.counts[i]
    return all_used
