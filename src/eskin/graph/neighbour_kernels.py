"""The compiled search for the nearest nodes of other patches."""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

MICROMETRES = 1e6
NOBODY = -1


@njit(cache=True, nogil=True)
@no_type_check
def find_nearest(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    rank: Int[np.ndarray, "node"],
    reach: float,
    out: Int[np.ndarray, "node k"],
) -> None:
    """Write the nearest nodes of other patches, nearest first, or -1.

    Distances are compared in whole micrometres; see `live_neighbours`.

    Args:
        p_world: positions in the world [m].
        patch: the patch of each node.
        rank: breaks ties.
        reach: farthest neighbour [m].
        out: where the neighbours go.
    """
    out[:] = NOBODY
    farthest = np.rint(reach * MICROMETRES)
    widest = (farthest + 1.0) / MICROMETRES
    near = np.flatnonzero(near_others(p_world, patch, widest))
    lengths = np.empty(out.shape[1])
    for n in near:
        lengths[:] = np.inf
        for m in near:
            if patch[m] == patch[n]:
                continue
            x = p_world[n, 0] - p_world[m, 0]
            y = p_world[n, 1] - p_world[m, 1]
            z = p_world[n, 2] - p_world[m, 2]
            squared = x * x + y * y + z * z
            if squared > widest * widest:
                continue
            length = np.rint(np.sqrt(squared) * MICROMETRES)
            if length <= farthest:
                keep(m, length, rank, lengths, out[n])


@njit(cache=True, nogil=True)
@no_type_check
def near_others(
    p_world: Float[np.ndarray, "node 3"], patch: Int[np.ndarray, "node"], reach: float
) -> Bool[np.ndarray, "node"]:
    """Which nodes are within reach of the box round another patch's nodes.

    Most are not: those alone are compared with each other.
    """
    near = np.zeros(len(patch), np.bool_)
    boxed = np.zeros(len(patch), np.bool_)
    for first in range(len(patch)):
        if boxed[first]:
            continue
        low, high = p_world[first].copy(), p_world[first].copy()
        for n in range(first, len(patch)):
            if patch[n] == patch[first]:
                boxed[n] = True
                for d in range(3):
                    low[d] = min(low[d], p_world[n, d])
                    high[d] = max(high[d], p_world[n, d])
        for n in range(len(patch)):
            if patch[n] != patch[first]:
                gap = 0.0
                for d in range(3):
                    gap = max(gap, low[d] - p_world[n, d], p_world[n, d] - high[d])
                near[n] |= gap <= reach
    return near


@njit(cache=True, nogil=True)
@no_type_check
def keep(
    node: int,
    length: float,
    rank: Int[np.ndarray, "node"],
    lengths: Float[np.ndarray, "k"],
    nearest: Int[np.ndarray, "k"],
) -> None:
    """Put a node among the nearest if it is one of them; ties go by rank."""
    k = len(nearest)
    while k > 0 and is_nearer(node, length, nearest[k - 1], lengths[k - 1], rank):
        k -= 1
    for last in range(len(nearest) - 1, k, -1):
        nearest[last], lengths[last] = nearest[last - 1], lengths[last - 1]
    if k < len(nearest):
        nearest[k], lengths[k] = node, length


@njit(cache=True, nogil=True)
@no_type_check
def is_nearer(
    one: int,
    length: float,
    other: int,
    other_length: float,
    rank: Int[np.ndarray, "node"],
) -> bool:
    """Whether one node is nearer than another, or as near and first by rank."""
    if other == NOBODY or length != other_length:
        return length < other_length
    return rank[one] < rank[other]
