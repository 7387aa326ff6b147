"""The compiled search for the nearest nodes of other patches."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled

MICROMETRES = 1e6
NOBODY = -1


class Search(NamedTuple):
    """Where the search for neighbours of other patches keeps its notes."""

    boxes: np.ndarray
    """(box, 2, 3) least and greatest coordinates of each patch [m]"""
    patches: np.ndarray
    """(box) its patch"""
    near: np.ndarray
    """(node) those near other patches"""
    lengths: np.ndarray
    """(neighbour) distances of the nearest so far [um]"""


@compiled
@no_type_check
def find_nearest(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    rank: Int[np.ndarray, "node"],
    reach: float,
    search: Search,
    out: Int[np.ndarray, "node k"],
) -> None:
    """Write the nearest nodes of other patches, nearest first, or -1.

    Distances are compared in whole micrometres; see `live_neighbours`.

    Args:
        p_world: positions in the world [m].
        patch: the patch of each node.
        rank: breaks ties.
        reach: farthest neighbour [m].
        search: memory for its notes.
        out: where the neighbours go.
    """
    out[:] = NOBODY
    farthest = np.rint(reach * MICROMETRES)
    widest = (farthest + 1.0) / MICROMETRES
    count, near = find_near(p_world, patch, widest, search), search.near
    lengths, last = search.lengths, out.shape[1] - 1
    if last < 0:
        return
    for a in range(count):
        n = near[a]
        lengths[:] = np.inf
        within = widest  # of the last of the nearest so far, or of all
        for b in range(count):
            m = near[b]
            if patch[m] == patch[n]:
                continue
            x = p_world[n, 0] - p_world[m, 0]
            y = p_world[n, 1] - p_world[m, 1]
            z = p_world[n, 2] - p_world[m, 2]
            squared = x * x + y * y + z * z
            if squared > within * within:
                continue
            length = np.rint(np.sqrt(squared) * MICROMETRES)
            if length <= farthest:
                keep(m, length, rank, lengths, n, out)
                within = min(widest, (lengths[last] + 1.0) / MICROMETRES)


@compiled
@no_type_check
def find_near(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    reach: float,
    search: Search,
) -> int:
    """List the nodes within reach of the box round another patch's; return how many.

    Most are not: those alone are compared with each other.
    """
    boxes = find_boxes(p_world, patch, search)
    count, box, patches, near = 0, search.boxes, search.patches, search.near
    if boxes < 2:
        return count
    for n in range(len(patch)):
        for b in range(boxes):
            if patches[b] == patch[n]:
                continue
            gap = 0.0
            for d in range(3):
                low, high = box[b, 0, d], box[b, 1, d]
                gap = max(gap, low - p_world[n, d], p_world[n, d] - high)
            if gap <= reach:
                near[count] = n
                count += 1
                break
    return count


@compiled
@no_type_check
def find_boxes(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    search: Search,
) -> int:
    """Write the box round the nodes of each patch; return how many there are."""
    boxes, patches = search.boxes, search.patches
    count, b = 0, 0
    for n in range(len(patch)):
        if count == 0 or patches[b] != patch[n]:  # else it is that of the last
            b = 0
            while b < count and patches[b] != patch[n]:
                b += 1
        if b == count:
            patches[b] = patch[n]
            for d in range(3):
                boxes[b, 0, d], boxes[b, 1, d] = p_world[n, d], p_world[n, d]
            count += 1
        for d in range(3):
            boxes[b, 0, d] = min(boxes[b, 0, d], p_world[n, d])
            boxes[b, 1, d] = max(boxes[b, 1, d], p_world[n, d])
    return count


@compiled
@no_type_check
def keep(
    node: int,
    length: float,
    rank: Int[np.ndarray, "node"],
    lengths: Float[np.ndarray, "k"],
    asking: int,
    out: Int[np.ndarray, "node k"],
) -> None:
    """Put a node among the nearest of another if it is one; ties go by rank."""
    last = out.shape[1] - 1
    k = last + 1
    while k > 0 and is_nearer(node, length, out[asking, k - 1], lengths[k - 1], rank):
        k -= 1
    for other in range(last, k, -1):
        out[asking, other], lengths[other] = out[asking, other - 1], lengths[other - 1]
    if k <= last:
        out[asking, k], lengths[k] = node, length


@compiled
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
