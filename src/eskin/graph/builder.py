"""From a reading and the active taxels of a touch to its graph."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.graph.batch import GraphBatch
from eskin.graph.config import GraphConfig
from eskin.graph.history import NOTHING
from eskin.graph.neighbours import NOBODY, FixedNeighbours, live_neighbours
from eskin.skin import MountedSkin
from eskin.touch import Reading
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

    def advance(self, reading: Reading, active: Bool[np.ndarray, "taxel"]) -> None:
        """Take in the next reading.

        Args:
            reading: later than the one before.
            active: which taxels are touched in it; all of them valid.
        """
        step = (reading.stamp - self.stamp) * 1e-9
        follows = step <= LONGEST_STEP
        self.seconds = float(np.clip(step, SHORTEST_STEP, LONGEST_STEP))
        self.before = self.pressure * follows
        self.shear_before = self.shear * follows
        self.onset = np.where(active & ~self.active, reading.stamp, self.onset)
        self.stamp, self.q, self.active = reading.stamp, reading.q, active.copy()
        self.pressure = np.where(active, reading.pressure.astype(np.float64), 0.0)
        shear = np.zeros_like(self.shear) if reading.shear is None else reading.shear
        self.shear = np.where(active[:, None], shear.astype(np.float64), 0.0)

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
        nodes = self.support(taxels, earlier)
        owned, owned_before = self.marked(nodes, taxels), self.marked(nodes, earlier)
        skin, links = self.mounted.skin, self.mounted.skin_link_index[nodes]
        T_world_link = self.poses.at(self.q)[links]
        R_world_link, origin = T_world_link[:, :3, :3], T_world_link[:, :3, 3]
        p_world = turned(R_world_link, skin.positions[nodes]) + origin
        n_world = turned(R_world_link, skin.normals[nodes])
        middle = p_world.mean(axis=0) if len(nodes) else np.zeros(3)
        shear, shear_before = np.zeros_like(p_world), np.zeros_like(p_world)
        if self.shear.any() or self.shear_before.any():
            R_world_taxel = self.mounted.frames(self.q, nodes)
            shear = tangential(R_world_taxel, self.shear[nodes] * owned[:, None])
            shear_before = tangential(
                R_world_taxel, self.shear_before[nodes] * owned_before[:, None]
            )
        float_fields = {
            "pressure": self.pressure[nodes] * owned,
            "before": self.before[nodes] * owned_before,
            "age": (self.stamp - self.onset[nodes]) * 1e-9 * owned,
            "areas": skin.areas[nodes] * CM2_PER_M2,
            "positions": (p_world - middle) * CM_PER_M,
            "normals": n_world,
            "shear": shear,
            "shear_before": shear_before,
            "seconds": np.array([self.seconds]),
            "history": history[None],
        }
        return GraphBatch(
            taxels=nodes,
            neighbours=self.neighbours(nodes, p_world),
            offsets=np.array([0, len(nodes)]),
            **{name: v.astype(np.float32) for name, v in float_fields.items()},
        )

    def support(
        self,
        taxels: Int[np.ndarray, "active"],
        earlier: Int[np.ndarray, "earlier"],
    ) -> Int[np.ndarray, "node"]:
        """Taxels active now or before and their fixed neighbours, ascending."""
        mark = np.zeros(self.mounted.skin.count + 1, dtype=bool)
        for those in (taxels, earlier):
            mark[those] = True
            mark[self.fixed.table[those]] = True
        return np.flatnonzero(mark[:-1])  # NOBODY is the last

    def marked(
        self, nodes: Int[np.ndarray, "node"], taxels: Int[np.ndarray, "some"]
    ) -> Bool[np.ndarray, "node"]:
        """Which nodes are among some taxels."""
        mark = np.zeros(self.mounted.skin.count, dtype=bool)
        mark[taxels] = True
        return mark[nodes]

    def neighbours(
        self, nodes: Int[np.ndarray, "node"], p_world: Float[np.ndarray, "node 3"]
    ) -> Int[np.ndarray, "node k"]:
        """Fixed neighbours inside the support, then live ones across patches."""
        place = np.full(self.mounted.skin.count + 1, NOBODY, dtype=np.int32)
        place[nodes] = np.arange(len(nodes))
        live = live_neighbours(
            p_world,
            self.mounted.skin.patch_index[nodes],
            self.fixed.rank[nodes],
            self.config.live,
            self.config.live_reach,
        )
        fixed = place[self.fixed.table[nodes]]
        return np.concatenate([fixed, live.astype(np.int32)], axis=1)


def turned(
    R: Float[np.ndarray, "node 3 3"], vectors: Float[np.ndarray, "node 3"]
) -> Float[np.ndarray, "node 3"]:
    """Each vector turned by its own rotation."""
    return (R @ vectors[:, :, None])[:, :, 0]


def tangential(
    R_world_taxel: Float[np.ndarray, "node 3 3"], shear: Float[np.ndarray, "node 2"]
) -> Float[np.ndarray, "node 3"]:
    """Shear along the tangents of each taxel, in the directions of the world [kPa]."""
    return np.einsum("tij,tj->ti", R_world_taxel[..., :2], shear)
