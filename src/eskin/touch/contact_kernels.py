"""Compiled loops over active taxels. `no_type_check` keeps the tests' hooks off."""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

PASCAL = 1000.0


@njit(cache=True)
@no_type_check
def activate(
    candidates: Int[np.ndarray, "candidate"],
    pressure: Float[np.ndarray, "taxel"],
    valid: Bool[np.ndarray, "taxel"],
    now: float,
    since: float,
    limits: tuple[float, float, float, float, float],
    held_at: Float[np.ndarray, "taxel"],
    active_at: Float[np.ndarray, "taxel"],
    peak: Float[np.ndarray, "taxel"],
) -> Int[np.ndarray, "active"]:
    """Choose the active ones of the candidates and remember them.

    A taxel held at `since` or later needs only the lower threshold. Both rise with
    the recent peak of the taxel, which fades, so that what a sensor keeps after a
    release is no contact.
    """
    on, off, on_share, off_share, fade = limits
    chosen = np.empty(len(candidates), np.int64)
    count = 0
    for i in candidates:
        if not valid[i]:
            continue
        recent = peak[i] * fade / (fade + now - active_at[i])
        if held_at[i] >= since:
            enough = pressure[i] >= max(off, off_share * recent)
        else:
            enough = pressure[i] >= max(on, on_share * recent)
        if enough:
            chosen[count] = i
            count += 1
            peak[i] = max(recent, pressure[i])
            active_at[i] = now
    return chosen[:count]


@njit(cache=True)
@no_type_check
def root_of(parents: Int[np.ndarray, "active"], i: int) -> int:
    """The representative of an element's set."""
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@njit(cache=True)
@no_type_check
def join(parents: Int[np.ndarray, "active"], i: int, j: int) -> None:
    """Join the sets of two elements; the earlier one represents both."""
    a, b = root_of(parents, i), root_of(parents, j)
    if a != b:
        parents[max(a, b)] = min(a, b)


@njit(cache=True)
@no_type_check
def connect(
    active: Int[np.ndarray, "active"],
    p_world: Float[np.ndarray, "active 3"],
    links: Int[np.ndarray, "taxel"],
    reach: Float[np.ndarray, "taxel"],
    starts: Int[np.ndarray, "taxel_and_one"],
    neighbours: Int[np.ndarray, "pair"],
    slot: Int[np.ndarray, "taxel"],
) -> Int[np.ndarray, "active"]:
    """Number the connected sets of active taxels, in the order of their first taxel."""
    count = len(active)
    parents = np.arange(count)
    for a in range(count):
        slot[active[a]] = a
    for a in range(count):
        i = active[a]
        for k in range(starts[i], starts[i + 1]):
            b = slot[neighbours[k]]
            if b > a:
                join(parents, a, b)
        for b in range(a + 1, count):
            j = active[b]
            if links[i] != links[j]:
                far = max(reach[i], reach[j])
                d0 = p_world[a, 0] - p_world[b, 0]
                d1 = p_world[a, 1] - p_world[b, 1]
                d2 = p_world[a, 2] - p_world[b, 2]
                if d0 * d0 + d1 * d1 + d2 * d2 <= far * far:
                    join(parents, a, b)
    for a in range(count):
        slot[active[a]] = -1
    labels = np.empty(count, np.int64)
    found = 0
    for a in range(count):
        if parents[a] == a:
            labels[a] = found
            found += 1
        else:
            labels[a] = labels[root_of(parents, a)]
    return labels


@njit(cache=True)
@no_type_check
def place(
    active: Int[np.ndarray, "active"],
    vectors: Float[np.ndarray, "taxel 3"],
    links: Int[np.ndarray, "taxel"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    moved: float,
) -> Float[np.ndarray, "active 3"]:
    """Vectors in the world: points where `moved` is 1, directions where it is 0."""
    result = np.empty((len(active), 3))
    for a in range(len(active)):
        i = active[a]
        T = T_world_link[links[i]]
        for r in range(3):
            result[a, r] = moved * T[r, 3] + (
                T[r, 0] * vectors[i, 0]
                + T[r, 1] * vectors[i, 1]
                + T[r, 2] * vectors[i, 2]
            )
    return result


@njit(cache=True)
@no_type_check
def summarise(
    active: Int[np.ndarray, "active"],
    labels: Int[np.ndarray, "active"],
    sets: int,
    pressure: Float[np.ndarray, "taxel"],
    areas: Float[np.ndarray, "taxel"],
    p_world: Float[np.ndarray, "active 3"],
    n_world: Float[np.ndarray, "active 3"],
) -> tuple[
    Float[np.ndarray, "contact 9"],
    Int[np.ndarray, "contact"],
]:
    """Force [N], area [m2], peak [kPa], centre, normal, and the most loaded taxel."""
    sums = np.zeros((sets, 9))
    loaded = np.zeros(sets, np.int64)
    most = np.full(sets, -1.0)
    for a in range(len(active)):
        i, n = active[a], labels[a]
        force = PASCAL * pressure[i] * areas[i]
        sums[n, 0] += force
        sums[n, 1] += areas[i]
        sums[n, 2] = max(sums[n, 2], pressure[i])
        for r in range(3):
            sums[n, 3 + r] += force * p_world[a, r]
            sums[n, 6 + r] += force * n_world[a, r]
        if force > most[n]:
            most[n] = force
            loaded[n] = i
    for n in range(sets):
        length = np.sqrt(sums[n, 6] ** 2 + sums[n, 7] ** 2 + sums[n, 8] ** 2)
        for r in range(3):
            sums[n, 3 + r] /= sums[n, 0]
            if length > 0.0:
                sums[n, 6 + r] /= length
    return sums, loaded
