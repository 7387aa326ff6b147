"""Compiled kernels that find the scans of a patch that no touch can cause.

After a reset of its board, with a loose plug or in a corrupt packet, nearly all taxels
of a patch move within one scan: to zero or elsewhere below rest, to full scale, or
anywhere. Such a scan counts as not received, and so do the next ones until the counts
are near those of the last scan that was used. If nearly all taxels move up, a hand may
press them: the second such scan is used.

A patch restarts at such a move before its rest is known, and when it leaves zeros that
it has sent from the start, soon after it.
"""

# pyright: reportAttributeAccessIssue=false, reportArgumentType=false
# pyright: reportReturnType=false
# Fields of records, and what is an element of an array, are known to numba only.

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from eskin.compiled import Packed, compiled
from eskin.touch.context import FrontEndContext, KernelScan
from eskin.touch.crosstalk_kernels import compute_conductance, find_own
from eskin.touch.taxel_kernels import is_silent, reset_taxel

Taxels = Int[np.ndarray, "taxel"]

NEARLY_ALL = 0.8
"""Share of the received taxels of a patch that move at once."""
MAX_PRESSED = 12
"""Number of taxels that a hand may press within one scan."""
MOVE_CONTACTS = 4.0
"""Smallest move of a taxel that counts, in units of the counts at which contact begins;
a move by one of these keeps a patch refused."""
USED, REFUSED, RESTARTED = range(3)
"""Outcomes of the check of a patch."""


class PatchMoves(NamedTuple):
    """Counts the received taxels of a patch, and which of them moved."""

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


@compiled
def count_moves(
    scan: KernelScan, members: Taxels, is_refused: bool, context: FrontEndContext
) -> PatchMoves:
    """Count the taxels of a patch that moved; see `PatchMoves`."""
    size = context.samples.shape[1]
    factor = 1.0 if is_refused else MOVE_CONTACTS
    used = 0
    known = 0
    positive = 0
    up = 0
    low = 0
    zero = 0
    full = 0
    for i in members:
        if not scan.received[i]:
            continue
        taxel = context.taxels[i]
        count = scan.counts[i]
        step = factor * context.constants[i].contact
        used += 1
        positive += count > 0
        full += count >= context.full_scale
        up += count > taxel.accepted + step
        if count < taxel.accepted - taxel.noise_limit:
            is_zero = count <= 0 and taxel.rest > taxel.noise_limit
            zero += is_zero
            low += is_zero or count < taxel.rest - step
        if is_refused:
            known += taxel.sample_count >= size
    if context.line_share > 0.0 and up > 0 and up >= NEARLY_ALL * used:
        up = count_pressed(scan, members, factor, context)
    return PatchMoves(used, known, positive, up, low, zero, full)


@compiled
def count_pressed(
    scan: KernelScan, members: Taxels, contacts: float, context: FrontEndContext
) -> int:
    """Count the taxels of a matrix that moved up by more than crosstalk."""
    find_own(members, scan.counts, context)
    count = 0
    for i in members:
        step = contacts * context.constants[i].contact
        above = max(context.taxels[i].accepted - context.taxels[i].rest, 0.0)
        least = compute_conductance(above + step, context)
        count += scan.received[i] and context.crosstalk.own[i] > least
    return count


@compiled
def check_patches(scan: KernelScan, packed_context: Packed) -> bool:
    """Find out whether the data of each patch is used, refused or restarts.

    Refused data is marked as not received, and not used. Taxels of which nothing is
    known any more, and those of a patch that restarts, begin anew. Where no data was
    used for so long, rest begins anew.

    Returns:
        Whether it does so on some taxels.
    """
    context = packed_context.fields
    now = scan.now
    groups = context.places.patches
    begins = False
    for n in range(len(groups.sizes)):
        members = groups.order[groups.starts[n] : groups.starts[n + 1]]
        patch = context.patches[n]
        is_refused = patch.refused_since < np.inf
        moves = count_moves(scan, members, is_refused, context)
        patch.outcome = USED
        if moves.received > 0:
            check_patch(moves, len(members), now, patch)
        for i in members:
            taxel = context.taxels[i]
            if patch.outcome == REFUSED:
                scan.received[i] = False
                scan.used[i] = False
            elif scan.received[i]:
                taxel.accepted = scan.counts[i]
            is_new = scan.received[i] and is_silent(taxel.last_received, now)
            if is_new or patch.outcome == RESTARTED:
                reset_taxel(i, context.constants, context.taxels)
            if patch.outcome == RESTARTED:
                taxel.sample_count = 0
            scan.starts[i] = scan.used[i] and is_silent(taxel.last_used, now)
            begins |= scan.starts[i]
    return begins


@compiled
def check_patch(moves: PatchMoves, size: int, now: float, patch: np.void) -> None:
    """Find out whether the data of a patch of some taxels is used."""
    least = NEARLY_ALL * moves.received
    is_wide = moves.received > MAX_PRESSED
    is_low = moves.low >= least and 2 * moves.received > size
    is_up = is_wide and moves.up >= least
    is_full = is_wide and moves.full >= least
    # Later, zeros are rest, and what leaves them is a press.
    is_early = not is_silent(patch.first_seen, now)
    only_zeros = patch.only_zeros
    since = patch.refused_since
    patch.only_zeros = only_zeros and moves.positive == 0
    patch.refused_since = np.inf
    if is_silent(patch.last_seen, now):  # Then any counts are used.
        patch.first_seen = now
        patch.only_zeros = moves.positive == 0
        patch.outcome = REFUSED if is_full else USED
    elif is_wide and only_zeros and is_early and moves.positive >= least:
        patch.outcome = REFUSED if is_full else RESTARTED
        patch.only_zeros = is_full
    elif is_low or (is_wide and moves.up + moves.low >= least):
        patch.outcome = REFUSED
        if since < np.inf and moves.full < least:
            if moves.known < least:
                patch.outcome = RESTARTED
                patch.first_seen = now
                patch.only_zeros = moves.positive == 0
            elif moves.zero < least and is_up and patch.may_press:
                patch.outcome = USED
    patch.last_seen = now
    if patch.outcome == REFUSED:
        patch.refused_since = min(since, now)
        patch.may_press = is_up and not is_full and since == np.inf
