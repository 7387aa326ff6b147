"""Compiled kernels that update the history of counts for the detection of faults."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled

MAX_REVERSAL_GAP, MAX_REVERSAL_SCANS = 0.15, 5
"""Largest time between two reversals of a noisy taxel: in seconds, and in scans where
the rate is low; the larger one counts."""


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
    jump: np.ndarray
    """Latest change of the counts that was a jump."""
    last_reversal: np.ndarray
    """Time at which a jump last reversed the one before."""
    reversing_since: np.ndarray
    """Time since which jumps have been reversed without a pause."""


@compiled
@no_type_check
def update_history(
    counts: Int[np.ndarray, "taxel"],
    received: Bool[np.ndarray, "taxel"],
    now: float,
    full_scale: int,
    silence: float,
    longest: float,
    min_jump: Float[np.ndarray, "taxel"],
    history: CountHistory,
    mask: Bool[np.ndarray, "taxel"],
) -> None:
    """Update the history with a scan, and mask negative counts at once.

    Args:
        counts: counts of the scan.
        received: which counts are new.
        now: time of the scan [s].
        full_scale: counts at which the converter saturates.
        silence: time without data after which the history restarts [s].
        longest: time above zero after which `least` is measured again [s].
        min_jump: smallest change from one scan to the next that is a jump [counts].
        history: updated.
        mask: faulty taxels; those with negative counts are added.
    """
    last_received, least = history.last_received, history.least
    last_nonzero, last_zero = history.last_nonzero, history.last_zero
    for i in range(len(counts)):
        if not received[i]:
            continue
        count = counts[i]
        if now - last_received[i] > silence:
            reset_taxel(i, count, now, history)
        elapsed = now - last_received[i]
        last_received[i] = now
        change = count - history.counts[i]
        if change != 0:
            if abs(change) >= min_jump[i]:
                record_jump(i, change, now, elapsed, history)
            history.counts[i] = count
            history.last_changed[i] = now
            history.unanswered[i] = 0.0
        if count < full_scale:
            history.last_below_full[i] = now
        if count > 0:
            if last_nonzero[i] < last_zero[i]:
                least[i] = 0.0
            elif least[i] == 0.0 and now - last_zero[i] > longest:
                least[i] = count
            elif count < least[i]:
                least[i] = count
            last_nonzero[i] = now
        elif count == 0:
            last_zero[i] = now
        else:
            history.last_negative[i] = now
            mask[i] = True


@compiled
@no_type_check
def record_jump(
    i: int, jump: int, now: float, elapsed: float, history: CountHistory
) -> None:
    """Record a jump; one of opposite sign to the last is a reversal."""
    if history.jump[i] * jump < 0:
        gap = max(MAX_REVERSAL_GAP, MAX_REVERSAL_SCANS * elapsed)
        if now - history.last_reversal[i] > gap:
            history.reversing_since[i] = now
        history.last_reversal[i] = now
    history.jump[i] = jump


@compiled
@no_type_check
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
    history.jump[i] = 0.0
    history.last_reversal[i] = -np.inf
    history.reversing_since[i] = now


@compiled
@no_type_check
def update_unanswered(
    pressure: Float[np.ndarray, "taxel"],
    valid: Bool[np.ndarray, "taxel"],
    now: float,
    elapsed: float,
    pressed: float,
    pressed_share: float,
    starts: Int[np.ndarray, "taxel_and_one"],
    neighbours: Int[np.ndarray, "pair"],
    history: CountHistory,
) -> None:
    """Add the elapsed time to taxels that do not respond while neighbours are pressed.

    Such a taxel has not changed since all its neighbours were at rest; one that is held
    down steadily changed when it was pressed.
    """
    for i in range(len(starts) - 1):
        known, count = 0, 0
        for k in range(starts[i], starts[i + 1]):
            if valid[neighbours[k]]:
                known += 1
                count += pressure[neighbours[k]] >= pressed
        if count == 0:
            history.last_unpressed[i] = now
        elif known >= 3 and count >= pressed_share * known:
            if history.last_changed[i] <= history.last_unpressed[i]:
                history.unanswered[i] += elapsed
