"""Which nodes of the paper's graphs have to be computed, and whom they hear."""

from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from eskin.graph import FixedNeighbours, GraphConfig, live_neighbours
from eskin.skin import MountedSkin


@dataclass(frozen=True, eq=False)
class Step:
    """What one layer computes; all other rows are as at rest after it."""

    targets: Int[Tensor, "target"]
    """Rows that are computed."""
    sources: Int[Tensor, "target k"]
    """Rows that each of these hears, or -1."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The nodes of some readings that are computed, and those that they hear."""

    reading: Int[Tensor, "row"]
    """Of each row."""
    node: Int[Tensor, "row"]
    """The taxel of each row."""
    steps: list[Step]
    """One a layer: what differs from rest spreads by one hop with each."""


@final
class Neighbourhood:
    """Finds the rows of a graph of all taxels.

    Attributes:
        table: neighbours of each taxel inside its patch, or -1.
    """

    table: Int[Tensor, "taxel k"]

    def __init__(self, mounted: MountedSkin, k: int) -> None:
        """Look neighbours up once.

        Args:
            mounted: the skin on its robot.
            k: neighbours of a taxel inside its patch.
        """
        self.mounted = mounted
        fixed = FixedNeighbours(mounted.skin, k)
        self.table = torch.from_numpy(fixed.table)
        self.rank = fixed.rank

    def rows(
        self,
        touched: Bool[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
        layers: int,
        whole: bool,
    ) -> Rows:
        """Which nodes each layer computes, and which of them hear which.

        Args:
            touched: which taxels are triggered.
            q: joint positions [rad].
            layers: how many follow each other.
            whole: whether all nodes are computed, or only what a touch changes.
        """
        table, live = self.table, self.live_edges(touched, q)
        joined = (live >= 0).any(dim=-1)
        changed = torch.ones_like(touched) if whole else touched
        computed: list[tuple[Tensor, Tensor, Tensor]] = []
        for _ in range(layers):
            near = (changed[:, table.clamp(min=0)] & (table >= 0)).any(dim=-1)
            changed = changed | near | joined
            reading, node = changed.nonzero(as_tuple=True)
            heard = torch.cat([table[node], live[reading, node]], dim=1)
            computed.append((reading, node, heard))
        needed, (reading, _, heard) = changed.clone(), computed[-1]
        target, _ = (heard >= 0).nonzero(as_tuple=True)
        needed[reading[target], heard[heard >= 0]] = True
        place = torch.full(touched.shape, -1)
        place[needed] = torch.arange(int(needed.sum()))
        steps = []
        for reading, node, heard in computed:
            sources = place[reading[:, None], heard.clamp(min=0)]
            steps.append(
                Step(place[reading, node], torch.where(heard >= 0, sources, -1))
            )
        reading, node = needed.nonzero(as_tuple=True)
        return Rows(reading, node, steps)

    def live_edges(
        self, touched: Bool[Tensor, "reading taxel"], q: Float[Tensor, "reading joint"]
    ) -> Int[Tensor, "reading taxel live"]:
        """Neighbours in other patches of triggered taxels and of those next to them."""
        config, patch_index = GraphConfig(), self.mounted.skin.patch_index
        live = np.full((*touched.shape, config.live), -1)
        for reading, flags in enumerate(touched.numpy()):
            near = self.table[np.flatnonzero(flags)].numpy()
            nodes = np.union1d(np.flatnonzero(flags), near[near >= 0])
            patches = patch_index[nodes]
            if len(np.unique(patches)) > 1:
                p_world, _ = self.mounted.poses(q[reading].double().numpy(), nodes)
                found = live_neighbours(
                    p_world,
                    patches,
                    self.rank[nodes],
                    config.live,
                    config.live_reach,
                )
                live[reading, nodes] = np.where(found >= 0, nodes[found], -1)
        widest = (live >= 0).any(axis=(0, 1)).sum()
        return torch.from_numpy(live[..., :widest])
