"""What the compiled building of graphs reads and writes, as plain arrays."""

from typing import NamedTuple

import numpy as np

from eskin.graph.batch import HISTORY
from eskin.graph.config import GraphConfig
from eskin.graph.neighbour_kernels import Search
from eskin.graph.neighbours import FixedNeighbours, search_memory
from eskin.skin import MountedSkin

CM2_PER_M2 = 1e4
NEVER = -2  # earlier than the reading before the first
MANY = 256  # nodes that there is memory for at first


class Ground(NamedTuple):
    """What never changes of a skin on its robot."""

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
    """(taxel)"""
    rank: np.ndarray
    """(taxel) breaks ties"""
    table: np.ndarray
    """(taxel, fixed) fixed neighbours, or -1"""
    reach: float
    """Farthest neighbour of another patch [m]."""
    live: int
    """Neighbours of other patches at most."""


class Loads(NamedTuple):
    """What each taxel felt when it was last active; a *reading* is its number.

    What has not been active since the reading before feels nothing: nothing is ever
    cleared, so a reading costs what is active in it.
    """

    reading: np.ndarray
    """(taxel) the latest one in which it was active"""
    onset: np.ndarray
    """(taxel) since when it has been active [ns since the epoch]"""
    pressure: np.ndarray
    """(taxel) at that reading [kPa]"""
    before: np.ndarray
    """(taxel) one reading earlier [kPa]"""
    shear: np.ndarray
    """(taxel, 2) at that reading, along its tangents [kPa]"""
    shear_before: np.ndarray
    """(taxel, 2) one reading earlier [kPa]"""


class Instant(NamedTuple):
    """Which reading it is."""

    reading: int
    """Its number."""
    stamp: int
    """When it was taken [ns since the epoch]."""
    seconds: float
    """Time since the one before, kept within bounds [s]."""
    follows: bool
    """Whether the one before is recent enough to tell a rate."""


class GraphMemory(NamedTuple):
    """Where a graph is built; whatever it held before, the same graph comes out.

    The first arrays are those of `eskin.graph.GraphBatch`.
    """

    taxels: np.ndarray
    """(node)"""
    pressure: np.ndarray
    """(node) [kPa]"""
    before: np.ndarray
    """(node) [kPa]"""
    age: np.ndarray
    """(node) [s]"""
    areas: np.ndarray
    """(node) [cm2]"""
    positions: np.ndarray
    """(node, 3) [cm]"""
    normals: np.ndarray
    """(node, 3)"""
    shear: np.ndarray
    """(node, 3) [kPa]"""
    shear_before: np.ndarray
    """(node, 3) [kPa]"""
    neighbours: np.ndarray
    """(node, fixed and live)"""
    history: np.ndarray
    """(column)"""
    p_world: np.ndarray
    """(node, 3) [m]"""
    middle: np.ndarray
    """(3) sum of those [m]"""
    patch: np.ndarray
    """(node)"""
    rank: np.ndarray
    """(node) breaks ties"""
    search: Search
    """For the neighbours of other patches."""
    node: np.ndarray
    """(taxel) its node, where that node is of this taxel"""
    marks: np.ndarray
    """(taxel / 64) a bit a taxel; all zero between graphs"""


def ground_of(mounted: MountedSkin, config: GraphConfig) -> Ground:
    """Find the fixed neighbours of a skin, and lay out what graphs are made from."""
    skin, fixed = mounted.skin, FixedNeighbours(mounted.skin, config.fixed)
    x, z = skin.tangents, skin.normals
    return Ground(
        positions=real(skin.positions),
        normals=real(skin.normals),
        tangents=real(np.stack([x, np.cross(z, x)])),
        areas=(skin.areas * CM2_PER_M2).astype(np.float32),
        links=whole(mounted.taxel_link_index),
        patch=whole(skin.patch_index),
        rank=whole(fixed.rank),
        table=fixed.table,
        reach=config.live_reach,
        live=config.live,
    )


def loads_of(taxels: int) -> Loads:
    """Nothing felt on so many taxels."""
    return Loads(
        reading=np.full(taxels, NEVER),
        onset=np.zeros(taxels, np.int64),
        pressure=np.zeros(taxels),
        before=np.zeros(taxels),
        shear=np.zeros((taxels, 2)),
        shear_before=np.zeros((taxels, 2)),
    )


def graph_memory(nodes: int, ground: Ground) -> GraphMemory:
    """Memory for graphs of so many nodes of a skin."""

    def floats(*shape: int) -> np.ndarray:
        return np.zeros((nodes, *shape), np.float32)

    taxels, fixed = ground.table.shape
    return GraphMemory(
        taxels=np.zeros(nodes, np.int64),
        pressure=floats(),
        before=floats(),
        age=floats(),
        areas=floats(),
        positions=floats(3),
        normals=floats(3),
        shear=floats(3),
        shear_before=floats(3),
        neighbours=np.zeros((nodes, fixed + ground.live), np.int32),
        history=np.zeros(len(HISTORY), np.float32),
        p_world=np.zeros((nodes, 3)),
        middle=np.zeros(3),
        patch=np.zeros(nodes, np.int64),
        rank=np.zeros(nodes, np.int64),
        search=search_memory(nodes, ground.live),
        node=np.zeros(taxels, np.int64),
        marks=np.zeros(taxels // 64 + 1, np.uint64),
    )


def real(values: np.ndarray) -> np.ndarray:
    """As the kernels take them."""
    return np.ascontiguousarray(values, np.float64)


def whole(values: np.ndarray) -> np.ndarray:
    """As the kernels take them."""
    return np.ascontiguousarray(values, np.int64)
