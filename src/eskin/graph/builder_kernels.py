"""The compiled building of one graph: its cost follows what is active.

`no_type_check` keeps the tests' hooks off compiled code.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.graph.arrays import GraphMemory, Ground, Instant, Loads
from eskin.graph.neighbour_kernels import NOBODY, find_nearest

CM_PER_M = 100.0
ZERO = np.float32(0.0)
WORD = 64  # bits
# Multiplying a single bit by this brings another six bits to the top for each place.
DE_BRUIJN = np.uint64(0x03F79D71B4CB0A89)
TOP = np.uint64(58)
LOWEST = np.zeros(WORD, np.int64)
for place in range(WORD):
    LOWEST[((int(DE_BRUIJN) << place) & (2**WORD - 1)) >> 58] = place
ONE, NONE = np.uint64(1), np.uint64(0)


@compiled
@no_type_check
def take_in(
    active: Int[np.ndarray, "active"],
    pressure: Float[np.ndarray, "taxel"],
    shear: Float[np.ndarray, "taxel 2"],
    instant: Instant,
    loads: Loads,
) -> None:
    """Remember what the active taxels feel at the next reading.

    Args:
        active: taxels, some perhaps more than once.
        pressure: of every taxel [kPa].
        shear: of every taxel [kPa]; empty where it is not measured.
        instant: of the reading.
        loads: what was felt before.
    """
    for taxel in active:
        if loads.reading[taxel] == instant.reading:
            continue
        if loads.reading[taxel] == instant.reading - 1:
            loads.before[taxel] = loads.pressure[taxel]
            loads.shear_before[taxel, 0] = loads.shear[taxel, 0]
            loads.shear_before[taxel, 1] = loads.shear[taxel, 1]
        else:
            loads.onset[taxel] = instant.stamp
            loads.before[taxel] = 0.0
            loads.shear_before[taxel, 0] = 0.0
            loads.shear_before[taxel, 1] = 0.0
        loads.reading[taxel] = instant.reading
        loads.pressure[taxel] = pressure[taxel]
        for d in range(2):
            loads.shear[taxel, d] = shear[taxel, d] if len(shear) > 0 else 0.0


@compiled
@no_type_check
def build_graph(
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    history: Float[np.ndarray, "column"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    instant: Instant,
    ground: Ground,
    loads: Loads,
    memory: GraphMemory,
) -> int:
    """Build the graph of one touch, and return how many nodes it has.

    Args:
        taxels: active taxels of the touch now.
        earlier: active taxels of the same touch at the reading before.
        history: what the touch has been so far.
        T_world_link: of every link of the robot.
        instant: of the reading.
        ground: the skin.
        loads: what has been felt, this reading taken in.
        memory: with room for the taxels and all their fixed neighbours.
    """
    nodes = find_support(
        taxels, earlier, ground.table, memory.marks, memory.taxels, memory.node
    )
    place_nodes(nodes, T_world_link, ground, memory)
    load_nodes(nodes, taxels, earlier, T_world_link, instant, ground, loads, memory)
    fixed = ground.table.shape[1]
    place_fixed(
        memory.taxels[:nodes], ground.table, memory.node, memory.neighbours[:, :fixed]
    )
    find_nearest(
        memory.p_world[:nodes],
        memory.patch[:nodes],
        memory.rank[:nodes],
        ground.reach,
        memory.search,
        memory.neighbours[:nodes, fixed:],
    )
    for column in range(len(history)):
        memory.history[column] = history[column]
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
    """Number taxels active now or before and their fixed neighbours, ascending.

    Args:
        taxels: active now.
        earlier: active one reading ago.
        table: fixed neighbours of each taxel, or -1.
        marks: a bit a taxel, all zero before and after.
        nodes: where the taxel of each node goes.
        node: where the node of each of those taxels goes.
    """
    first, last = len(marks), -1
    for those in (taxels, earlier):
        for taxel in those:
            word = taxel // WORD
            marks[word] |= ONE << np.uint64(taxel % WORD)
            first, last = min(first, word), max(last, word)
            for k in range(table.shape[1]):
                neighbour = table[taxel, k]
                if neighbour != NOBODY:
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
def place_fixed(
    nodes: Int[np.ndarray, "node"],
    table: Int[np.ndarray, "taxel k"],
    node: Int[np.ndarray, "taxel"],
    out: Int[np.ndarray, "row k"],
) -> None:
    """Write the fixed neighbours inside the support, as nodes, or -1.

    Args:
        nodes: the taxel of each node.
        table: fixed neighbours of each taxel, or -1.
        node: of the taxels that are in the graph; anything where they are not.
        out: where they go.
    """
    count = len(nodes)
    for n in range(count):
        taxel = nodes[n]
        for k in range(table.shape[1]):
            neighbour = table[taxel, k]
            out[n, k] = NOBODY
            if neighbour != NOBODY:
                m = node[neighbour]
                if m < count and nodes[m] == neighbour:
                    out[n, k] = m


@compiled
@no_type_check
def place_nodes(
    nodes: int,
    T_world_link: Float[np.ndarray, "link 4 4"],
    ground: Ground,
    memory: GraphMemory,
) -> None:
    """Write where the nodes are, which way they face and how large they are."""
    p_world, members, links = memory.p_world, memory.taxels, ground.links
    positions, normals, areas = memory.positions, memory.normals, memory.areas
    p_link, n_link, areas_of = ground.positions, ground.normals, ground.areas
    middle = memory.middle
    middle[:] = 0.0
    for n in range(nodes):
        taxel = members[n]
        link = links[taxel]
        for d in range(3):
            p_world[n, d] = T_world_link[link, d, 3] + turned(
                d, link, T_world_link, taxel, p_link
            )
            normals[n, d] = turned(d, link, T_world_link, taxel, n_link)
            middle[d] += p_world[n, d]
        areas[n] = areas_of[taxel]
    for n in range(nodes):
        for d in range(3):
            positions[n, d] = (p_world[n, d] - middle[d] / nodes) * CM_PER_M
    patch, rank = memory.patch, memory.rank
    for n in range(nodes):
        patch[n], rank[n] = ground.patch[members[n]], ground.rank[members[n]]


@compiled
@no_type_check
def load_nodes(
    nodes: int,
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    instant: Instant,
    ground: Ground,
    loads: Loads,
    memory: GraphMemory,
) -> None:
    """Write what a touch's own nodes feel and felt a reading ago.

    What other touches press is not theirs: zero.
    """
    node, links, tangents = memory.node, ground.links, ground.tangents
    pressure, before, age = memory.pressure, memory.before, memory.age
    shear, shear_before = memory.shear, memory.shear_before
    pressure[:nodes], before[:nodes], age[:nodes] = ZERO, ZERO, ZERO
    shear[:nodes], shear_before[:nodes] = ZERO, ZERO
    for taxel in taxels:
        n = node[taxel]
        pressure[n] = loads.pressure[taxel]
        age[n] = (instant.stamp - loads.onset[taxel]) * 1e-9
        drag(taxel, links, T_world_link, tangents, loads.shear, n, shear)
    if not instant.follows:
        return
    for taxel in earlier:
        n = node[taxel]
        if loads.reading[taxel] == instant.reading:
            before[n] = loads.before[taxel]
            felt = loads.shear_before
        elif loads.reading[taxel] == instant.reading - 1:
            before[n] = loads.pressure[taxel]
            felt = loads.shear
        else:
            continue
        drag(taxel, links, T_world_link, tangents, felt, n, shear_before)


@compiled
@no_type_check
def drag(
    taxel: int,
    links: Int[np.ndarray, "taxel"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    tangents: Float[np.ndarray, "2 taxel 3"],
    shear: Float[np.ndarray, "taxel 2"],
    n: int,
    out: Float[np.ndarray, "node 3"],
) -> None:
    """Write a taxel's shear in the directions of the world [kPa], if it has any."""
    if shear[taxel, 0] == 0.0 and shear[taxel, 1] == 0.0:
        return
    link = links[taxel]
    for d in range(3):
        x = turned(d, link, T_world_link, taxel, tangents[0])
        y = turned(d, link, T_world_link, taxel, tangents[1])
        out[n, d] = x * shear[taxel, 0] + y * shear[taxel, 1]


@compiled
@no_type_check
def turned(
    d: int,
    link: int,
    T_world_link: Float[np.ndarray, "link 4 4"],
    taxel: int,
    vectors: Float[np.ndarray, "taxel 3"],
) -> float:
    """One coordinate in the world of a direction that is given in a link."""
    return (
        T_world_link[link, d, 0] * vectors[taxel, 0]
        + T_world_link[link, d, 1] * vectors[taxel, 1]
        + T_world_link[link, d, 2] * vectors[taxel, 2]
    )
