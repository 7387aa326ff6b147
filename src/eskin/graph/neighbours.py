"""Nearest neighbours: fixed inside a patch, live between patches.

Ties are broken by (patch, row, column), which travels with the taxel, so neither the
order of the taxels nor the place of the robot decides who is whose neighbour.
"""

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.neighbour_kernels import MICROMETRES, NOBODY, Search, find_nearest
from eskin.skin import Skin


class FixedNeighbours:
    """The K nearest taxels of the same patch, found once for a skin.

    Attributes:
        table: the neighbours of each taxel, nearest first, or -1.
        rank: place of each taxel when sorted by (patch, row, column).
    """

    def __init__(self, skin: Skin, k: int) -> None:
        """Find the `k` nearest neighbours of every taxel of a skin."""
        ids = np.array([patch.id for patch in skin.patches])[skin.patch_index]
        self.rank = ranks(np.lexsort((skin.columns, skin.rows, ids)))
        self.table = np.full((skin.count, k), NOBODY, dtype=np.int64)
        for patch in range(len(skin.patches)):
            taxels = np.flatnonzero(skin.patch_index == patch)
            self.table[taxels] = nearest_in_patch(
                skin.positions[taxels], taxels, self.rank, k
            )

    @property
    def edge_count(self) -> int:
        """Number of directed edges."""
        return int((self.table != NOBODY).sum())


def search_memory(nodes: int, k: int) -> Search:
    """Memory to look for so many neighbours of so many nodes."""
    return Search(
        boxes=np.zeros((nodes, 2, 3)),
        patches=np.zeros(nodes, np.int64),
        near=np.zeros(nodes, np.int64),
        lengths=np.zeros(k),
    )


def ranks(order: Int[np.ndarray, "taxel"]) -> Int[np.ndarray, "taxel"]:
    """The place of each entry in a sorting order."""
    places = np.empty_like(order)
    places[order] = np.arange(len(order))
    return places


def nearest_in_patch(
    positions: Float[np.ndarray, "part 3"],
    taxels: Int[np.ndarray, "part"],
    rank: Int[np.ndarray, "taxel"],
    k: int,
) -> Int[np.ndarray, "part {k}"]:
    """The `k` nearest of `taxels` to each of them, -1 where there are fewer.

    Squared distances are whole numbers of square micrometres, so equal ones are equal
    to the last bit, however the patch lies.
    """
    whole = np.rint(positions * MICROMETRES).astype(np.int64)
    nearest = np.full((len(taxels), k), NOBODY, dtype=np.int64)
    for row, place in enumerate(whole):
        squared = ((whole - place) ** 2).sum(axis=1)
        order = np.lexsort((rank[taxels], squared))
        others = taxels[order[order != row]][:k]
        nearest[row, : len(others)] = others
    return nearest


def live_neighbours(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    rank: Int[np.ndarray, "node"],
    k: int,
    reach: float,
) -> Int[np.ndarray, "node {k}"]:
    """The `k` nearest nodes of other patches by kinematic distance, or -1.

    Distances are compared in whole micrometres, so that a motion of the whole robot
    neither orders equal ones anew nor takes one across the reach.

    Args:
        p_world: positions in the world [m].
        patch: the patch of each node.
        rank: breaks ties.
        k: neighbours a node.
        reach: farthest neighbour [m].
    """
    nearest = np.empty((len(p_world), k), np.int32)
    find_nearest(p_world, patch, rank, reach, search_memory(len(patch), k), nearest)
    return nearest
