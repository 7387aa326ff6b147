"""This module finds the edges of a graph of all taxels, as section IV-C4 has them."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from eskin.live import LENGTH_CM, FixedNeighbours, GraphConfig, find_live_neighbours
from eskin.skin import MountedSkin
from eskin_paper_network.layer_kernels import count_edges, list_edges, mark_changed

LENGTH_UNIT = LENGTH_CM / 100.0
"""Unit of length [m]."""

Distance = Literal["kinematic", "geometric", "patch", "none"]
"""Distance between taxels, by the words of the paper's section IV-A5.

- `kinematic`: straight lines in space at the live pose. Taxels that are touched, and
  their neighbours, have live edges to the nearest of other patches.
- `geometric`: along the surface of the robot, so the same in every pose. Taxels have
  fixed edges to the nearest of other patches across a seam; the pose is not used.
- `patch`: fixed edges inside patches alone, with their lengths.
- `none`: the same edges, without any length.
"""

FACING = 0.5
"""Least cosine between the normals of two taxels beside a seam: taxels that face each
other are near in space, but not along the surface."""


@dataclass(frozen=True, eq=False)
class TouchedGraph:
    """A touched graph holds the nodes that differ from rest in some readings.

    A *row* is a node of a reading. The first rows are targets of edges, ordered by the
    layer from which on they differ; other rows are sources alone.
    """

    reading: Int[Tensor, "row"]
    """Reading of each row."""
    node: Int[Tensor, "row"]
    """Taxel of each row."""
    counts: tuple[int, ...]
    """Number of rows that differ from rest after each layer."""
    first: Int[np.ndarray, "target+1"]
    """First edge of each target."""
    source: Int[np.ndarray, "edge"]
    """Row of the source of each edge."""


@final
class Neighbourhood:
    """A neighbourhood finds edges between the taxels of a skin.

    Attributes:
        table: fixed neighbours of each taxel, -1 where there are fewer.
        uses_pose: whether edges and lengths depend on the pose.
        uses_length: whether edges have lengths.
    """

    def __init__(self, mounted: MountedSkin, k: int, distance: Distance) -> None:
        """Find the fixed neighbours of each taxel.

        Args:
            mounted: the skin on its robot.
            k: number of neighbours of a taxel inside its patch.
            distance: distance between taxels.
        """
        self.mounted = mounted
        self.config = GraphConfig()
        fixed = FixedNeighbours(mounted.skin, k)
        self.rank = fixed.rank
        self.uses_pose = distance == "kinematic"
        self.uses_length = distance != "none"
        self.table = fixed.table.astype(np.int32)
        if distance == "geometric":
            self.table = np.concatenate([self.table, self.find_seams()], axis=1)

    def find_seams(self) -> Int[np.ndarray, "taxel live"]:
        """Return the nearest taxels of other patches along the surface, or -1.

        They are found at zero joint positions. Across a seam of at most `live_reach`
        the straight line is as long as the way along the surface, to a percent on a
        link of 60 mm radius.
        """
        joints = np.zeros(len(self.mounted.robot.joint_names))
        p_world, n_world = self.mounted.place_taxels(joints)
        near = find_live_neighbours(
            p_world,
            self.mounted.skin.patch_index,
            self.rank,
            self.config.live,
            self.config.live_reach,
        )
        cosines = np.einsum("ti,tki->tk", n_world, n_world[near])
        return np.where((near >= 0) & (cosines >= FACING), near, np.int32(-1))

    def find_live_edges(
        self,
        touched: Bool[np.ndarray, "reading taxel"],
        q: Float[np.ndarray, "reading joint"],
    ) -> Int[np.ndarray, "reading taxel live"]:
        """Return neighbours in other patches of touched taxels and their neighbours.

        The last axis is empty where no reading has any.
        """
        patch_index = self.mounted.skin.patch_index
        found: list[tuple[int, np.ndarray, np.ndarray]] = []
        for reading, flags in enumerate(touched):
            active = np.flatnonzero(flags)
            near = self.table[active]
            nodes = np.union1d(active, near[near >= 0])
            patches = patch_index[nodes]
            if len(nodes) == 0 or (patches == patches[0]).all():
                continue
            p_world, _ = self.mounted.place_taxels(q[reading], nodes)
            others = find_live_neighbours(
                p_world,
                patches,
                self.rank[nodes],
                self.config.live,
                self.config.live_reach,
            )
            if (others >= 0).any():
                found.append((reading, nodes, np.where(others >= 0, nodes[others], -1)))
        width = self.config.live if found else 0
        live = np.full((*touched.shape, width), -1, np.int32)
        for reading, nodes, others in found:
            live[reading, nodes] = others
        return live

    def select(
        self,
        touched: Bool[np.ndarray, "reading taxel"],
        q: Float[np.ndarray, "reading joint"],
        layers: int,
        whole: bool = False,
    ) -> TouchedGraph:
        """Return the nodes that differ from rest after some layers, and their edges.

        Args:
            touched: which taxels are touched.
            q: joint positions [rad].
            layers: number of layers.
            whole: whether all nodes are taken, as in the paper.
        """
        live = np.full((*touched.shape, 0), -1, np.int32)
        if self.uses_pose:
            live = self.find_live_edges(touched, q)
        hop = np.zeros(touched.shape, np.int32)
        changed = np.ones_like(touched) if whole else touched
        mark_changed(changed, self.table, live, layers, hop)
        reading, node = np.nonzero(hop <= layers)
        order = np.argsort(hop[reading, node], kind="stable")
        reading = reading[order]
        node = node[order]
        level = hop[reading, node]
        counts = tuple(int((level <= layer).sum()) for layer in range(1, layers + 1))
        first = np.zeros(len(node) + 1, np.int64)
        count_edges(node, reading, self.table, live, first)
        source = np.zeros(first[-1], np.int32)
        most = min(touched.size, len(node) + len(source))
        nodes = np.empty(most, np.int64)
        readings = np.empty(most, np.int64)
        nodes[: len(node)] = node
        readings[: len(node)] = reading
        place = np.full(touched.shape, -1, np.int32)
        place[reading, node] = np.arange(len(node))
        rows = list_edges(
            node, reading, self.table, live, place, nodes, readings, source
        )
        return TouchedGraph(
            torch.from_numpy(readings[:rows]),
            torch.from_numpy(nodes[:rows]),
            counts,
            first,
            source,
        )
