"""The paper's network: an EGNN on the graph of all taxels, then the window.

From the paper: a node for every taxel, its pressure the node's feature (section
IV-C1); the kinematic distance as the edges' feature (IV-C2); K nearest neighbours
(K = 8), those inside a patch known beforehand and those of triggered taxels found live
(IV-C4); layers after Satorras et al. 2021 (its eq. 2); 100 graphs a window (IV-C3);
maximum over the nodes (V-A). It gives neither widths nor depth nor what follows the
pooling: three layers of width 32, as ours has, and two convolutions over time are our
choice.

The paper puts each taxel's pose from forward kinematics, a frame whose z axis is the
outward normal, into the node's feature too (IV-C1), and calls the x of its equation 2
"poses". It does not say how; that equation adds, subtracts and measures x, as it can
positions, and a pose among the features would undo its equivariance. Ours takes the
position only, as x: normals are not looked at.
"""

from dataclasses import dataclass
from typing import Literal, final

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.learn.baselines.egnn_rows import Neighbourhood, Rows
from eskin.learn.baselines.flat import KPA
from eskin.learn.baselines.interface import TOUCHED
from eskin.learn.baselines.network import ReadingNetwork
from eskin.model import LENGTH_CM
from eskin.skin import MountedSkin

Pooling = Literal["max", "mean"]
WIDTH, LAYERS, CHANNELS, TAPS = 32, 3, 64, 5
UNIT = LENGTH_CM / 100.0
"""Lengths are in units of this [m]."""

AT_ONCE = 4
"""Readings encoded together: what one makes then stays in the cache."""


@dataclass(frozen=True, eq=False)
class Rest:
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
        r = x_i[:, None] - gather(x, j)
        edge = torch.stack([(r * r).sum(dim=-1), lengths], dim=-1)
        hidden = self.of_target(v_i)[:, None] + gather(self.of_source(v), j)
        m = silu(self.message(silu(hidden + self.of_edge(edge)))) * heard
        step = self.C * (r * self.move(m) * heard).sum(dim=1)
        return self.update(torch.cat([v_i, m.sum(dim=1)], dim=1)), x_i + step


def gather(
    values: Float[Tensor, "row channel"], places: Int[Tensor, "target k"]
) -> Float[Tensor, "target k channel"]:
    """Rows of some nodes; its gradient is a plain sum, unlike that of indexing."""
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
        self.rest: Rest | None = None
        self.neighbourhood = Neighbourhood(mounted, k)
        self.links = torch.from_numpy(mounted.skin_link_index)
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
        for some in computed.split(AT_ONCE):
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
        rest: Rest,
    ) -> Float[Tensor, "reading width"]:
        """Features of readings computed together, their pressure in `KPA`."""
        T = self.mounted.kinematics.poses(q.double().numpy())
        T[..., :3, 3] /= UNIT
        T_world_link = torch.from_numpy(T).to(self.positions.dtype)
        rows = self.neighbourhood.rows(felt > 0, q, LAYERS, self.whole)
        T_row = T_world_link[rows.reading, self.links[rows.node]]
        rotation, origin = T_row[:, :3, :3], T_row[:, :3, 3]
        v = self.embed(felt[rows.reading, rows.node, None])
        x = turned(rotation, rest.x[0].index_select(0, rows.node)) + origin
        x_first, computed = x, v
        for n, (layer, step) in enumerate(zip(self.layers, rows.steps, strict=True), 1):
            apart = x_first[step.targets, None] - gather(x_first, step.sources.clamp(0))
            lengths = apart.norm(dim=-1)
            computed, moved = layer(v, x, lengths, step.targets, step.sources)
            v = rest.v[n].index_select(0, rows.node)
            v = v.index_copy(0, step.targets, computed)
            x = turned(rotation, rest.x[n].index_select(0, rows.node)) + origin
            x = x.index_copy(0, step.targets, moved)
        return self.pool_rows(computed, rows, rest.v[-1], len(felt))

    def pool_rows(
        self,
        computed: Float[Tensor, "target width"],
        rows: Rows,
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

    def at_rest(self) -> Rest:
        """What every layer gives for a skin that nobody touches."""
        x, table = self.positions, self.neighbourhood.table
        everyone = torch.arange(len(x))
        v = self.embed(torch.zeros_like(x[:, :1]))
        rest = Rest([v], [x])
        apart = x[:, None] - gather(x, table.clamp(min=0))
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


def turned(
    rotation: Float[Tensor, "row 3 3"], x: Float[Tensor, "row 3"]
) -> Float[Tensor, "row 3"]:
    """Each vector turned by its own rotation."""
    return (rotation @ x[..., None])[..., 0]
