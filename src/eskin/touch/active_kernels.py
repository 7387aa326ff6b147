"""Compiled choice of the taxels that are active."""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.memory import HELD, Memory
from eskin.touch.rules import Instant, Rules


@compiled
@no_type_check
def find_candidates(
    pressure: Float[np.ndarray, "taxel"], least: float, out: Int[np.ndarray, "taxel"]
) -> int:
    """Write the taxels of at least so much pressure [kPa]; return how many there are.

    All that is done for every taxel of the skin.
    """
    count = 0
    for i in range(len(pressure)):
        if pressure[i] >= least:
            out[count] = i
            count += 1
    return count


@compiled
@no_type_check
def activate(
    candidates: Int[np.ndarray, "candidate"],
    reading: Instant,
    rules: Rules,
    memory: Memory,
) -> Int[np.ndarray, "active"]:
    """Choose the active ones of the candidates, remember them, and order them by rank.

    A taxel that is held needs only the lower threshold. Both rise with the recent peak
    of the taxel, which fades, so that what a sensor keeps after a release is no
    contact. A taxel is held until it is received again, but not for long.

    Args:
        candidates: taxels, ascending.
        reading: an `Instant`.
        rules: `Rules`.
        memory: `Memory`.
    """
    chosen = np.empty(len(candidates), np.int64)
    count, now = 0, reading.now
    since = min(reading.before, now - rules.hold)
    for i in candidates:
        if not reading.valid[i]:
            continue
        taxel, pressure = memory.taxels[i], reading.pressure[i]
        recent = taxel.peak * rules.fade / (rules.fade + now - taxel.active_at)
        if taxel.held and taxel.active_at >= since:
            enough = pressure >= max(rules.off, rules.off_share * recent)
        else:
            enough = pressure >= max(rules.on, rules.on_share * recent)
        if enough:
            chosen[count] = i
            count += 1
            if taxel.active_at != reading.before:
                taxel.onset = reading.stamp
            taxel.peak = max(recent, pressure)
            taxel.active_at = now
    active = chosen[:count]
    hold(active, reading.valid, since, memory)
    return active


@compiled
@no_type_check
def hold(
    active: Int[np.ndarray, "active"],
    valid: Bool[np.ndarray, "taxel"],
    since: float,
    memory: Memory,
) -> None:
    """Hold the active taxels, and those held since then that were not received."""
    taxels, held, count = memory.taxels, memory.held, 0
    for k in range(memory.counts[HELD]):
        i = held[k]
        if valid[i] or taxels[i].active_at < since:
            taxels[i].held = 0
        else:
            held[count] = i
            count += 1
    for i in active:
        taxels[i].held = 1
        held[count] = i
        count += 1
    memory.counts[HELD] = count


@compiled
@no_type_check
def by_rank(
    active: Int[np.ndarray, "active"], sites: np.ndarray
) -> Int[np.ndarray, "active"]:
    """Taxels ordered by patch, row and column, as most skins number them anyway."""
    for a in range(1, len(active)):
        if sites[active[a]].rank < sites[active[a - 1]].rank:
            return active[np.argsort(np.array([sites[i].rank for i in active]))]
    return active
