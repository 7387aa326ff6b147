"""Compiled kernels that build contact graphs, each in time proportional to its size.

They find the nearest nodes of other patches, too.
"""

# pyright: reportAttributeAccessIssue=false
# Fields of records and of packed tuples are known to numba only.

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.live.graph import GraphBatch

CM_PER_M = 100.0
ZERO = np.float32(0.0)
WORD = 64  # bits
# A single bit times this de Bruijn number has another top six bits for each position.
DE_BRUIJN = np.uint64(0x03F79D71B4CB0A89)
TOP_SIX = np.uint64(58)  # bits to shift by
BIT_POSITION = np.zeros(WORD, np.int64)
for place in range(WORD):
    BIT_POSITION[((int(DE_BRUIJN) << place) & (2**WORD - 1)) >> 58] = place
ONE = np.uint64(1)
NO_BITS = np.uint64(0)
MICROMETRES = 1e6
NO_NODE = -1
S_PER_NS = 1e-9

Taxels = Int[np.ndarray, "taxel"]
Points = Float[np.ndarray, "point 3"]
Nodes = Int[np.ndarray, "node"]


class SkinGeometry(NamedTuple):
    """A geometry holds what never changes of a skin, in the frames of its links."""

    positions: Float[np.ndarray, "taxel 3"]  # [m]
    normals: Float[np.ndarray, "taxel 3"]
    tangents: Float[np.ndarray, "2 taxel 3"]  # x, then y
    areas: Float[np.ndarray, "taxel"]  # [cm2], float32
    links: Int[np.ndarray, "taxel"]  # index of the link of the robot
    patch: Int[np.ndarray, "taxel"]  # index of the patch
    rank: Int[np.ndarray, "taxel"]  # breaks ties of distance
    fixed_neighbours: Int[np.ndarray, "taxel k"]  # nearest of the same patch, or -1
    reach: float  # largest distance to a neighbour of another patch [m]
    live: int  # largest number of neighbours of other patches


class TaxelHistory(NamedTuple):
    """A history holds the loads that each taxel measured when it was last active.

    A taxel that has not been active since the previous graph has no load. Nothing is
    ever cleared, so a reading costs only what is active in it.
    """

    reading: Int[np.ndarray, "taxel"]  # number of the latest reading where it is active
    onset: Int[np.ndarray, "taxel"]  # when it became active [ns since the epoch]
    pressure: Float[np.ndarray, "taxel"]  # at that reading [kPa]
    before: Float[np.ndarray, "taxel"]  # one graph earlier [kPa]
    shear: Float[np.ndarray, "taxel 2"]  # at that reading, along its tangents [kPa]
    shear_before: Float[np.ndarray, "taxel 2"]  # one graph earlier [kPa]


class KernelStep(NamedTuple):
    """A step holds what graphs take from one reading."""

    reading: int  # number of the reading
    stamp: int  # [ns since the epoch]
    seconds: float  # time since the previous graph, clipped to a range [s]
    has_previous: bool  # whether the previous graph is recent enough for a rate
    pressure: Float[np.ndarray, "taxel"]  # [kPa]
    shear: Float[np.ndarray, "taxel 2"]  # [kPa]; empty if it is not measured
    T_world_link: Float[np.ndarray, "link 4 4"]  # pose of every link of the robot


class NeighbourWorkspace(NamedTuple):
    """A workspace is the memory of a search for neighbours of other patches."""

    boxes: Float[np.ndarray, "box 2 3"]  # least and greatest coordinates of a patch [m]
    patches: Int[np.ndarray, "box"]  # patch of each box
    candidates: Int[np.ndarray, "node"]  # nodes near other patches
    lengths: Float[np.ndarray, "neighbour"]  # distances of the nearest so far [um]


class GraphWorkspace(NamedTuple):
    """A workspace is memory in which one graph is built, whatever it held before."""

    graph: GraphBatch  # a batch of one
    p_world: Float[np.ndarray, "node 3"]  # positions in the world [m]
    position_sum: Float[np.ndarray, "3"]  # sum of those [m]
    patch: Int[np.ndarray, "node"]  # index of the patch
    rank: Int[np.ndarray, "node"]  # breaks ties of distance
    search: NeighbourWorkspace
    taxel_node: Int[np.ndarray, "taxel"]  # valid only if that node is of this taxel
    marks: Int[np.ndarray, "word"]  # one bit per taxel, all zero between graphs


@compiled
def update_taxel_history(
    active: Taxels, step: KernelStep, history: TaxelHistory
) -> None:
    """Store the loads of the active taxels, of which some may occur more than once."""
    for taxel in active:
        if history.reading[taxel] == step.reading:
            continue
        if history.reading[taxel] == step.reading - 1:
            history.before[taxel] = history.pressure[taxel]
            history.shear_before[taxel, 0] = history.shear[taxel, 0]
            history.shear_before[taxel, 1] = history.shear[taxel, 1]
        else:
            history.onset[taxel] = step.stamp
            history.before[taxel] = 0.0
            history.shear_before[taxel, 0] = 0.0
            history.shear_before[taxel, 1] = 0.0
        history.reading[taxel] = step.reading
        history.pressure[taxel] = step.pressure[taxel]
        for d in range(2):
            shear = step.shear[taxel, d] if len(step.shear) > 0 else 0.0
            history.shear[taxel, d] = shear


@compiled
def build_graph(
    taxels: Taxels,
    earlier: Taxels,
    touch_history: Float[np.ndarray, "column"],
    step: KernelStep,
    geometry: SkinGeometry,
    history: TaxelHistory,
    workspace: GraphWorkspace,
) -> int:
    """Build the graph of one touch, and return its number of nodes.

    Its taxels are active now or `earlier`, in the previous graph; `touch_history` has
    the columns `eskin.live.HISTORY`, `history` includes this reading, and `workspace`
    has room for the taxels and all their fixed neighbours.
    """
    graph = workspace.graph
    fixed = geometry.fixed_neighbours.shape[1]
    nodes = find_support(taxels, earlier, geometry, workspace)
    write_geometry(nodes, step, geometry, workspace)
    write_loads(nodes, taxels, earlier, step, geometry, history, workspace)
    write_fixed_neighbours(nodes, geometry, workspace)
    write_live_neighbours(
        workspace.p_world[:nodes],
        workspace.patch[:nodes],
        workspace.rank[:nodes],
        geometry.reach,
        workspace.search,
        graph.neighbours[:nodes, fixed:],
    )
    graph.offsets[0] = 0
    graph.offsets[1] = nodes
    graph.seconds[0] = step.seconds
    for column in range(len(touch_history)):
        graph.history[0, column] = touch_history[column]
    return nodes


@compiled
def find_support(
    taxels: Taxels, earlier: Taxels, geometry: SkinGeometry, workspace: GraphWorkspace
) -> int:
    """Find the nodes of a graph: taxels active now or before and fixed neighbours.

    Write the taxel of each node and the node of each of those taxels; return the number
    of nodes. Nodes are in the order of their taxels.
    """
    table = geometry.fixed_neighbours
    marks = workspace.marks
    node_taxel = workspace.graph.taxels
    taxel_node = workspace.taxel_node
    first, last = len(marks), -1
    for active in (taxels, earlier):
        for taxel in active:
            word = taxel // WORD
            marks[word] |= ONE << np.uint64(taxel % WORD)
            first, last = min(first, word), max(last, word)
            for k in range(table.shape[1]):
                neighbour = table[taxel, k]
                if neighbour != NO_NODE:
                    word = neighbour // WORD
                    marks[word] |= ONE << np.uint64(neighbour % WORD)
                    first, last = min(first, word), max(last, word)
    count = 0
    for word in range(first, last + 1):
        bits = marks[word]
        marks[word] = NO_BITS
        while bits != NO_BITS:
            others = bits & (bits - ONE)
            lowest = bits ^ others
            taxel = WORD * word + BIT_POSITION[(lowest * DE_BRUIJN) >> TOP_SIX]
            node_taxel[count] = taxel
            taxel_node[taxel] = count
            count += 1
            bits = others
    return count


@compiled
def write_fixed_neighbours(
    nodes: int, geometry: SkinGeometry, workspace: GraphWorkspace
) -> None:
    """Write the fixed neighbours that are in the graph, as nodes, or -1."""
    table = geometry.fixed_neighbours
    taxel_node = workspace.taxel_node
    node_taxel = workspace.graph.taxels
    out = workspace.graph.neighbours
    for n in range(nodes):
        for k in range(table.shape[1]):
            neighbour = table[node_taxel[n], k]
            out[n, k] = NO_NODE
            if neighbour != NO_NODE:
                m = taxel_node[neighbour]
                if m < nodes and node_taxel[m] == neighbour:
                    out[n, k] = m


@compiled
def write_geometry(
    nodes: int, step: KernelStep, geometry: SkinGeometry, workspace: GraphWorkspace
) -> None:
    """Write position, normal, area, patch and rank of the nodes."""
    # Local references to the arrays make the compiled loops faster.
    graph = workspace.graph
    T_world_link = step.T_world_link
    p_world = workspace.p_world
    node_taxel = graph.taxels
    positions = graph.positions
    normals = graph.normals
    areas = graph.areas
    p_link = geometry.positions
    n_link = geometry.normals
    taxel_areas = geometry.areas
    sums = workspace.position_sum
    patch = workspace.patch
    rank = workspace.rank
    sums[0] = sums[1] = sums[2] = 0.0
    for n in range(nodes):
        taxel = node_taxel[n]
        link = geometry.links[taxel]
        for d in range(3):
            p_world[n, d] = T_world_link[link, d, 3] + rotate_axis(
                d, link, T_world_link, taxel, p_link
            )
            normals[n, d] = rotate_axis(d, link, T_world_link, taxel, n_link)
            sums[d] += p_world[n, d]
        areas[n] = taxel_areas[taxel]
        patch[n] = geometry.patch[taxel]
        rank[n] = geometry.rank[taxel]
    for n in range(nodes):
        for d in range(3):
            positions[n, d] = (p_world[n, d] - sums[d] / nodes) * CM_PER_M


@compiled
def write_loads(
    nodes: int,
    taxels: Taxels,
    earlier: Taxels,
    step: KernelStep,
    geometry: SkinGeometry,
    history: TaxelHistory,
    workspace: GraphWorkspace,
) -> None:
    """Write the loads of the touch's own nodes, now and one graph ago.

    Loads of taxels that belong to other touches are zero.
    """
    graph = workspace.graph
    node = workspace.taxel_node
    pressure = graph.pressure
    before = graph.before
    age = graph.age
    shear = graph.shear
    shear_before = graph.shear_before
    for n in range(nodes):
        pressure[n] = before[n] = age[n] = ZERO
        for d in range(3):
            shear[n, d] = shear_before[n, d] = ZERO
    for taxel in taxels:
        n = node[taxel]
        pressure[n] = history.pressure[taxel]
        age[n] = (step.stamp - history.onset[taxel]) * S_PER_NS
        write_shear(taxel, history.shear, step, geometry, n, shear)
    if not step.has_previous:
        return
    for taxel in earlier:
        n = node[taxel]
        if history.reading[taxel] == step.reading:
            before[n] = history.before[taxel]
            write_shear(taxel, history.shear_before, step, geometry, n, shear_before)
        elif history.reading[taxel] == step.reading - 1:
            before[n] = history.pressure[taxel]
            write_shear(taxel, history.shear, step, geometry, n, shear_before)


@compiled
def write_shear(
    taxel: int,
    shear: Float[np.ndarray, "taxel 2"],
    step: KernelStep,
    geometry: SkinGeometry,
    n: int,
    out: Points,
) -> None:
    """Write a taxel's shear in the world [kPa] to row `n`, unless it is zero."""
    if shear[taxel, 0] == 0.0 and shear[taxel, 1] == 0.0:
        return
    link = geometry.links[taxel]
    tangents = geometry.tangents
    for d in range(3):
        x = rotate_axis(d, link, step.T_world_link, taxel, tangents[0])
        y = rotate_axis(d, link, step.T_world_link, taxel, tangents[1])
        out[n, d] = x * shear[taxel, 0] + y * shear[taxel, 1]


@compiled
def rotate_axis(
    d: int,
    link: int,
    T_world_link: Float[np.ndarray, "link 4 4"],
    taxel: int,
    vectors: Points,
) -> float:
    """Return coordinate `d` in the world of a vector given in the link frame."""
    return (
        T_world_link[link, d, 0] * vectors[taxel, 0]
        + T_world_link[link, d, 1] * vectors[taxel, 1]
        + T_world_link[link, d, 2] * vectors[taxel, 2]
    )


@compiled
def write_live_neighbours(
    p_world: Points,
    patch: Nodes,
    rank: Nodes,
    reach: float,
    workspace: NeighbourWorkspace,
    out: Int[np.ndarray, "node k"],
) -> None:
    """Write the neighbours of each node; see `find_live_neighbours` for arguments."""
    for n in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[n, k] = NO_NODE
    max_length = np.rint(reach * MICROMETRES)
    search_radius = (max_length + 1.0) / MICROMETRES
    count = find_candidates(p_world, patch, search_radius, workspace)
    candidates = workspace.candidates
    lengths = workspace.lengths
    last = out.shape[1] - 1
    if last < 0:
        return
    for a in range(count):
        n = candidates[a]
        for k in range(len(lengths)):
            lengths[k] = np.inf
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
    p_world: Points, patch: Nodes, reach: float, workspace: NeighbourWorkspace
) -> int:
    """List the nodes within reach of the box around another patch; return their number.

    Only these, few of all nodes, are compared with each other.
    """
    box_count = write_boxes(p_world, patch, workspace)
    count = 0
    boxes = workspace.boxes
    patches = workspace.patches
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
def write_boxes(p_world: Points, patch: Nodes, workspace: NeighbourWorkspace) -> int:
    """Write the box around the nodes of each patch; return the number of boxes."""
    boxes = workspace.boxes
    patches = workspace.patches
    count = 0
    b = 0
    for n in range(len(patch)):
        if count == 0 or patches[b] != patch[n]:  # not in the box of the previous node
            b = 0
            while b < count and patches[b] != patch[n]:
                b += 1
        if b == count:
            patches[b] = patch[n]
            for d in range(3):
                boxes[b, 0, d] = p_world[n, d]
                boxes[b, 1, d] = p_world[n, d]
            count += 1
        for d in range(3):
            boxes[b, 0, d] = min(boxes[b, 0, d], p_world[n, d])
            boxes[b, 1, d] = max(boxes[b, 1, d], p_world[n, d])
    return count


@compiled
def insert_neighbour(
    node: int,
    length: float,
    rank: Nodes,
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
        out[target, other] = out[target, other - 1]
        lengths[other] = lengths[other - 1]
    if k <= last:
        out[target, k] = node
        lengths[k] = length


@compiled
def is_nearer(
    one: int, length: float, other: int, other_length: float, rank: Nodes
) -> bool:
    """Return whether one node is nearer than another, or as near and lower in rank."""
    if other == NO_NODE or length != other_length:
        return length < other_length
    return rank[one] < rank[other]
