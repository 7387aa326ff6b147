"""Compiled kernels that begin the state of a taxel, and look at its neighbours."""

# pyright: reportAttributeAccessIssue=false
# Fields of records are known to numba only.

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.touch.adjacency import Adjacency

Taxels = Int[np.ndarray, "some"]
Values = Float[np.ndarray, "some"]

SILENCE_SECONDS = 10.0
"""Time without data after which nothing is known of a taxel or patch any more [s]: it
may be another one."""
SHORTEST_PRESS = 0.05
"""Time between two scans up to which a press is seen in both [s]; what is seen in one
alone is corrupt."""
NEVER = -1e9
"""Time before all others [s]."""
NO_FAULT = -1
"""Code of a taxel without a fault."""


@compiled
def is_silent(last: float, now: float) -> bool:
    """Return whether nothing is known any more of what last had data at a time [s]."""
    return now - last > SILENCE_SECONDS


@compiled
def reset_taxel(i: int, constants: np.ndarray, taxels: np.ndarray) -> None:
    """Forget the state of a taxel, but for the time at which it was doubtful."""
    taxel = taxels[i]
    taxel.first_received = np.inf
    taxel.last_received = NEVER
    reset_rest(i, taxels)
    taxel.first = taxel.second = taxel.third = taxel.fourth = np.nan
    taxel.noise = constants[i].start_noise
    taxel.wander = 0.0
    taxel.suspicion = 0.0
    taxel.flat_since = NEVER
    taxel.code = NO_FAULT
    taxel.last_changed = taxel.last_negative = taxel.last_below_full = NEVER
    taxel.last_nonzero = taxel.last_zero = taxel.last_unpressed = NEVER
    taxel.last_found = taxel.last_sound = NEVER
    taxel.least = np.inf
    taxel.unanswered = 0.0
    taxel.pressed_at = taxel.risen_at = NEVER


@compiled
def reset_rest(i: int, taxels: np.ndarray) -> None:
    """Forget what moved the rest of a taxel; its samples and its rest stay."""
    taxel = taxels[i]
    taxel.last_used = NEVER
    taxel.next_sample = NEVER
    taxel.above = taxel.confirmed = taxel.peak = 0.0
    taxel.low = taxel.low_since = np.inf
    taxel.touched_since = np.inf
    taxel.last_touched = NEVER
    taxel.steady_level = np.inf
    taxel.steady_since = NEVER


@compiled
def find_near(i: int, adjacency: Adjacency) -> Taxels:
    """Return the neighbours of a taxel."""
    return adjacency.neighbours[adjacency.starts[i] : adjacency.starts[i + 1]]


@compiled
def select(values: Values, place: int) -> float:
    """Return the value at a place in ascending order; the values change their places.

    Numba compiles `np.partition` and `np.median` for ten seconds.
    """
    first = 0
    last = len(values) - 1
    while first < last:
        pivot = values[place]
        i = first
        j = last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < place:
            first = i
        if i > place:
            last = j
    return values[place]
