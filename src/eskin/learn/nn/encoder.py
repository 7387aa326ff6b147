"""This module defines the equivariant encoder of contact graphs."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.learn.nn.batch import GraphTensors
from eskin.live import EDGE_SCALARS, LENGTH_CM, NODE_SCALARS, NetworkConfig


@dataclass(frozen=True)
class Edges:
    """Edges of a batch of graphs are listed by target."""

    targets: Int[Tensor, "target"]
    """Nodes that receive messages."""
    sources: Int[Tensor, "target k"]
    """Nodes that send a message to each target; arbitrary where the weight is zero."""
    weights: Float[Tensor, "target k"]
    """Share of each source in the area of all sources of its target."""


class EquivariantLayer(nn.Module):
    """A layer computes messages from invariants, then updates coordinates and features.

    It is the EGCL of Satorras, Hoogeboom and Welling (2021), which is eq. (2) of Jiang
    et al. 2025, with changes:

    m_ij = phi_e(v_i, v_j, |x_i - x_j|^2, e_ij)                     (their eq. 3)
    x_i <- x_i + sum_j w_ij (x_i - x_j) tanh(phi_x(m_ij))           (eq. 4, bounded)
    m_i = sum_j w_ij m_ij                                           (eq. 5, weighted)
    v_i <- v_i + phi_h(v_i, m_i)                                    (eq. 6, residual)

    The weights w_ij are shares of area and sum to one, so that messages do not grow
    with the density of a skin. e_ij are invariants of the relative pose of the two
    taxels and of their shear. phi_e's first layer is split into a part of i, a part of
    j and a part of the edge, so that the first two are computed once per node.
    """

    def __init__(self, width: int, last: bool) -> None:
        """Create a layer of `width` channels; the last one updates no coordinates."""
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.of_target = nn.Linear(width, width)
        self.of_source = nn.Linear(width, width, bias=False)
        self.of_edge = nn.Linear(EDGE_SCALARS, width, bias=False)
        self.message = nn.Linear(width, width)
        self.move = None if last else nn.Linear(width, 1, bias=False)
        self.update_hidden = nn.Linear(2 * width, width)
        self.update_out = nn.Linear(width, width)

    def forward(
        self,
        v: Float[Tensor, "node width"],
        x: Float[Tensor, "node 3"],
        normals: Float[Tensor, "node 3"],
        shear: Float[Tensor, "node 3"],
        edges: Edges,
    ) -> tuple[Float[Tensor, "node width"], Float[Tensor, "node 3"]]:
        """Return the features and coordinates after the layer.

        Args:
            v: invariant features of the nodes.
            x: coordinates of the nodes, in units of `LENGTH_CM`.
            normals: outward unit normals.
            shear: compressed shear traction.
            edges: edges; nodes that are no target keep their values.
        """
        i, j = edges.targets, edges.sources
        r = x.index_select(0, i)[:, None] - gather_rows(x, j)
        e = compute_edge_features(r, normals, shear, i, j)
        u = self.norm(v)
        u_i = u.index_select(0, i)
        hidden = self.of_target(u_i)[:, None] + gather_rows(self.of_source(u), j)
        m = silu(self.message(silu(hidden + self.of_edge(e))))
        messages = (m * edges.weights[..., None]).sum(dim=1)
        update = silu(self.update_hidden(torch.cat([u_i, messages], dim=1)))
        v = v.index_add(0, i, self.update_out(update))
        if self.move is not None:
            coord_weights = torch.tanh(self.move(m)) * edges.weights[..., None]
            x = x.index_add(0, i, (r * coord_weights).sum(dim=1))
        return v, x


def compute_edge_features(
    r: Float[Tensor, "target k 3"],
    normals: Float[Tensor, "node 3"],
    shear: Float[Tensor, "node 3"],
    targets: Int[Tensor, "target"],
    sources: Int[Tensor, "target k"],
) -> Float[Tensor, "target k 6"]:
    """Return |r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of edges; r = x_i - x_j.

    The first is the kinematic distance; with the next three it is the relative pose,
    which Jiang et al. 2025 (section IV-C2) name as an alternative to it alone.
    """
    n_i = normals[targets, None].expand_as(r)
    n_j = gather_rows(normals, sources)
    s_i = shear[targets, None].expand_as(r)
    s_j = gather_rows(shear, sources)
    pairs = ((r, r), (n_i, n_j), (n_i, r), (n_j, r), (s_i, r), (s_j, r))
    return torch.stack([(a * b).sum(dim=-1) for a, b in pairs], dim=-1)


def gather_rows(
    values: Float[Tensor, "node channel"], nodes: Int[Tensor, "target k"]
) -> Float[Tensor, "target k channel"]:
    """Return rows of some nodes; the gradient is faster than by indexing."""
    return values.index_select(0, nodes.flatten()).view(*nodes.shape, values.shape[1])


def build_edges(
    areas: Float[Tensor, "node"],
    targets: Int[Tensor, "target"],
    sources: Int[Tensor, "target k"],
) -> Edges:
    """Build the edges from `sources` to `targets`; a source of -1 is no edge."""
    present = sources >= 0
    sources = sources.clamp(min=0)
    area = areas[sources] * present
    weights = area / area.sum(dim=1, keepdim=True).clamp(min=1e-6)
    return Edges(targets, sources, weights)


class Encoder(nn.Module):
    """An encoder computes embeddings of contact graphs: equivariant layers, pooling.

    The pooling is a maximum and a force-weighted mean over active taxels. Only active
    taxels receive messages; neighbours at rest send messages but keep their features,
    which saves two thirds of the work without loss of accuracy.
    The embedding is invariant to motions and mirror images of the whole scene, which is
    eq. (1) of Jiang et al. 2025 where S_g changes nothing, and to the order of the
    taxels. A reading without contact is embedded as zeros.
    """

    def __init__(self, config: NetworkConfig) -> None:
        """Create an encoder."""
        super().__init__()
        self.embed = nn.Linear(len(NODE_SCALARS), config.width)
        self.layers = nn.ModuleList(
            EquivariantLayer(config.width, last=n == config.layers - 1)
            for n in range(config.layers)
        )
        self.norm = nn.LayerNorm(2 * config.width)

    @property
    def size(self) -> int:
        """Number of channels of the embedding."""
        return self.norm.normalized_shape[0]

    def forward(self, graphs: GraphTensors) -> Float[Tensor, "reading embedding"]:
        """Embed every reading."""
        v = silu(self.embed(graphs.scalars))
        x = graphs.positions / LENGTH_CM
        edges = build_edges(graphs.areas, graphs.targets, graphs.sources)
        for layer in self.layers:
            v, x = layer(v, x, graphs.normals, graphs.shear, edges)
        return self.pool(v, graphs)

    def pool(
        self, v: Float[Tensor, "node width"], graphs: GraphTensors
    ) -> Float[Tensor, "reading embedding"]:
        """Return the normalised maximum and force-weighted mean over active nodes.

        Fig. 11 of Jiang et al. 2025 compares the maximum with the mean over all nodes.
        """
        readings = len(graphs.summary)
        force = torch.zeros(readings, dtype=v.dtype)
        force = force.index_add(0, graphs.graph_index, graphs.forces)
        share = graphs.forces / force.clamp(min=1e-6)[graphs.graph_index]
        mean = torch.zeros(readings, v.shape[1], dtype=v.dtype)
        mean = mean.index_add(0, graphs.graph_index, v * share[:, None])
        largest = torch.full_like(mean, -torch.inf)
        index = graphs.graph_index[graphs.targets][:, None].expand(-1, v.shape[1])
        largest = largest.scatter_reduce(0, index, v[graphs.targets], "amax")
        touched = (force > 0)[:, None]
        pooled = torch.cat([torch.where(touched, largest, 0.0), mean], dim=1)
        return torch.where(touched, self.norm(pooled), 0.0)
