"""Compiled kernels that update the history of counts for the detection of faults."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from eskin.compiled import compiled
from eskin.touch.adjacency import Adjacency
from eskin.touch.belief_kernels import CountScan
from eskin.touch.calibration_kernels import find_near

Values = Float[np.ndarray, "taxel"]


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


class CountLimits(NamedTuple):
    """Limits tell what is faulty and what is noisy; see `FaultConfig`."""

    full_scale: int
    """Counts at which the converter saturates."""
    contact: np.ndarray
    """Counts above rest (taxel) at which contact begins."""
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
