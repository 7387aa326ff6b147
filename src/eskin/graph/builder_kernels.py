"""Compiled kernels that build one contact graph, at a cost that follows the contact.

`no_type_check` keeps the tests' type checks off compiled code.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.graph.neighbour_kernels import NO_NODE, NeighbourWorkspace, find_nearest

CM_PER_M = 100.0
ZERO = np.float32(0.0)
WORD = 64  # bits
# Multiplying a single bit by this brings another six bits to the top for each position.
DE_BRUIJN = np.uint64(0x03F79D71B4CB0A89)
TOP = np.uint64(58)
LOWEST = np.zeros(WORD, np.int64)
for place in range(WORD):
    LOWEST[((int(DE_BRUIJN) << place) & (2**WORD - 1)) >> 58] = place
ONE, NONE = np.uint64(1), np.uint64(0)


class SkinGeometry(NamedTuple):
    """A geometry holds the properties of a skin on its robot that never change."""

    positions: np.ndarray
    """(taxel, 3) in the frame of its link [m]"""
    normals: np.ndarray
    """(taxel, 3) in the frame of its link"""
    tangents: np.ndarray
    """(2, taxel, 3) tangents x and y in the frame of its link"""
    areas: np.ndarray
    """(taxel) float32 [cm2]"""
    links: np.ndarray
    """(taxel) as indices into the robot's links"""
    patch: np.ndarray
    """(taxel) index of its patch"""
    rank: np.ndarray
    """(taxel) order that breaks ties of distance"""
    fixed_neighbours: np.ndarray
    """(taxel, fixed) nearest taxels of the same patch, or -1"""
    reach: float
    """Largest distance to a neighbour of another patch [m]."""
    live: int
    """Largest number of neighbours of other patches."""


class TaxelHistory(NamedTuple):
    """A history holds the loads that each taxel measured when it was last active.

    A taxel that has not been active since the previous reading has no load. Nothing is
    ever cleared, so a reading costs only what is active in it.
    """

    reading: np.ndarray
    """(taxel) number of the latest reading in which it was active"""
    onset: np.ndarray
    """(taxel) when it became active [ns since the epoch]"""
    pressure: np.ndarray
    """(taxel) at that reading [kPa]"""
    before: np.ndarray
    """(taxel) one reading earlier [kPa]"""
    shear: np.ndarray
    """(taxel, 2) at that reading, along its tangents [kPa]"""
    shear_before: np.ndarray
    """(taxel, 2) one reading earlier [kPa]"""


class TimeStep(NamedTuple):
    """A time step tells the number and time of one reading."""

    reading: int
    """Number of the reading."""
    stamp: int
    """Time of the reading [ns since the epoch]."""
    seconds: float
    """Time since the previous reading, clipped to a range [s]."""
    has_previous: bool
    """Whether the previous reading is recent enough for a rate."""


class GraphArrays(NamedTuple):
    """These are the fields of `eskin.graph.GraphBatch` for compiled code, in its order.

    Arrays of nodes may be longer than the last offset; kernels ignore the rest.
    """

    taxels: np.ndarray
    pressure: np.ndarray
    before: np.ndarray
    age: np.ndarray
    areas: np.ndarray
    positions: np.ndarray
    normals: np.ndarray
    shear: np.ndarray
    shear_before: np.ndarray
    neighbours: np.ndarray
    offsets: np.ndarray
    seconds: np.ndarray
    history: np.ndarray


class GraphWorkspace(NamedTuple):
    """A workspace is memory in which one graph is built, whatever it held before."""

    graph: GraphArrays
    """The graph, a batch of one."""
    p_world: np.ndarray
    """(node, 3) positions in the world [m]"""
    middle: np.ndarray
    """(3) sum of those [m]"""
    patch: np.ndarray
    """(node) index of the patch"""
    rank: np.ndarray
    """(node) order that breaks ties of distance"""
    search: NeighbourWorkspace
    """Memory for the search for neighbours of other patches."""
    node: np.ndarray
    """(taxel) its node; valid only if that node is of this taxel"""
    marks: np.ndarray
    """(taxel / 64) one bit per taxel; all zero between graphs"""


@compiled
@no_type_check
def update_taxel_history(
    active: Int[np.ndarray, "active"],
    pressure: Float[np.ndarray, "taxel"],
    shear: Float[np.ndarray, "taxel 2"],
    time_step: TimeStep,
    history: TaxelHistory,
) -> None:
    """Store the loads of the active taxels at the next reading.

    Args:
        active: taxels; some may occur more than once.
        pressure: pressure of every taxel [kPa].
        shear: shear of every taxel [kPa]; empty if it is not measured.
        time_step: number and time of the reading.
        history: loads of the readings before, updated in place.
    """
    for taxel in active:
        if history.reading[taxel] == time_step.reading:
            continue
        if history.reading[taxel] == time_step.reading - 1:
            history.before[taxel] = history.pressure[taxel]
            history.shear_before[taxel, 0] = history.shear[taxel, 0]
            history.shear_before[taxel, 1] = history.shear[taxel, 1]
        else:
            history.onset[taxel] = time_step.stamp
            history.before[taxel] = 0.0
            history.shear_before[taxel, 0] = 0.0
            history.shear_before[taxel, 1] = 0.0
        history.reading[taxel] = time_step.reading
        history.pressure[taxel] = pressure[taxel]
        for d in range(2):
            history.shear[taxel, d] = shear[taxel, d] if len(shear) > 0 else 0.0


@compiled
@no_type_check
def build_graph(
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    touch_history: Float[np.ndarray, "column"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    time_step: TimeStep,
    geometry: SkinGeometry,
    history: TaxelHistory,
    workspace: GraphWorkspace,
) -> int:
    """Build the graph of one touch, and return its number of nodes.

    Args:
        taxels: active taxels of the touch now.
        earlier: active taxels of the same touch at the previous reading.
        touch_history: columns of `eskin.graph.HISTORY`.
        T_world_link: pose of every link of the robot.
        time_step: number and time of the reading.
        geometry: the skin.
        history: loads of the taxels, this reading included.
        workspace: memory with room for the taxels and all their fixed neighbours.
    """
    graph, table = workspace.graph, geometry.fixed_neighbours
    nodes = find_support(
        taxels, earlier, table, workspace.marks, graph.taxels, workspace.node
    )
    write_geometry(nodes, T_world_link, geometry, workspace)
    write_loads(
        nodes, taxels, earlier, T_world_link, time_step, geometry, history, workspace
    )
    fixed = table.shape[1]
    write_fixed_neighbours(
        graph.taxels[:nodes], table, workspace.node, graph.neighbours[:, :fixed]
    )
    find_nearest(
        workspace.p_world[:nodes],
        workspace.patch[:nodes],
        workspace.rank[:nodes],
        geometry.reach,
        workspace.search,
        graph.neighbours[:nodes, fixed:],
    )
    graph.offsets[0], graph.offsets[1] = 0, nodes
    graph.seconds[0] = time_step.seconds
    for column in range(len(touch_history)):
        graph.history[0, column] = touch_history[column]
    return nodes


@compiled
@no_type_check
def find_support(
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    table: Int[np.ndarray, "taxel k"],
    marks: Int[np.ndarray, "word"],
    nodes: Int[np.ndarray, "node"],
    node: Int[np.ndarray, "taxel"],
) -> int:
    """Find the nodes of a graph: taxels active now or before and fixed neighbours.

    Args:
        taxels: taxels active now.
        earlier: taxels active one reading ago.
        table: fixed neighbours of each taxel, or -1.
        marks: one bit per taxel, all zero before and after.
        nodes: output, the taxel of each node.
        node: output, the node of each of those taxels.

    Returns:
        The number of nodes.
    """
    first, last = len(marks), -1
    for those in (taxels, earlier):
        for taxel in those:
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
        marks[word] = NONE
        while bits != NONE:
            rest = bits & (bits - ONE)
            taxel = WORD * word + LOWEST[((bits ^ rest) * DE_BRUIJN) >> TOP]
            nodes[count] = taxel
            node[taxel] = count
            count += 1
            bits = rest
    return count


@compiled
@no_type_check
def write_fixed_neighbours(
    nodes: Int[np.ndarray, "node"],
    table: Int[np.ndarray, "taxel k"],
    node: Int[np.ndarray, "taxel"],
    out: Int[np.ndarray, "row k"],
) -> None:
    """Write the fixed neighbours that are in the graph, as nodes, or -1.

    Args:
        nodes: the taxel of each node.
        table: fixed neighbours of each taxel, or -1.
        node: node of each taxel of the graph; arbitrary for other taxels.
        out: output, the neighbours of each node.
    """
    count = len(nodes)
    for n in range(count):
        taxel = nodes[n]
        for k in range(table.shape[1]):
            neighbour = table[taxel, k]
            out[n, k] = NO_NODE
            if neighbour != NO_NODE:
                m = node[neighbour]
                if m < count and nodes[m] == neighbour:
                    out[n, k] = m


@compiled
@no_type_check
def write_geometry(
    nodes: int,
    T_world_link: Float[np.ndarray, "link 4 4"],
    geometry: SkinGeometry,
    workspace: GraphWorkspace,
) -> None:
    """Write position, normal, area, patch and rank of the nodes."""
    graph = workspace.graph
    p_world, members, links = workspace.p_world, graph.taxels, geometry.links
    positions, normals, areas = graph.positions, graph.normals, graph.areas
    p_link, n_link, taxel_areas = geometry.positions, geometry.normals, geometry.areas
    middle = workspace.middle
    middle[:] = 0.0
    for n in range(nodes):
        taxel = members[n]
        link = links[taxel]
        for d in range(3):
            p_world[n, d] = T_world_link[link, d, 3] + rotate_axis(
                d, link, T_world_link, taxel, p_link
            )
            normals[n, d] = rotate_axis(d, link, T_world_link, taxel, n_link)
            middle[d] += p_world[n, d]
        areas[n] = taxel_areas[taxel]
    for n in range(nodes):
        for d in range(3):
            positions[n, d] = (p_world[n, d] - middle[d] / nodes) * CM_PER_M
    patch, rank = workspace.patch, workspace.rank
    for n in range(nodes):
        patch[n], rank[n] = geometry.patch[members[n]], geometry.rank[members[n]]


@compiled
@no_type_check
def write_loads(
    nodes: int,
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    time_step: TimeStep,
    geometry: SkinGeometry,
    history: TaxelHistory,
    workspace: GraphWorkspace,
) -> None:
    """Write the loads of the touch's own nodes, now and one reading ago.

    Loads of taxels that belong to other touches are zero.
    """
    graph = workspace.graph
    node, links, tangents = workspace.node, geometry.links, geometry.tangents
    pressure, before, age = graph.pressure, graph.before, graph.age
    shear, shear_before = graph.shear, graph.shear_before
    pressure[:nodes], before[:nodes], age[:nodes] = ZERO, ZERO, ZERO
    shear[:nodes], shear_before[:nodes] = ZERO, ZERO
    for taxel in taxels:
        n = node[taxel]
        pressure[n] = history.pressure[taxel]
        age[n] = (time_step.stamp - history.onset[taxel]) * 1e-9
        write_shear(taxel, links, T_world_link, tangents, history.shear, n, shear)
    if not time_step.has_previous:
        return
    for taxel in earlier:
        n = node[taxel]
        if history.reading[taxel] == time_step.reading:
            before[n] = history.before[taxel]
            previous = history.shear_before
        elif history.reading[taxel] == time_step.reading - 1:
            before[n] = history.pressure[taxel]
            previous = history.shear
        else:
            continue
        write_shear(taxel, links, T_world_link, tangents, previous, n, shear_before)


@compiled
@no_type_check
def write_shear(
    taxel: int,
    links: Int[np.ndarray, "taxel"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    tangents: Float[np.ndarray, "2 taxel 3"],
    shear: Float[np.ndarray, "taxel 2"],
    n: int,
    out: Float[np.ndarray, "node 3"],
) -> None:
    """Write a taxel's shear in the world frame to row `n` [kPa], unless it is zero."""
    if shear[taxel, 0] == 0.0 and shear[taxel, 1] == 0.0:
        return
    link = links[taxel]
    for d in range(3):
        x = rotate_axis(d, link, T_world_link, taxel, tangents[0])
        y = rotate_axis(d, link, T_world_link, taxel, tangents[1])
        out[n, d] = x * shear[taxel, 0] + y * shear[taxel, 1]


@compiled
@no_type_check
def rotate_axis(
    d: int,
    link: int,
    T_world_link: Float[np.ndarray, "link 4 4"],
    taxel: int,
    vectors: Float[np.ndarray, "taxel 3"],
) -> float:
    """Return coordinate `d` in the world of a vector given in the link frame."""
    return (
        T_world_link[link, d, 0] * vectors[taxel, 0]
        + T_world_link[link, d, 1] * vectors[taxel, 1]
        + T_world_link[link, d, 2] * vectors[taxel, 2]
    )
