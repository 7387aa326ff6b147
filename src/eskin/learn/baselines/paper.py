"""The paper's network."""

from copy import copy
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.graph import FixedNeighbours, GraphConfig, find_live_neighbours
from eskin.learn.baselines.flat import KPA
from eskin.learn.baselines.interface import TOUCHED, BaselineStream, WindowStream
from eskin.learn.baselines.network import (
    CachedStream,
    FitConfig,
    NetworkBaseline,
    ReadingNetwork,
)
from eskin.model import LENGTH_CM
from eskin.skin import MountedSkin


@dataclass(frozen=True, eq=False)
class LayerStep:
    """What one layer computes; all other rows are as at rest after it."""

    targets: Int[Tensor, "target"]
    """ComputedNodes that are computed."""
    sources: Int[Tensor, "target k"]
    """ComputedNodes that each of these hears, or -1."""


@dataclass(frozen=True, eq=False)
class ComputedNodes:
    """The nodes of some readings that are computed, and those that they hear."""

    reading: Int[Tensor, "row"]
    """Of each row."""
    node: Int[Tensor, "row"]
    """The taxel of each row."""
    steps: list[LayerStep]
    """One a layer: what differs from rest spreads by one hop with each."""


@final
class NodeSelector:
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
    ) -> ComputedNodes:
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
                LayerStep(place[reading, node], torch.where(heard >= 0, sources, -1))
            )
        reading, node = needed.nonzero(as_tuple=True)
        return ComputedNodes(reading, node, steps)

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
                p_world, _ = self.mounted.place_taxels(
                    q[reading].double().numpy(), nodes
                )
                found = find_live_neighbours(
                    p_world,
                    patches,
                    self.rank[nodes],
                    config.live,
                    config.live_reach,
                )
                live[reading, nodes] = np.where(found >= 0, nodes[found], -1)
        widest = (live >= 0).any(axis=(0, 1)).sum()
        return torch.from_numpy(live[..., :widest])


Pooling = Literal["max", "mean"]
WIDTH, LAYERS, CHANNELS, TAPS = 32, 3, 64, 5
UNIT = LENGTH_CM / 100.0
"""Lengths are in units of this [m]."""

READINGS_AT_ONCE = 4
"""Readings encoded together: what one makes then stays in the cache."""


@dataclass(frozen=True, eq=False)
class RestState:
    """What every layer gives for a skin that nobody touches."""

    v: list[Float[Tensor, "taxel width"]]
    """Features before the first layer and after each."""
    x: list[Float[Tensor, "taxel 3"]]
    """Coordinates, in the frames of the links."""


class PaperLayer(nn.Module):
    """One EGCL, as the paper's equation 2 has it.

    m_ij = phi_e(v_i, v_j, |x_i - x_j|^2, e_ij), e_ij the kinematic distance
    x_i <- x_i + C sum_j (x_i - x_j) phi_x(m_ij), C = 1 / K
    v_i <- phi_h(v_i, sum_j m_ij)

    phi_e's first layer is split into parts of i, j and the edge, for speed.
    """

    def __init__(self, width: int, k: int) -> None:
        """Make a layer of `width` channels for `k` neighbours inside a patch."""
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
        """Features and coordinates of the targets after one step."""
        heard = (sources >= 0)[..., None]
        j = sources.clamp(min=0)
        x_i, v_i = x.index_select(0, targets), v.index_select(0, targets)
        r = x_i[:, None] - gather_rows(x, j)
        edge = torch.stack([(r * r).sum(dim=-1), lengths], dim=-1)
        hidden = self.of_target(v_i)[:, None] + gather_rows(self.of_source(v), j)
        m = silu(self.message(silu(hidden + self.of_edge(edge)))) * heard
        step = self.C * (r * self.move(m) * heard).sum(dim=1)
        return self.update(torch.cat([v_i, m.sum(dim=1)], dim=1)), x_i + step


def gather_rows(
    values: Float[Tensor, "row channel"], places: Int[Tensor, "target k"]
) -> Float[Tensor, "target k channel"]:
    """ComputedNodes of some nodes; its gradient is a plain sum, unlike that of indexing."""
    return values.index_select(0, places.flatten()).view(*places.shape, values.shape[1])


@final
class PaperNetwork(ReadingNetwork):
    """EGNN, pooling, convolutions over time.

    A taxel that is not touched reads zero, so a node farther than a layer's hops from
    all touched ones and from live edges is as at rest: equivariant layers make the same
    of it wherever its link is. With `whole`, all nodes are computed at every reading,
    as in the paper; without, only those that differ from rest, to the same result.

    Attributes:
        whole: whether all nodes are computed at every reading.
        rest: of these weights, where known; `forget` it when they change.
    """

    positions: Float[Tensor, "taxel 3"]

    def __init__(
        self, mounted: MountedSkin, classes: int, k: int, pooling: Pooling
    ) -> None:
        """Make a network for a skin on a robot.

        Args:
            mounted: the skin on its robot.
            classes: how many there are.
            k: neighbours a taxel inside its patch.
            pooling: over the nodes of a reading.
        """
        super().__init__()
        self.mounted, self.pooling, self.whole = mounted, pooling, False
        self.rest: RestState | None = None
        self.neighbourhood = NodeSelector(mounted, k)
        self.links = torch.from_numpy(mounted.taxel_link_index)
        positions = torch.from_numpy(mounted.skin.positions / UNIT)
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
        """Features of each reading."""
        pressure = pressure.to(self.positions.dtype)
        felt = torch.where(pressure >= TOUCHED, pressure / KPA, 0.0)
        rest = self.rest or self.at_rest()
        if not self.training:
            self.rest = rest
        computed = torch.arange(len(felt))
        if not self.whole:
            computed = computed[(felt > 0).any(dim=1)]
        features = self.pooled(rest.v[-1]).expand(len(felt), -1)
        for some in computed.split(READINGS_AT_ONCE):
            encoded = self.encode_some(felt[some], q[some], rest)
            features = features.index_copy(0, some, encoded)
        return features

    def train(self, mode: bool = True) -> "PaperNetwork":
        """Train or answer; what was known of these weights is forgotten."""
        self.rest = None
        return super().train(mode)

    def encode_some(
        self,
        felt: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
        rest: RestState,
    ) -> Float[Tensor, "reading width"]:
        """Features of readings computed together, their pressure in `KPA`."""
        T = self.mounted.kinematics.poses(q.double().numpy())
        T[..., :3, 3] /= UNIT
        T_world_link = torch.from_numpy(T).to(self.positions.dtype)
        rows = self.neighbourhood.rows(felt > 0, q, LAYERS, self.whole)
        T_row = T_world_link[rows.reading, self.links[rows.node]]
        rotation, origin = T_row[:, :3, :3], T_row[:, :3, 3]
        v = self.embed(felt[rows.reading, rows.node, None])
        x = rotate_rows(rotation, rest.x[0].index_select(0, rows.node)) + origin
        x_first, computed = x, v
        for n, (layer, step) in enumerate(zip(self.layers, rows.steps, strict=True), 1):
            apart = x_first[step.targets, None] - gather_rows(
                x_first, step.sources.clamp(0)
            )
            lengths = apart.norm(dim=-1)
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
        """Maximum or mean over all nodes of each reading."""
        taxels = len(rest)
        targets = rows.steps[-1].targets
        flat = rows.reading[targets] * taxels + rows.node[targets]
        every = rest.repeat(readings, 1).index_copy(0, flat, computed)
        return self.pooled(every.view(readings, *rest.shape))

    def pooled(
        self, nodes: Float[Tensor, "*reading taxel width"]
    ) -> Float[Tensor, "*reading width"]:
        """Maximum or mean over nodes."""
        return nodes.amax(dim=-2) if self.pooling == "max" else nodes.mean(dim=-2)

    def at_rest(self) -> RestState:
        """What every layer gives for a skin that nobody touches."""
        x, table = self.positions, self.neighbourhood.table
        everyone = torch.arange(len(x))
        v = self.embed(torch.zeros_like(x[:, :1]))
        rest = RestState([v], [x])
        apart = x[:, None] - gather_rows(x, table.clamp(min=0))
        for layer in self.layers:
            v, x = layer(v, x, apart.norm(dim=-1), everyone, table)
            rest.v.append(v)
            rest.x.append(x)
        return rest

    def classify(
        self, features: Float[Tensor, "clip 100 width"]
    ) -> Float[Tensor, "clip class"]:
        """Logits of each window."""
        return self.out(self.over_time(features.transpose(1, 2)))


def rotate_rows(
    rotation: Float[Tensor, "row 3 3"], x: Float[Tensor, "row 3"]
) -> Float[Tensor, "row 3"]:
    """Each vector turned by its own rotation."""
    return (rotation @ x[..., None])[..., 0]


@final
class PaperBaseline(NetworkBaseline):
    """The EGNN on all taxels and 100 graphs; see `eskin.learn.baselines.paper`."""

    def __init__(
        self,
        mounted: MountedSkin,
        config: FitConfig | None = None,
        k: int = 8,
        pooling: Pooling = "max",
    ) -> None:
        """Make one that knows nothing yet.

        Args:
            mounted: the skin on its robot.
            config: how it is trained.
            k: neighbours a taxel inside its patch.
            pooling: over the nodes of a reading.
        """
        super().__init__(mounted, config)
        self.k = k
        self.pooling: Pooling = pooling

    def build(self) -> PaperNetwork:
        """Make the network."""
        return PaperNetwork(self.mounted, self.classes, self.k, self.pooling)

    def on(self, mounted: MountedSkin) -> "PaperBaseline":
        """The same weights on a skin that lies elsewhere."""
        assert isinstance(self.network, PaperNetwork)
        other = copy(self)
        other.mounted = mounted
        network = other.build()
        places = {"positions": network.positions}
        network.load_state_dict(self.network.state_dict() | places)
        other.network = network.eval()
        return other

    def streams(self) -> dict[str, BaselineStream]:
        """All nodes of 100 graphs, of the newest graph, and only what a touch changes.

        The first is what the paper describes.
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
