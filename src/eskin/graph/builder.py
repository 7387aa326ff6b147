"""From a reading and the active taxels of a touch to its graph."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.graph.batch import GraphBatch
from eskin.graph.builder_kernels import (
    find_support,
    load_nodes,
    place_fixed,
    take_in,
)
from eskin.graph.config import GraphConfig
from eskin.graph.history import NOTHING
from eskin.graph.neighbour_kernels import NOBODY
from eskin.graph.neighbours import FixedNeighbours, live_neighbours
from eskin.skin import MountedSkin
from eskin.touch import Reading
from eskin.touch.geometry_kernels import place as place_in_world
from eskin.touch.poses import LivePoses

CM_PER_M = 100.0
CM2_PER_M2 = 1e4
LONGEST_STEP = 0.5  # [s] between readings that a rate is taken over
SHORTEST_STEP = 1e-4  # [s]
LONG_AGO = -1_000_000_000  # [ns], so that no first reading follows another


class GraphBuilder:
    """Builds the graphs of one stream of readings, oldest first.

    It remembers one reading and since when each taxel has been active, so `advance`
    must be called once for every reading, before `graph`.
    """

    def __init__(self, mounted: MountedSkin, config: GraphConfig | None = None) -> None:
        """Find the fixed neighbours of a skin on a robot."""
        self.mounted = mounted
        self.config = config or GraphConfig()
        self.fixed = FixedNeighbours(mounted.skin, self.config.fixed)
        self.poses = LivePoses(mounted)
        count = mounted.skin.count
        self.stamp = LONG_AGO
        self.q = np.zeros(len(mounted.robot.joint_names))
        self.seconds = LONGEST_STEP
        self.pressure, self.before = np.zeros(count), np.zeros(count)
        self.shear, self.shear_before = np.zeros((count, 2)), np.zeros((count, 2))
        self.active = np.zeros(count, dtype=bool)
        self.onset = np.zeros(count, dtype=np.int64)
        self.links = mounted.skin_link_index.astype(np.int64)
        self.place = np.full(count, NOBODY, dtype=np.int32)

    def advance(self, reading: Reading, active: Bool[np.ndarray, "taxel"]) -> None:
        """Take in the next reading.

        Args:
            reading: later than the one before.
            active: which taxels are touched in it; all of them valid.
        """
        step = (reading.stamp - self.stamp) * 1e-9
        follows = step <= LONGEST_STEP
        self.seconds = min(max(step, SHORTEST_STEP), LONGEST_STEP)
        self.stamp, self.q = reading.stamp, reading.q
        take_in(
            reading.pressure,
            active,
            reading.stamp,
            follows,
            self.pressure,
            self.before,
            self.active,
            self.onset,
        )
        if reading.shear is not None or self.shear.any() or self.shear_before.any():
            self.shear_before = self.shear * follows
            shear = 0.0 if reading.shear is None else reading.shear.astype(np.float64)
            self.shear = np.where(active[:, None], shear, np.zeros_like(self.shear))

    def graph(
        self,
        taxels: Int[np.ndarray, "active"],
        earlier: Int[np.ndarray, "earlier"],
        history: Float[np.ndarray, "column"] = NOTHING,
    ) -> GraphBatch:
        """The graph of one touch at the latest reading, as a batch of one.

        Args:
            taxels: active taxels of the touch now.
            earlier: active taxels of the same touch at the reading before.
            history: what the touch has been so far.
        """
        skin, table, place = self.mounted.skin, self.fixed.table, self.place
        nodes = find_support(taxels, earlier, table, place)
        count = len(nodes)
        T_world_link = self.poses.at(self.q)
        p_world = place_in_world(nodes, skin.positions, self.links, T_world_link, 1.0)
        n_world = place_in_world(nodes, skin.normals, self.links, T_world_link, 0.0)
        middle = p_world.sum(axis=0) / max(count, 1)
        loads = np.empty((3, count), np.float32)
        load_nodes(
            *(nodes, taxels, earlier, place, self.stamp),
            *(self.pressure, self.before, self.onset, loads),
        )
        neighbours = self.neighbours(nodes, p_world)
        shear, shear_before = self.sheared(nodes, taxels, earlier)
        place[nodes] = NOBODY
        return GraphBatch(
            taxels=nodes,
            pressure=loads[0],
            before=loads[1],
            age=loads[2],
            areas=(skin.areas[nodes] * CM2_PER_M2).astype(np.float32),
            positions=((p_world - middle) * CM_PER_M).astype(np.float32),
            normals=n_world.astype(np.float32),
            shear=shear,
            shear_before=shear_before,
            neighbours=neighbours,
            offsets=np.array([0, count]),
            seconds=np.array([self.seconds], np.float32),
            history=history[None].astype(np.float32),
        )

    def neighbours(
        self, nodes: Int[np.ndarray, "node"], p_world: Float[np.ndarray, "node 3"]
    ) -> Int[np.ndarray, "node k"]:
        """Fixed neighbours inside the support, then live ones across patches."""
        config, table = self.config, self.fixed.table
        neighbours = np.empty((len(nodes), config.fixed + config.live), np.int32)
        place_fixed(nodes, table, self.place, neighbours[:, : config.fixed])
        neighbours[:, config.fixed :] = live_neighbours(
            p_world,
            self.mounted.skin.patch_index[nodes],
            self.fixed.rank[nodes],
            config.live,
            config.live_reach,
        )
        return neighbours

    def sheared(
        self,
        nodes: Int[np.ndarray, "node"],
        taxels: Int[np.ndarray, "active"],
        earlier: Int[np.ndarray, "earlier"],
    ) -> tuple[Float[np.ndarray, "node 3"], Float[np.ndarray, "node 3"]]:
        """Shear of a touch's own nodes in the world, now and a reading ago [kPa]."""
        now, before = np.zeros((2, len(nodes), 3), np.float32)
        if self.shear.any() or self.shear_before.any():
            R_world_taxel = self.mounted.frames(self.q, nodes)
            own, own_before = np.isin(nodes, taxels), np.isin(nodes, earlier)
            now[own] = tangential(R_world_taxel, self.shear[nodes])[own]
            before_world = tangential(R_world_taxel, self.shear_before[nodes])
            before[own_before] = before_world[own_before]
        return now, before


def tangential(
    R_world_taxel: Float[np.ndarray, "node 3 3"], shear: Float[np.ndarray, "node 2"]
) -> Float[np.ndarray, "node 3"]:
    """Shear along the tangents of each taxel, in the directions of the world [kPa]."""
    return np.einsum("tij,tj->ti", R_world_taxel[..., :2], shear)
