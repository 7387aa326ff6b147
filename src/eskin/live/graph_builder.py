"""This module builds the contact graphs of touches from readings.

A taxel is joined to the nearest of its own patch, found once, and to the nearest of
other patches, found at every reading. Ties are broken by (patch, row, column), which
travels with the taxel, so neither the order of the taxels nor the pose of the robot
changes the neighbours.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, NamedTuple, final

import numpy as np
from annotated_types import Interval
from jaxtyping import Float, Int

from eskin.files import Distance, NotNegative
from eskin.live.graph import NO_HISTORY, GraphBatch, allocate_graphs
from eskin.live.graph_kernels import (
    CM_PER_M,
    MICROMETRES,
    NO_NODE,
    S_PER_NS,
    GraphWorkspace,
    KernelStep,
    NeighbourWorkspace,
    SkinGeometry,
    TaxelHistory,
    build_graph,
    update_taxel_history,
    write_live_neighbours,
)
from eskin.near import find_nearest
from eskin.skin import MountedSkin, Skin
from eskin.touch import LinkPoseCache, Reading, TouchRecord, TouchState
from eskin.touch.tracking import measure_distance

MAX_STEP = 0.5  # [s] between readings from which a rate is computed
MIN_STEP = 1e-4  # [s]
MAX_REPEAT = 300_000_000
"""Time for which loads that do not change are the same measurement [ns]: a device of 4
Hz or more is read at a higher rate, or its pads are on or off."""
SPACING = 8_000_000
"""Mean time between two graphs of a touch on a fast skin [ns]: the network uses the
latest of each 20 ms, so there are no more of them than on a skin of 125 Hz."""
MAX_AHEAD = 20_000_000
"""Time by which graphs may be ahead of that [ns]: readings can come in pairs."""
LONG_AGO = -1_000_000_000  # [ns] stamp before the first reading, too old for a rate
NO_READING = -2
"""Number of the reading of a taxel that has not been active yet."""
INITIAL_NODES = 256  # that there is memory for
NO_SHEAR = np.zeros((0, 2), np.float32)
CM2_PER_M2 = 1e4
WHOLE_SKIN = 0
"""Key of the one sequence of a skin that is not calibrated; ids of touches start at
1."""

NO_TAXELS = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class GraphConfig:
    """These settings determine how the taxels of a touch become a graph."""

    fixed: Annotated[int, Interval(ge=0, le=64)] = 8
    """Number of nearest taxels of the same patch that each taxel is joined to (K
    of Jiang et al. 2025, Fig. 11)."""
    live: Annotated[int, Interval(ge=0, le=64)] = 4
    """Number of nearest taxels of other patches, searched for at every reading."""
    live_reach: Distance = 0.03
    """Largest distance at which a taxel of another patch is joined [m]."""
    shear_on: NotNegative = 1.5
    """On a skin that is not calibrated: shear from which a taxel belongs to the graph
    even where its pressure is too low for a contact [kPa]."""
    posed: bool = True
    """Whether the robot's pose is used. Without it every joint is taken to be at 0, so
    that the same counts are the same touch in every pose."""

    def without_shear(self) -> "GraphConfig":
        """Return the same settings for graphs to which shear adds no taxel."""
        return replace(self, shear_on=math.inf)

    def restrict(self, shear: bool, neighbours: bool) -> "GraphConfig":
        """Return the same settings for graphs with no more than a network takes.

        Without `shear` it adds no taxels; without `neighbours` taxels are not joined.
        """
        kept = self if shear else self.without_shear()
        return kept if neighbours else replace(kept, fixed=0, live=0)


@final
class GraphBuilder:
    """A builder makes the graphs of one stream of readings, oldest first.

    It keeps the previous reading that has graphs, and since when each taxel has been
    active, so `advance` must be called once for every such reading, before `build`.
    `step` is the latest reading, `workspace` the memory in which graphs are built.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: GraphConfig | None = None,
        poses: LinkPoseCache | None = None,
    ) -> None:
        """Find the fixed neighbours of a skin on a robot.

        `poses` are those of the robot's links, shared with other users of them.
        """
        self.mounted = mounted
        self.config = config or GraphConfig()
        self.poses = poses or LinkPoseCache(mounted, self.config.posed)
        self.geometry = build_skin_geometry(mounted, self.config)
        taxels = mounted.skin.count
        self.taxel_history = TaxelHistory(
            reading=np.full(taxels, NO_READING),
            onset=np.zeros(taxels, np.int64),
            pressure=np.zeros(taxels),
            before=np.zeros(taxels),
            shear=np.zeros((taxels, 2)),
            shear_before=np.zeros((taxels, 2)),
        )
        no_pressure = np.zeros(0, np.float32)
        no_poses = np.empty((0, 4, 4))
        self.step = KernelStep(
            0, LONG_AGO, MAX_STEP, False, no_pressure, NO_SHEAR, no_poses
        )
        self.workspace = allocate_workspace(INITIAL_NODES, self.geometry)

    def advance(self, reading: Reading, active: Int[np.ndarray, "active"]) -> None:
        """Store the loads of the next reading, of taxels that are touched and valid."""
        self.start_step(reading)
        update_taxel_history(active, self.step, self.taxel_history)

    def start_step(self, reading: Reading) -> None:
        """Store the next reading with its time and pose."""
        elapsed = (reading.stamp - self.step.stamp) * 1e-9
        self.step = KernelStep(
            reading=self.step.reading + 1,
            stamp=reading.stamp,
            seconds=min(max(elapsed, MIN_STEP), MAX_STEP),
            has_previous=elapsed <= MAX_STEP,
            pressure=reading.pressure,
            shear=get_shear(reading),
            T_world_link=self.poses.get(reading.q),
        )

    def is_new(self, reading: Reading, nodes: Mapping[int, "TouchNodes"]) -> bool:
        """Tell whether the next reading is no repetition of the loads of the last step.

        After `MAX_REPEAT` it is new, so that a touch that is held has graphs.
        """
        if reading.stamp - self.step.stamp >= MAX_REPEAT:
            return True
        history = self.taxel_history
        is_touched = False
        for active, earlier, _ in nodes.values():
            if (
                len(active) != len(earlier)
                or (history.pressure[active] != reading.pressure[active]).any()
                or (history.reading[active] != self.step.reading).any()
            ):
                return True
            if reading.shear is not None:
                if (history.shear[active] != reading.shear[active]).any():
                    return True
            is_touched |= len(active) > 0
        return not is_touched

    def reserve(self, active: int) -> GraphWorkspace:
        """Return memory for a graph of so many taxels, active now or in the last."""
        taxels, fixed = self.geometry.fixed_neighbours.shape
        nodes = min(active * (1 + fixed), taxels)
        if nodes > len(self.workspace.graph.taxels):
            self.workspace = allocate_workspace(min(2 * nodes, taxels), self.geometry)
        return self.workspace

    def build(
        self,
        taxels: Int[np.ndarray, "active"],
        earlier: Int[np.ndarray, "earlier"],
        history: Float[np.ndarray, "column"] = NO_HISTORY,
    ) -> GraphBatch:
        """Build the graph of one touch at the latest reading, as a batch of one.

        Arguments are the fields of `TouchNodes`.
        """
        workspace = self.reserve(len(taxels) + len(earlier))
        build_graph(
            taxels,
            earlier,
            history,
            self.step,
            self.geometry,
            self.taxel_history,
            workspace,
        )
        return workspace.graph.select(np.array([0]))


def get_shear(reading: Reading) -> Float[np.ndarray, "taxel 2"]:
    """Return the shear of a reading [kPa], without rows if it is not measured."""
    return NO_SHEAR if reading.shear is None else reading.shear


def build_skin_geometry(mounted: MountedSkin, config: GraphConfig) -> SkinGeometry:
    """Find the fixed neighbours of a skin, and lay out its geometry for kernels."""
    skin = mounted.skin
    fixed = find_fixed_neighbours(skin, config.fixed)
    tangents = np.stack([skin.tangents, np.cross(skin.normals, skin.tangents)])
    return SkinGeometry(
        positions=np.ascontiguousarray(skin.positions, np.float64),
        normals=np.ascontiguousarray(skin.normals, np.float64),
        tangents=np.ascontiguousarray(tangents, np.float64),
        areas=(skin.areas * CM2_PER_M2).astype(np.float32),
        links=np.ascontiguousarray(mounted.taxel_link_index, np.int64),
        patch=np.ascontiguousarray(skin.patch_index, np.int64),
        rank=np.ascontiguousarray(fixed.rank, np.int64),
        fixed_neighbours=fixed.table,
        reach=config.live_reach,
        live=config.live,
    )


def allocate_workspace(nodes: int, geometry: SkinGeometry) -> GraphWorkspace:
    """Allocate memory for graphs of so many nodes of a skin."""
    taxels, fixed = geometry.fixed_neighbours.shape
    return GraphWorkspace(
        graph=allocate_graphs(1, nodes, fixed + geometry.live),
        p_world=np.zeros((nodes, 3)),
        position_sum=np.zeros(3),
        patch=np.zeros(nodes, np.int64),
        rank=np.zeros(nodes, np.int64),
        search=allocate_search(nodes, geometry.live),
        taxel_node=np.zeros(taxels, np.int64),
        marks=np.zeros(taxels // 64 + 1, np.uint64),
    )


class TouchNodes(NamedTuple):
    """Touch nodes are the taxels and the history of a sequence at one reading."""

    taxels: Int[np.ndarray, "active"]  # active now
    earlier: Int[np.ndarray, "earlier"]  # active in the graphs before
    history: Float[np.ndarray, "column"]  # of the touch so far: columns `HISTORY`


@final
class GraphStream:
    """A graph stream builds the graph of every open touch at every measurement.

    The graphs of a touch are one sequence. On a skin that is not calibrated there is
    one sequence for the whole skin, which goes on even while nothing touches it.

    A reading that repeats the loads of the last one has no graphs, for at most
    `MAX_REPEAT`: a device that is slower than it is read has measured nothing since.
    Nor have readings of the same touches that follow one another faster than `SPACING`.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: GraphConfig | None = None,
        poses: LinkPoseCache | None = None,
    ) -> None:
        """Start before the first reading; see `GraphBuilder`."""
        self.builder = GraphBuilder(mounted, config, poses)
        self.calibrated = mounted.skin.calibrated
        self.last: dict[int, TouchNodes] = {}
        self.due = LONG_AGO

    def build_graphs(self, state: TouchState) -> dict[int, GraphBatch]:
        """Return the graph of each sequence at the next reading, by key.

        A touch between two contacts has a graph without pressure. There is none if the
        reading has no graphs.
        """
        nodes = self.find_touch_nodes(state)
        if nodes is None:
            return {}
        self.builder.advance(state.reading, join_active(nodes))
        return {key: self.builder.build(*each) for key, each in nodes.items()}

    def find_touch_nodes(self, state: TouchState) -> dict[int, TouchNodes] | None:
        """Return the nodes of each sequence at the next reading, by key.

        None stands for a reading without graphs, of which the builder must not be told.
        """
        reading = state.reading
        touches = state.tracking.open
        keys = {one.id for one in touches} if self.calibrated else {WHOLE_SKIN}
        go_on = keys == self.last.keys()
        if go_on and reading.stamp < self.due:
            return None
        nodes = self.collect_nodes(state, go_on)
        if go_on and not self.builder.is_new(reading, nodes):
            return None
        earliest = reading.stamp - MAX_AHEAD
        latest = reading.stamp
        self.due = min(max(self.due, earliest), latest) + SPACING
        self.last = nodes
        return nodes

    def collect_nodes(self, state: TouchState, go_on: bool) -> dict[int, TouchNodes]:
        """Return the nodes of each sequence at the next reading, by key.

        The earlier taxels of a touch are those of its last graph. Unless all touches of
        that one go on, one may have merged into it: then those of the reading before
        count too.
        """
        last = {key: each.taxels for key, each in self.last.items()}
        if not self.calibrated:
            active = self.find_active_taxels(state)
            earlier = last.get(WHOLE_SKIN, NO_TAXELS)
            return {WHOLE_SKIN: TouchNodes(active, earlier, NO_HISTORY)}
        nodes = {}
        for touch in state.tracking.open:
            earlier = last.get(touch.id, NO_TAXELS)
            if not go_on:
                earlier = np.concatenate([touch.before, earlier])
            history = build_history(touch, state.reading.stamp)
            nodes[touch.id] = TouchNodes(touch.taxels, earlier, history)
        return nodes

    def find_active_taxels(self, state: TouchState) -> Int[np.ndarray, "active"]:
        """Return all taxels in contact or under shear, whatever their touch."""
        parts = [contact.taxels for contact in state.contacts]
        reading = state.reading
        if reading.shear is not None:
            size = np.linalg.norm(reading.shear, axis=1)
            sheared = size >= self.builder.config.shear_on
            parts.append(np.flatnonzero(sheared & reading.valid))
        return np.unique(np.concatenate([NO_TAXELS, *parts]))


def build_history(touch: TouchRecord, stamp: int) -> Float[np.ndarray, "column"]:
    """Return the columns `HISTORY` of an open touch at a stamp [ns]."""
    travel = measure_distance(touch.latest, touch.start)
    return np.array(
        [
            (stamp - touch.onset) * S_PER_NS,
            (stamp - touch.last) * S_PER_NS,
            touch.contacts,
            travel * CM_PER_M,
            touch.farthest * CM_PER_M,
            touch.impulse,
            touch.peak_force,
        ]
    )


def join_active(nodes: Mapping[int, TouchNodes]) -> Int[np.ndarray, "active"]:
    """Return the active taxels of all sequences."""
    parts = [each.taxels for each in nodes.values()] or [NO_TAXELS]
    return np.concatenate(parts) if len(parts) > 1 else parts[0]


class FixedNeighbours:
    """Fixed neighbours are the nearest taxels of the same patch, found once for a skin.

    They are the static connections of Jiang et al. 2025 (section IV-C4, Fig. 8b).

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


@lru_cache(maxsize=4)
def find_fixed_neighbours(skin: Skin, k: int) -> FixedNeighbours:
    """Find the fixed neighbours of a skin once for all who use it and change none."""
    return FixedNeighbours(skin, k)


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
    one, other, squared = find_nearest(np.rint(positions * MICROMETRES), k)
    order = np.lexsort((rank[taxels[other]], squared, one))
    one = one[order]
    other = other[order]
    place = np.arange(len(one)) - np.searchsorted(one, one)
    nearest = np.full((len(taxels), k), NO_NODE, dtype=np.int64)
    kept = place < k
    nearest[one[kept], place[kept]] = taxels[other[kept]]
    return nearest


def find_live_neighbours(
    p_world: Float[np.ndarray, "node 3"],
    patch: Int[np.ndarray, "node"],
    rank: Int[np.ndarray, "node"],
    k: int,
    reach: float,
) -> Int[np.ndarray, "node {k}"]:
    """Return the `k` nearest nodes of other patches by kinematic distance, or -1.

    Distances up to `reach` [m] are compared in whole micrometres, so that a motion of
    the whole robot neither reorders equal ones, of which ranks decide, nor moves one
    across the reach. These edges are the dynamic connections of Jiang et al. 2025
    (section IV-C4, Fig. 8a).
    """
    nearest = np.empty((len(p_world), k), np.int32)
    workspace = allocate_search(len(patch), k)
    write_live_neighbours(p_world, patch, rank, reach, workspace, nearest)
    return nearest
