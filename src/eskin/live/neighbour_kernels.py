"""Compiled kernels that find the nearest nodes of other patches."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled

MICROMETRES = 1e6
NO_NODE = -1


class NeighbourWorkspace(NamedTuple):
    """A workspace is the memory of a search for neighbours of other patches."""

    boxes: Float[np.ndarray, "box 2 3"]  # least and greatest coordinates of a patch [m]
    patches: Int[np.ndarray, "box"]  # patch of each box
    candidates: Int[np.ndarray, "node"]  # nodes near other patches
    lengths: Float[np.ndarray, "neighbour"]  # distances of the nearest so far [um]


@compiled
def write_live_neighbours(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    rank: Int[np.ndarray, "node"],
    reach: float,
    workspace: NeighbourWorkspace,
    out: Int[np.ndarray, "node k"],
) -> None:
    """Write the neighbours of each node; see `find_live_neighbours` for arguments."""
    out[:] = NO_NODE
    max_length = np.rint(reach * MICROMETRES)
    search_radius = (max_length + 1.0) / MICROMETRES
    count = find_candidates(p_world, patch, search_radius, workspace)
    candidates, lengths = workspace.candidates, workspace.lengths
    last = out.shape[1] - 1
    if last < 0:
        return
    for a in range(count):
        n = candidates[a]
        lengths[:] = np.inf
        radius = search_radius  # shrinks to the distance of the last of the nearest
        for b in range(count):
            m = candidates[b]
            if patch[m] == patch[n]:
                continue
            x = p_world[n, 0] - p_world[m, 0]
            y = p_world[n, 1] - p_world[m, 1]
            z = p_world[n, 2] - p_world[m, 2]
            squared = x * x + y * y + z * z
            if squared > radius * radius:
                continue
            length = np.rint(np.sqrt(squared) * MICROMETRES)
            if length <= max_length:
                insert_neighbour(m, length, rank, lengths, n, out)
                radius = min(search_radius, (lengths[last] + 1.0) / MICROMETRES)


@compiled
def find_candidates(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    reach: float,
    workspace: NeighbourWorkspace,
) -> int:
    """List the nodes within reach of the box around another patch; return their number.

    Only these, few of all nodes, are compared with each other.
    """
    box_count = write_boxes(p_world, patch, workspace)
    count, boxes, patches = 0, workspace.boxes, workspace.patches
    if box_count < 2:
        return count
    for n in range(len(patch)):
        for b in range(box_count):
            if patches[b] == patch[n]:
                continue
            gap = 0.0
            for d in range(3):
                low, high = boxes[b, 0, d], boxes[b, 1, d]
                gap = max(gap, low - p_world[n, d], p_world[n, d] - high)
            if gap <= reach:
                workspace.candidates[count] = n
                count += 1
                break
    return count


@compiled
def write_boxes(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    workspace: NeighbourWorkspace,
) -> int:
    """Write the box around the nodes of each patch; return the number of boxes."""
    boxes, patches = workspace.boxes, workspace.patches
    count, b = 0, 0
    for n in range(len(patch)):
        if count == 0 or patches[b] != patch[n]:  # not in the box of the previous node
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
def insert_neighbour(
    node: int,
    length: float,
    rank: Int[np.ndarray, "node"],
    lengths: Float[np.ndarray, "k"],
    target: int,
    out: Int[np.ndarray, "node k"],
) -> None:
    """Insert a node among the nearest of node `target` if it is one of them."""
    last = out.shape[1] - 1
    k = last + 1
    while k > 0 and is_nearer(node, length, out[target, k - 1], lengths[k - 1], rank):
        k -= 1
    for other in range(last, k, -1):
        out[target, other], lengths[other] = out[target, other - 1], lengths[other - 1]
    if k <= last:
        out[target, k], lengths[k] = node, length


@compiled
def is_nearer(
    one: int,
    length: float,
    other: int,
    other_length: float,
    rank: Int[np.ndarray, "node"],
) -> bool:
    """Return whether one node is nearer than another, or as near and lower in rank."""
    if other == NO_NODE or length != other_length:
        return length < other_length
    return rank[one] < rank[other]
