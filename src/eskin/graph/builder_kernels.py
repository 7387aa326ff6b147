"""The compiled loops of `eskin.graph.builder`: their cost follows the touch."""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from eskin.graph.neighbour_kernels import NOBODY


@njit(cache=True, nogil=True)
@no_type_check
def take_in(
    reading: Float[np.ndarray, "taxel"],
    active: Bool[np.ndarray, "taxel"],
    stamp: int,
    follows: bool,
    pressure: Float[np.ndarray, "taxel"],
    before: Float[np.ndarray, "taxel"],
    was_active: Bool[np.ndarray, "taxel"],
    onset: Int[np.ndarray, "taxel"],
) -> None:
    """Replace what is remembered of the reading before by the next one.

    Args:
        reading: pressures [kPa].
        active: which taxels are touched in it.
        stamp: when it was taken [ns since the epoch].
        follows: whether the reading before is recent enough to tell a rate.
        pressure: of active taxels at the latest reading [kPa].
        before: the same one reading earlier [kPa].
        was_active: which taxels were touched.
        onset: since when [ns since the epoch].
    """
    for t in range(len(reading)):
        before[t] = pressure[t] if follows else 0.0
        pressure[t] = reading[t] if active[t] else 0.0
        if active[t] and not was_active[t]:
            onset[t] = stamp
        was_active[t] = active[t]


@njit(cache=True, nogil=True)
@no_type_check
def find_support(
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    table: Int[np.ndarray, "taxel k"],
    place: Int[np.ndarray, "taxel"],
) -> Int[np.ndarray, "node"]:
    """Taxels active now or before and their fixed neighbours, ascending.

    Args:
        taxels: active now.
        earlier: active one reading ago.
        table: fixed neighbours of each taxel.
        place: -1 everywhere; after the call the node of each taxel, or -1.
    """
    room = (len(taxels) + len(earlier)) * (1 + table.shape[1])
    nodes = np.empty(room, np.int64)
    count = 0
    for those in (taxels, earlier):
        for taxel in those:
            if place[taxel] == NOBODY:
                place[taxel] = 0
                nodes[count] = taxel
                count += 1
            for neighbour in table[taxel]:
                if neighbour != NOBODY and place[neighbour] == NOBODY:
                    place[neighbour] = 0
                    nodes[count] = neighbour
                    count += 1
    found = np.sort(nodes[:count])
    for n in range(count):
        place[found[n]] = n
    return found


@njit(cache=True, nogil=True)
@no_type_check
def load_nodes(
    nodes: Int[np.ndarray, "node"],
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    place: Int[np.ndarray, "taxel"],
    stamp: int,
    pressure: Float[np.ndarray, "taxel"],
    before: Float[np.ndarray, "taxel"],
    onset: Int[np.ndarray, "taxel"],
    out: Float[np.ndarray, "3 node"],
) -> None:
    """Write pressure [kPa], pressure before [kPa] and age [s] of a touch's own nodes.

    What other touches press is not theirs: zero.
    """
    out[:] = np.float32(0.0)
    for taxel in taxels:
        out[0, place[taxel]] = pressure[taxel]
        out[2, place[taxel]] = (stamp - onset[taxel]) * 1e-9
    for taxel in earlier:
        out[1, place[taxel]] = before[taxel]


@njit(cache=True, nogil=True)
@no_type_check
def place_fixed(
    nodes: Int[np.ndarray, "node"],
    table: Int[np.ndarray, "taxel k"],
    place: Int[np.ndarray, "taxel"],
    out: Int[np.ndarray, "node k"],
) -> None:
    """Write the fixed neighbours inside the support, as nodes, or -1.

    Args:
        nodes: taxels.
        table: fixed neighbours of each taxel, as taxels.
        place: the node of each taxel, or -1.
        out: where they go.
    """
    for n in range(len(nodes)):
        for k in range(table.shape[1]):
            neighbour = table[nodes[n], k]
            out[n, k] = NOBODY if neighbour == NOBODY else place[neighbour]
