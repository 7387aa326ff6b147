"""Compiled loops of the fault finder. `no_type_check` keeps the tests' hooks off."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled

PAUSE, PAUSE_SCANS = 0.15, 5
"""Without a turn a taxel comes to rest: in seconds, and in scans at slow rates."""


class Watch(NamedTuple):
    """What the fault finder remembers of each taxel; times in seconds."""

    level: np.ndarray
    """Counts last received."""
    first: np.ndarray
    """When it was first received, or received again after long silence."""
    heard: np.ndarray
    """When it was last received."""
    changed: np.ndarray
    """When its counts last changed."""
    negative: np.ndarray
    """When its counts were last negative."""
    below: np.ndarray
    """When its counts were last below full scale."""
    nonzero: np.ndarray
    """When its counts were last above zero."""
    zero: np.ndarray
    """When they were last at zero."""
    least: np.ndarray
    """Its least counts above zero; zero for a while after it came back from zero."""
    quiet: np.ndarray
    """When none of its neighbours was last pressed."""
    ignored: np.ndarray
    """How long it has not answered while its neighbours were pressed."""
    jump: np.ndarray
    """The latest change of its counts that was a jump."""
    turned: np.ndarray
    """When a jump last undid the one before."""
    restless: np.ndarray
    """Since when it has jumped to and fro without a pause."""


@compiled
@no_type_check
def watch_counts(
    counts: Int[np.ndarray, "taxel"],
    received: Bool[np.ndarray, "taxel"],
    now: float,
    full_scale: int,
    silence: float,
    longest: float,
    jump: Float[np.ndarray, "taxel"],
    watch: Watch,
    mask: Bool[np.ndarray, "taxel"],
) -> None:
    """Note what each count did, and mask negative ones at once.

    Args:
        counts: of the scan.
        received: where they mean anything.
        now: time of the scan [s].
        full_scale: counts at which the converter saturates.
        silence: after how long unheard a taxel is judged anew [s].
        longest: how long counts must have left zero for rest not to be zero [s].
        jump: change from one scan to the next that is a jump [counts].
        watch: what is remembered.
        mask: which taxels are faulty; added to.
    """
    level, heard, changed, below = (
        watch.level,
        watch.heard,
        watch.changed,
        watch.below,
    )
    nonzero, zero, least = watch.nonzero, watch.zero, watch.least
    for i in range(len(counts)):
        if not received[i]:
            continue
        count = counts[i]
        if now - heard[i] > silence:
            start_anew(i, count, now, watch)
        elapsed = now - heard[i]
        heard[i] = now
        if count != level[i]:
            if abs(count - level[i]) >= jump[i]:
                note_jump(i, count - level[i], now, elapsed, watch)
            level[i] = count
            changed[i] = now
            watch.ignored[i] = 0.0
        if count < full_scale:
            below[i] = now
        if count > 0:
            if nonzero[i] < zero[i]:
                least[i] = 0.0
            elif least[i] == 0.0 and now - zero[i] > longest:
                least[i] = count
            elif count < least[i]:
                least[i] = count
            nonzero[i] = now
        elif count == 0:
            zero[i] = now
        else:
            watch.negative[i] = now
            mask[i] = True


@compiled
@no_type_check
def note_jump(i: int, jump: int, now: float, elapsed: float, watch: Watch) -> None:
    """Note a jump; one that undoes the last is a turn, and turns follow each other."""
    if watch.jump[i] * jump < 0:
        if now - watch.turned[i] > max(PAUSE, PAUSE_SCANS * elapsed):
            watch.restless[i] = now
        watch.turned[i] = now
    watch.jump[i] = jump


@compiled
@no_type_check
def start_anew(i: int, count: int, now: float, watch: Watch) -> None:
    """Forget a taxel: it is heard for the first time, or after long silence."""
    watch.first[i] = now
    watch.changed[i] = now
    watch.level[i] = count
    watch.below[i] = -np.inf
    watch.nonzero[i] = -np.inf
    watch.zero[i] = -np.inf
    watch.least[i] = np.inf
    watch.quiet[i] = -np.inf
    watch.ignored[i] = 0.0
    watch.jump[i] = 0.0
    watch.turned[i] = -np.inf
    watch.restless[i] = now


@compiled
@no_type_check
def watch_neighbours(
    pressure: Float[np.ndarray, "taxel"],
    valid: Bool[np.ndarray, "taxel"],
    now: float,
    elapsed: float,
    pressed: float,
    share: float,
    starts: Int[np.ndarray, "taxel_and_one"],
    neighbours: Int[np.ndarray, "pair"],
    watch: Watch,
) -> None:
    """Add up how long each taxel has stood still among pressed neighbours.

    Only a taxel whose counts have not changed since all neighbours were at rest counts
    as not answering: one that is held down steadily changed when it was pressed.
    """
    for i in range(len(starts) - 1):
        known, down = 0, 0
        for k in range(starts[i], starts[i + 1]):
            if valid[neighbours[k]]:
                known += 1
                down += pressure[neighbours[k]] >= pressed
        if down == 0:
            watch.quiet[i] = now
        elif known >= 3 and down >= share * known:
            if watch.changed[i] <= watch.quiet[i]:
                watch.ignored[i] += elapsed
