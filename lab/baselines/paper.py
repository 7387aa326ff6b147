"""This module implements the paper's network: an EGNN on the graph of all taxels.

From the paper: a node for every taxel, its pressure the node's feature (section IV-C1);
the kinematic distance as the edges' feature (IV-C2); K nearest neighbours (K = 8),
those inside a patch known beforehand and those of triggered taxels found live (IV-C4);
layers after Satorras et al. 2021 (its eq. 2); 100 graphs a window (IV-C3); maximum over
the nodes (V-A). It gives neither widths nor depth nor what follows the pooling: three
layers of width 32, as ours has, and two convolutions over time are our choice.

The paper also puts each taxel's pose from forward kinematics, a frame whose z axis is
the outward normal, into the node's feature (IV-C1), and calls the x of its equation 2
"poses", without saying how. That equation adds, subtracts and measures x, which is
defined for positions, and a pose among the features would break its equivariance. Ours
uses the position only, as x; normals are not used.
"""

from copy import copy
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.live import (
    LENGTH_CM,
    FixedNeighbours,
    GraphConfig,
    find_live_neighbours,
)
from eskin.skin import MountedSkin
from lab.baselines.flat import PRESSURE_UNIT
from lab.baselines.interface import TOUCHED, BaselineStream, WindowStream
from lab.baselines.network import (
    CachedStream,
    FitConfig,
    NetworkBaseline,
    ReadingNetwork,
)


@dataclass(frozen=True, eq=False)
class LayerStep:
    """A layer step lists the rows that one layer computes; others are at rest."""

    targets: Int[Tensor, "target"]
    """Rows that are computed."""
    sources: Int[Tensor, "target k"]
    """Rows that send messages to each of these, or -1."""


@dataclass(frozen=True, eq=False)
class ComputedNodes:
    """Computed nodes are the rows that some readings need, and their edges."""

    reading: Int[Tensor, "row"]
    """Reading of each row."""
    node: Int[Tensor, "row"]
    """Taxel of each row."""
    steps: list[LayerStep]
    """Step of each layer: the nodes that differ from rest grow by one hop a layer."""


@final
class NodeSelector:
    """A node selector finds the rows to compute in a graph of all taxels.

    Attributes:
        table: neighbours of each taxel inside its patch, or -1.
    """

    table: Int[Tensor, "taxel k"]

    def __init__(self, mounted: MountedSkin, k: int) -> None:
        """Find the `k` neighbours of each taxel inside its patch."""
        self.mounted = mounted
        fixed = FixedNeighbours(mounted.skin, k)
        self.table = torch.from_numpy(fixed.table)
        self.rank = fixed.rank

    def select(
        self,
        touched: Bool[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
        layers: int,
        whole: bool,
    ) -> ComputedNodes:
        """Return which nodes each layer computes, and the edges between them.

        Args:
            touched: which taxels are touched.
            q: joint positions [rad].
            layers: number of layers.
            whole: whether all nodes are computed, or only those that a touch changes.
        """
        table, live = self.table, self.find_live_edges(touched, q)
        joined = (live >= 0).any(dim=-1)
        changed = torch.ones_like(touched) if whole else touched
        computed: list[tuple[Tensor, Tensor, Tensor]] = []
        for _ in range(layers):
            near = (changed[:, table.clamp(min=0)] & (table >= 0)).any(dim=-1)
            changed = changed | near | joined
            reading, node = changed.nonzero(as_tuple=True)
            senders = torch.cat([table[node], live[reading, node]], dim=1)
            computed.append((reading, node, senders))
        needed, (reading, _, senders) = changed.clone(), computed[-1]
        target, _ = (senders >= 0).nonzero(as_tuple=True)
        needed[reading[target], senders[senders >= 0]] = True
        place = torch.full(touched.shape, -1)
        place[needed] = torch.arange(int(needed.sum()))
        steps = []
        for reading, node, senders in computed:
            sources = place[reading[:, None], senders.clamp(min=0)]
            steps.append(
                LayerStep(place[reading, node], torch.where(senders >= 0, sources, -1))
            )
        reading, node = needed.nonzero(as_tuple=True)
        return ComputedNodes(reading, node, steps)

    def find_live_edges(
        self, touched: Bool[Tensor, "reading taxel"], q: Float[Tensor, "reading joint"]
    ) -> Int[Tensor, "reading taxel live"]:
        """Return neighbours in other patches of touched taxels and their neighbours."""
        config, patch_index = GraphConfig(), self.mounted.skin.patch_index
        live = np.full((*touched.shape, config.live), -1)
        for reading, flags in enumerate(touched.numpy()):
            active = np.flatnonzero(flags)
            near = self.table[active].numpy()
            nodes = np.union1d(active, near[near >= 0])
            patches = patch_index[nodes]
            if len(np.unique(patches)) > 1:
                joints = q[reading].double().numpy()
                p_world, _ = self.mounted.place_taxels(joints, nodes)
                found = find_live_neighbours(
                    p_world, patches, self.rank[nodes], config.live, config.live_reach
                )
                live[reading, nodes] = np.where(found >= 0, nodes[found], -1)
        widest = (live >= 0).any(axis=(0, 1)).sum()
        return torch.from_numpy(live[..., :widest])


Pooling = Literal["max", "mean"]
WIDTH, LAYERS, CHANNELS, TAPS = 32, 3, 64, 5
LENGTH_UNIT = LENGTH_CM / 100.0
"""Unit of length [m]."""

READINGS_AT_ONCE = 4
"""Readings encoded together, few enough for their tensors to fit in the cache."""


@dataclass(frozen=True, eq=False)
class RestState:
    """A rest state holds the output of every layer for an untouched skin."""

    v: list[Float[Tensor, "taxel width"]]
    """Features before the first layer and after each."""
    x: list[Float[Tensor, "taxel 3"]]
    """Coordinates in the frames of the links, before the first layer and after each."""


class PaperLayer(nn.Module):
    """This layer is one EGCL, as the paper's equation 2 defines it.

    m_ij = phi_e(v_i, v_j, |x_i - x_j|^2, e_ij), e_ij the kinematic distance
    x_i <- x_i + C sum_j (x_i - x_j) phi_x(m_ij), C = 1 / K
    v_i <- phi_h(v_i, sum_j m_ij)

    phi_e's first layer is split into parts of i, j and the edge, for speed.
    """

    def __init__(self, width: int, k: int) -> None:
        """Create a layer of `width` channels for `k` neighbours inside a patch."""
        super().__init__()
        self.C = 1.0 / k
        self.of_target = nn.Linear(width, width)
        self.of_source = nn.Linear(width, width, bias=False)
        self.of_edge = nn.Linear(2, width, bias=False)
        self.message = nn.Linear(width, width)
        self.move = nn.Sequential(
            nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 1, bias=False)
        )
        self.update = nn.Sequential(
            nn.Linear(2 * width, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(
        self,
        v: Float[Tensor, "row width"],
        x: Float[Tensor, "row 3"],
        lengths: Float[Tensor, "target k"],
        targets: Int[Tensor, "target"],
        sources: Int[Tensor, "target k"],
    ) -> tuple[Float[Tensor, "target width"], Float[Tensor, "target 3"]]:
        """Return features and coordinates of the targets after one step."""
        senders = (sources >= 0)[..., None]
        j = sources.clamp(min=0)
        x_i, v_i = x.index_select(0, targets), v.index_select(0, targets)
        r = x_i[:, None] - gather_rows(x, j)
        edge = torch.stack([(r * r).sum(dim=-1), lengths], dim=-1)
        hidden = self.of_target(v_i)[:, None] + gather_rows(self.of_source(v), j)
        m = silu(self.message(silu(hidden + self.of_edge(edge)))) * senders
        step = self.C * (r * self.move(m) * senders).sum(dim=1)
        return self.update(torch.cat([v_i, m.sum(dim=1)], dim=1)), x_i + step


def gather_rows(
    values: Float[Tensor, "row channel"], places: Int[Tensor, "target k"]
) -> Float[Tensor, "target k channel"]:
    """Return the rows of some nodes; its gradient is a sum, unlike that of indexing."""
    return values.index_select(0, places.flatten()).view(*places.shape, values.shape[1])


@final
class PaperNetwork(ReadingNetwork):
    """This network applies an EGNN, pooling and convolutions over time.

    An untouched taxel reads zero, so after n layers a node more than n hops from all
    touched nodes and live edges is in the rest state: equivariant layers have the same
    output for it in any pose of its link. With `whole`, all nodes are computed at every
    reading, as in the paper; else only those that differ, with the same result.

    Attributes:
        whole: whether all nodes are computed at every reading.
        rest: rest state for these weights; None where it must be computed.
    """

    positions: Float[Tensor, "taxel 3"]

    def __init__(
        self, mounted: MountedSkin, classes: int, k: int, pooling: Pooling
    ) -> None:
        """Create the network for a skin; arguments are as in `PaperBaseline`."""
        super().__init__()
        self.mounted, self.pooling, self.whole = mounted, pooling, False
        self.rest: RestState | None = None
        self.selector = NodeSelector(mounted, k)
        self.links = torch.from_numpy(mounted.taxel_link_index)
        positions = torch.from_numpy(mounted.skin.positions / LENGTH_UNIT)
        self.register_buffer("positions", positions.float())
        self.embed = nn.Linear(1, WIDTH)
        self.layers = nn.ModuleList(PaperLayer(WIDTH, k) for _ in range(LAYERS))
        self.over_time = nn.Sequential(
            nn.Conv1d(WIDTH, CHANNELS, TAPS),
            nn.SiLU(),
            nn.Conv1d(CHANNELS, CHANNELS, TAPS),
            nn.SiLU(),
            nn.AdaptiveMaxPool1d(1),
            nn.Flatten(),
        )
        self.out = nn.Linear(CHANNELS, classes)

    def encode(
        self,
        pressure: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
    ) -> Float[Tensor, "reading width"]:
        """Return the features of each reading."""
        pressure = pressure.to(self.positions.dtype)
        felt = torch.where(pressure >= TOUCHED, pressure / PRESSURE_UNIT, 0.0)
        rest = self.rest or self.compute_rest()
        if not self.training:
            self.rest = rest
        computed = torch.arange(len(felt))
        if not self.whole:
            computed = computed[(felt > 0).any(dim=1)]
        features = self.pool(rest.v[-1]).expand(len(felt), -1)
        for some in computed.split(READINGS_AT_ONCE):
            encoded = self.encode_some(felt[some], q[some], rest)
            features = features.index_copy(0, some, encoded)
        return features

    def train(self, mode: bool = True) -> "PaperNetwork":
        """Switch between training and evaluation, and discard the rest state."""
        self.rest = None
        return super().train(mode)

    def encode_some(
        self,
        felt: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
        rest: RestState,
    ) -> Float[Tensor, "reading width"]:
        """Return the features of readings computed together, in `PRESSURE_UNIT`."""
        T = self.mounted.kinematics.poses(q.double().numpy())
        T[..., :3, 3] /= LENGTH_UNIT
        T_world_link = torch.from_numpy(T).to(self.positions.dtype)
        rows = self.selector.select(felt > 0, q, LAYERS, self.whole)
        T_row = T_world_link[rows.reading, self.links[rows.node]]
        rotation, origin = T_row[:, :3, :3], T_row[:, :3, 3]
        v = self.embed(felt[rows.reading, rows.node, None])
        x = rotate_rows(rotation, rest.x[0].index_select(0, rows.node)) + origin
        x_first, computed = x, v
        for n, (layer, step) in enumerate(zip(self.layers, rows.steps, strict=True), 1):
            x_sources = gather_rows(x_first, step.sources.clamp(0))
            lengths = (x_first[step.targets, None] - x_sources).norm(dim=-1)
            computed, moved = layer(v, x, lengths, step.targets, step.sources)
            v = rest.v[n].index_select(0, rows.node)
            v = v.index_copy(0, step.targets, computed)
            x = rotate_rows(rotation, rest.x[n].index_select(0, rows.node)) + origin
            x = x.index_copy(0, step.targets, moved)
        return self.pool_rows(computed, rows, rest.v[-1], len(felt))

    def pool_rows(
        self,
        computed: Float[Tensor, "target width"],
        rows: ComputedNodes,
        rest: Float[Tensor, "taxel width"],
        readings: int,
    ) -> Float[Tensor, "reading width"]:
        """Return the maximum or mean over all nodes of each reading."""
        targets = rows.steps[-1].targets
        flat = rows.reading[targets] * len(rest) + rows.node[targets]
        every = rest.repeat(readings, 1).index_copy(0, flat, computed)
        return self.pool(every.view(readings, *rest.shape))

    def pool(
        self, nodes: Float[Tensor, "*reading taxel width"]
    ) -> Float[Tensor, "*reading width"]:
        """Return the maximum or mean over nodes."""
        return nodes.amax(dim=-2) if self.pooling == "max" else nodes.mean(dim=-2)

    def compute_rest(self) -> RestState:
        """Return the output of every layer for an untouched skin."""
        x, table = self.positions, self.selector.table
        every_node = torch.arange(len(x))
        v = self.embed(torch.zeros_like(x[:, :1]))
        rest = RestState([v], [x])
        lengths = (x[:, None] - gather_rows(x, table.clamp(min=0))).norm(dim=-1)
        for layer in self.layers:
            v, x = layer(v, x, lengths, every_node, table)
            rest.v.append(v)
            rest.x.append(x)
        return rest

    def classify(
        self, features: Float[Tensor, "clip 100 width"]
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of each window."""
        return self.out(self.over_time(features.transpose(1, 2)))


def rotate_rows(
    rotation: Float[Tensor, "row 3 3"], x: Float[Tensor, "row 3"]
) -> Float[Tensor, "row 3"]:
    """Rotate each vector by its own rotation matrix."""
    return (rotation @ x[..., None])[..., 0]


@final
class PaperBaseline(NetworkBaseline):
    """This baseline is the EGNN on all taxels and 100 graphs (see `PaperNetwork`)."""

    def __init__(
        self,
        mounted: MountedSkin,
        config: FitConfig | None = None,
        k: int = 8,
        pooling: Pooling = "max",
    ) -> None:
        """Create an untrained baseline.

        Args:
            mounted: the skin on its robot.
            config: settings of the training.
            k: number of neighbours of a taxel inside its patch.
            pooling: pooling over the nodes of a reading.
        """
        super().__init__(mounted, config)
        self.k = k
        self.pooling: Pooling = pooling

    def build(self) -> PaperNetwork:
        """Return the network."""
        return PaperNetwork(self.mounted, self.classes, self.k, self.pooling)

    def build_streams(self) -> dict[str, BaselineStream]:
        """Return streams that compute all nodes of 100 graphs, those of one, or few.

        The first is what the paper describes; the second computes the newest graph, the
        last one only the nodes of it that a touch changes.
        """
        assert isinstance(self.network, PaperNetwork)
        whole = copy(self)
        whole.network = all_nodes = copy(self.network)
        all_nodes.whole = True
        return {
            "": WindowStream(whole),
            "cached": CachedStream(self.mounted, all_nodes),
            "cached, sparse": CachedStream(self.mounted, self.network),
        }
