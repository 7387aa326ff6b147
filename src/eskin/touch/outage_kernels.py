"""Compiled kernels that find the scans of a patch that no touch can cause."""

# pyright: reportAttributeAccessIssue=false, reportArgumentType=false
# Fields of records, and what is an element of an array, are known to numba only.

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from eskin.compiled import compiled
from eskin.touch.belief_kernels import NEVER
from eskin.touch.calibration_kernels import SILENCE_SECONDS

Taxels = Int[np.ndarray, "taxel"]

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


PATCH = np.dtype(
    [("first_seen", np.float64), ("last_seen", np.float64)]
    + [("refused_since", np.float64), ("may_press", np.int64)]
    + [("only_zeros", np.int64), ("outcome", np.int64)]
)
"""What is known of a patch: the time of its first data, or of the first after a long
silence, and of the last [s]; from when on its data is refused, infinite while it is
used; whether a hand may have caused the data that is refused; whether all its counts
were zero so far; and the outcome of the check of the latest scan."""


class MovedScan(NamedTuple):
    """A scan is passed to the kernels in this form; arrays are (taxel)."""

    counts: np.ndarray
    received: np.ndarray
    rest: np.ndarray
    """Counts at rest."""
    sample_count: np.ndarray
    """Number of samples taken for the tare."""
    noise: np.ndarray
    """Counts above rest up to which they may be noise."""
    now: float
    """Time at which it was taken, since the first scan [s]."""


class OutageContext(NamedTuple):
    """A context holds the arguments of the kernels that are kept between scans."""

    contact: np.ndarray  # (taxel) counts above rest at which contact begins
    full_scale: int  # Counts at which the converter saturates
    tare_samples: int  # Number of samples from which rest is known
    order: np.ndarray  # (taxel) indices of the taxels, patch by patch
    starts: np.ndarray  # (patch + 1) place of the first taxel of each patch in `order`
    accepted: np.ndarray  # (taxel) counts of the last scan that was used
    state: np.ndarray  # (patch) `PATCH`, which is updated


class PatchMoves(NamedTuple):
    """Counts the received taxels of a patch, and those of them that moved."""

    received: int
    known: int
    """Taxels of known rest, counted while data is refused."""
    positive: int
    """Above zero."""
    up: int
    """Above the last counts that were used, by a step."""
    low: int
    """Below those, by more than noise; and below rest by a step, or at zero."""
    zero: int
    """At zero, where rest is above it by more than noise."""
    full: int
    """At full scale."""


def build_patch_state(patches: int) -> np.ndarray:
    """Build the state of a skin before its first scan, of dtype `PATCH`."""
    state = np.zeros(patches, PATCH)
    state["first_seen"] = state["last_seen"] = NEVER
    state["refused_since"], state["only_zeros"] = np.inf, True
    return state


@compiled
def count_moves(
    scan: MovedScan, taxels: Taxels, is_refused: bool, context: OutageContext
) -> PatchMoves:
    """Count the taxels of a patch that moved; see `PatchMoves`."""
    counts, received, accepted = scan.counts, scan.received, context.accepted
    noises, contact, full_scale = scan.noise, context.contact, context.full_scale
    factor = 1.0 if is_refused else MOVE_CONTACTS
    used, known, positive, up, low, zero, full = 0, 0, 0, 0, 0, 0, 0
    for i in taxels:
        if not received[i]:
            continue
        count, last, step = counts[i], accepted[i], factor * contact[i]
        used += 1
        positive += count > 0
        full += count >= full_scale
        up += count > last + step
        if count < last - noises[i]:
            is_zero = count <= 0 and scan.rest[i] > noises[i]
            zero += is_zero
            low += is_zero or count < scan.rest[i] - step
        if is_refused:
            known += scan.sample_count[i] >= context.tare_samples
    return PatchMoves(used, known, positive, up, low, zero, full)


@compiled
def check_patches(scan: MovedScan, context: OutageContext) -> bool:
    """Find out whether the data of each patch is used, refused or restarts.

    Returns:
        Whether all data is used.
    """
    all_used = True
    for p in range(len(context.state)):
        taxels = context.order[context.starts[p] : context.starts[p + 1]]
        patch = context.state[p]
        is_refused = patch.refused_since < np.inf
        moves = count_moves(scan, taxels, is_refused, context)
        patch.outcome = USED
        if moves.received > 0:
            check_patch(moves, len(taxels), scan.now, patch)
        all_used &= patch.outcome == USED
        if patch.outcome != REFUSED:
            for i in taxels:
                if scan.received[i]:
                    context.accepted[i] = scan.counts[i]
    return all_used


@compiled
def check_patch(moves: PatchMoves, size: int, now: float, patch: np.void) -> None:
    """Find out whether the data of a patch of some taxels is used."""
    least, is_wide = NEARLY_ALL * moves.received, moves.received > MAX_PRESSED
    is_low = moves.low >= least and 2 * moves.received > size
    is_up = is_wide and moves.up >= least
    is_full = is_wide and moves.full >= least
    is_early = now - patch.first_seen <= START_SECONDS
    only_zeros, since = patch.only_zeros, patch.refused_since
    patch.only_zeros = only_zeros and moves.positive == 0
    patch.refused_since = np.inf
    if now - patch.last_seen > SILENCE_SECONDS:  # Then any counts are used.
        patch.first_seen = now
        patch.only_zeros = moves.positive == 0
        patch.outcome = REFUSED if is_full else USED
    elif is_wide and only_zeros and is_early and moves.positive >= least:
        patch.outcome = REFUSED if is_full else RESTARTED
        patch.only_zeros = is_full
    elif is_low or (is_wide and moves.up + moves.low >= least):
        patch.outcome = REFUSED
        if since < np.inf and moves.zero + moves.full < least:
            if moves.known < least:
                patch.outcome = RESTARTED
            elif is_up and patch.may_press:
                patch.outcome = USED
    patch.last_seen = now
    if patch.outcome == REFUSED:
        patch.refused_since = min(since, now)
        patch.may_press = is_up and not is_full and since == np.inf
