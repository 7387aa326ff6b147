"""This module builds the contact graph of a touch from a reading."""

import math
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.live.graph_batch import (
    NO_HISTORY,
    NODE_FIELDS,
    GraphBatch,
    allocate_graphs,
)
from eskin.live.graph_kernels import (
    GraphWorkspace,
    SkinGeometry,
    TaxelHistory,
    TimeStep,
    build_graph,
    update_taxel_history,
)
from eskin.live.neighbours import FixedNeighbours, allocate_search
from eskin.skin import MountedSkin
from eskin.touch import LinkPoseCache, Reading

MAX_STEP = 0.5  # [s] between readings from which a rate is computed
MIN_STEP = 1e-4  # [s]
LONG_AGO = -1_000_000_000  # [ns] stamp before the first reading, too old for a rate
NEVER = -2  # number of the reading of a taxel that has not been active yet
INITIAL_NODES = 256  # that there is memory for
NO_SHEAR = np.zeros((0, 2), np.float32)
CM2_PER_M2 = 1e4


@dataclass(frozen=True)
class GraphConfig:
    """These settings determine how the taxels of a touch become a graph."""

    fixed: int = 8
    """Number of nearest taxels of the same patch that each taxel is joined to (the
    paper's K)."""
    live: int = 4
    """Number of nearest taxels of other patches, searched for at every reading."""
    live_reach: float = 0.03
    """Largest distance at which a taxel of another patch is joined [m]."""
    shear_on: float = 1.5
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

        Args:
            shear: whether taxels that only shear adds are kept.
            neighbours: whether taxels are joined to others.
        """
        kept = self if shear else self.without_shear()
        return kept if neighbours else replace(kept, fixed=0, live=0)


@final
class GraphBuilder:
    """A builder makes the graphs of one stream of readings, oldest first.

    It keeps the previous reading and since when each taxel has been active, so
    `advance` must be called once for every reading, before `build`.

    Attributes:
        geometry: geometry of the skin.
        taxel_history: loads of each taxel when it was last active.
        time_step: number and time of the latest reading.
        T_world_link: pose of every link at that reading.
        workspace: memory in which graphs are built.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: GraphConfig | None = None,
        poses: LinkPoseCache | None = None,
    ) -> None:
        """Find the fixed neighbours of a skin on a robot.

        Args:
            mounted: the skin on its robot.
            config: settings of the graph.
            poses: poses of the robot's links, shared with other users of them.
        """
        self.mounted = mounted
        self.config = config or GraphConfig()
        self.poses = poses or LinkPoseCache(mounted, self.config.posed)
        self.geometry = build_skin_geometry(mounted, self.config)
        self.taxel_history = create_taxel_history(mounted.skin.count)
        self.time_step = TimeStep(0, LONG_AGO, MAX_STEP, False)
        self.T_world_link = np.empty((0, 4, 4))
        self.workspace = allocate_workspace(INITIAL_NODES, self.geometry)

    def advance(self, reading: Reading, active: Int[np.ndarray, "active"]) -> None:
        """Store the loads of the next reading.

        Args:
            reading: reading later than the previous one.
            active: taxels that are touched in it, in any order, all of them valid.
        """
        shear = self.start_step(reading)
        update_taxel_history(
            active, reading.pressure, shear, self.time_step, self.taxel_history
        )

    def start_step(self, reading: Reading) -> Float[np.ndarray, "taxel_or_none 2"]:
        """Store time and pose of the next reading; return its shear, if any."""
        step = (reading.stamp - self.time_step.stamp) * 1e-9
        seconds = min(max(step, MIN_STEP), MAX_STEP)
        number = self.time_step.reading + 1
        self.time_step = TimeStep(number, reading.stamp, seconds, step <= MAX_STEP)
        self.T_world_link = self.poses.get(reading.q)
        return NO_SHEAR if reading.shear is None else reading.shear

    def reserve(self, active: int) -> GraphWorkspace:
        """Return memory for a graph of so many taxels active now or one reading ago."""
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

        Args:
            taxels: active taxels of the touch now.
            earlier: active taxels of the same touch at the previous reading.
            history: history of the touch so far, with the columns `HISTORY`.
        """
        workspace = self.reserve(len(taxels) + len(earlier))
        nodes = build_graph(
            taxels,
            earlier,
            history,
            self.T_world_link,
            self.time_step,
            self.geometry,
            self.taxel_history,
            workspace,
        )
        graph = workspace.graph
        return GraphBatch(
            **{name: getattr(graph, name)[:nodes].copy() for name in NODE_FIELDS},
            offsets=graph.offsets.copy(),
            seconds=graph.seconds.copy(),
            history=graph.history.copy(),
        )


def build_skin_geometry(mounted: MountedSkin, config: GraphConfig) -> SkinGeometry:
    """Find the fixed neighbours of a skin, and lay out its geometry for kernels."""
    skin, fixed = mounted.skin, FixedNeighbours(mounted.skin, config.fixed)
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


def create_taxel_history(taxels: int) -> TaxelHistory:
    """Return the history of so many taxels before the first reading."""
    return TaxelHistory(
        reading=np.full(taxels, NEVER),
        onset=np.zeros(taxels, np.int64),
        pressure=np.zeros(taxels),
        before=np.zeros(taxels),
        shear=np.zeros((taxels, 2)),
        shear_before=np.zeros((taxels, 2)),
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
