"""This module finds nearest neighbours: fixed inside a patch, live between patches.

Ties are broken by (patch, row, column), which travels with the taxel, so neither the
order of the taxels nor the pose of the robot changes the neighbours.
"""

from itertools import chain

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from eskin.live.neighbour_kernels import (
    MICROMETRES,
    NO_NODE,
    NeighbourWorkspace,
    write_live_neighbours,
)
from eskin.skin import Skin


class FixedNeighbours:
    """Fixed neighbours are the nearest taxels of the same patch, found once for a skin.

    Attributes:
        table: (taxel, k) neighbours of each taxel, nearest first; -1 fills up.
        rank: rank of each taxel when sorted by (patch, row, column).
    """

    def __init__(self, skin: Skin, k: int) -> None:
        """Find the `k` nearest neighbours of every taxel of a skin."""
        ids = np.array([patch.id for patch in skin.patches])[skin.patch_index]
        order = np.lexsort((skin.columns, skin.rows, ids))
        self.rank = np.empty_like(order)
        self.rank[order] = np.arange(skin.count)
        self.table = np.full((skin.count, k), NO_NODE, dtype=np.int64)
        for patch in range(len(skin.patches)):
            taxels = np.flatnonzero(skin.patch_index == patch)
            self.table[taxels] = find_nearest_in_patch(
                skin.positions[taxels], taxels, self.rank, k
            )

    @property
    def edge_count(self) -> int:
        """Number of directed edges."""
        return int((self.table != NO_NODE).sum())


def allocate_search(nodes: int, k: int) -> NeighbourWorkspace:
    """Allocate memory to search for `k` neighbours of so many nodes."""
    return NeighbourWorkspace(
        boxes=np.zeros((nodes, 2, 3)),
        patches=np.zeros(nodes, np.int64),
        candidates=np.zeros(nodes, np.int64),
        lengths=np.zeros(k),
    )


def find_nearest_in_patch(
    positions: Float[np.ndarray, "part 3"],
    taxels: Int[np.ndarray, "part"],
    rank: Int[np.ndarray, "taxel"],
    k: int,
) -> Int[np.ndarray, "part {k}"]:
    """Return the `k` nearest of `taxels` to each of them, -1 where there are fewer.

    Squared distances are whole numbers of square micrometres, so equal ones are equal
    to the last bit, however the patch lies.
    """
    points = np.rint(positions * MICROMETRES).astype(np.int64)
    one, other = find_close_pairs(points, k)
    squared = ((points[one] - points[other]) ** 2).sum(axis=1)
    order = np.lexsort((rank[taxels[other]], squared, one))
    one, other = one[order], other[order]
    place = np.arange(len(one)) - np.searchsorted(one, one)
    nearest = np.full((len(taxels), k), NO_NODE, dtype=np.int64)
    kept = place < k
    nearest[one[kept], place[kept]] = taxels[other[kept]]
    return nearest


def find_close_pairs(
    points: Int[np.ndarray, "part 3"], k: int
) -> tuple[Int[np.ndarray, "pair"], Int[np.ndarray, "pair"]]:
    """Return pairs of each point with all others no farther than its `k`-th nearest.

    All that tie with the `k`-th nearest are included, so that ranks can break ties.
    """
    tree = KDTree(points)
    distances = np.asarray(tree.query(points, k=min(k + 1, len(points)))[0])
    radius = distances.reshape(len(points), -1)[:, -1]
    # Half a micrometre more, against rounding errors; surplus points are dropped later.
    near = tree.query_ball_point(points, radius + 0.5)
    one = np.repeat(np.arange(len(points)), [len(others) for others in near])
    other = np.fromiter(chain.from_iterable(near), np.int64, len(one))
    different = one != other
    return one[different], other[different]


def find_live_neighbours(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    rank: Int[np.ndarray, "node"],
    k: int,
    reach: float,
) -> Int[np.ndarray, "node {k}"]:
    """Return the `k` nearest nodes of other patches by kinematic distance, or -1.

    Distances are compared in whole micrometres, so that a motion of the whole robot
    neither reorders equal ones nor moves one across the reach.

    Args:
        p_world: positions in the world [m].
        patch: the patch of each node.
        rank: rank of each node, which breaks ties.
        k: number of neighbours per node.
        reach: largest distance to a neighbour [m].
    """
    nearest = np.empty((len(p_world), k), np.int32)
    workspace = allocate_search(len(patch), k)
    write_live_neighbours(p_world, patch, rank, reach, workspace, nearest)
    return nearest
