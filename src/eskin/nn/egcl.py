"""The equivariant graph convolutional layer (Satorras, Hoogeboom and Welling 2021)."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import silu

EDGE_SCALARS = 6


@dataclass(frozen=True)
class Edges:
    """Who hears whom."""

    targets: Int[Tensor, "target"]
    """Nodes that hear others."""
    sources: Int[Tensor, "target k"]
    """Nodes that each of these hears; any where the weight is zero."""
    weights: Float[Tensor, "target k"]
    """Share of each source in the area that its target hears."""


class EquivariantLayer(nn.Module):
    """One EGCL: messages from invariants, then coordinates and features move.

    m_ij = phi_e(v_i, v_j, |x_i - x_j|^2, e_ij)                     (their eq. 3)
    x_i <- x_i + sum_j w_ij (x_i - x_j) tanh(phi_x(m_ij))           (eq. 4, bounded)
    m_i = sum_j w_ij m_ij                                           (eq. 5, weighted)
    v_i <- v_i + phi_h(v_i, m_i)                                    (eq. 6, residual)

    The weights w_ij are shares of area and sum to one, so a denser skin sends no louder
    messages. e_ij are invariants of the relative pose of the two taxels and of their
    shear. phi_e's first layer is split into a part of i, a part of j and a part of the
    edge, so that the first two are computed once a node.
    """

    def __init__(self, width: int, last: bool) -> None:
        """Make a layer of `width` channels; the last one moves nothing."""
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
        """Return features and coordinates after one step.

        Args:
            v: invariant features of the nodes.
            x: coordinates of the nodes, in units of `LENGTH_CM`.
            normals: outward unit normals.
            shear: compressed shear traction.
            edges: who hears whom; who hears nobody stays as it is.
        """
        i, j = edges.targets, edges.sources
        r = x.index_select(0, i)[:, None] - gathered(x, j)
        e = edge_scalars(r, normals, shear, i, j)
        u = self.norm(v)
        u_i = u.index_select(0, i)
        hidden = self.of_target(u_i)[:, None] + gathered(self.of_source(u), j)
        m = silu(self.message(silu(hidden + self.of_edge(e))))
        heard = (m * edges.weights[..., None]).sum(dim=1)
        update = silu(self.update_hidden(torch.cat([u_i, heard], dim=1)))
        v = v.index_add(0, i, self.update_out(update))
        if self.move is not None:
            step = torch.tanh(self.move(m)) * edges.weights[..., None]
            x = x.index_add(0, i, (r * step).sum(dim=1))
        return v, x


def edge_scalars(
    r: Float[Tensor, "target k 3"],
    normals: Float[Tensor, "node 3"],
    shear: Float[Tensor, "node 3"],
    targets: Int[Tensor, "target"],
    sources: Int[Tensor, "target k"],
) -> Float[Tensor, "target k 6"]:
    """|r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of each edge; r = x_i - x_j."""
    n_i, n_j = normals[targets, None].expand_as(r), gathered(normals, sources)
    s_i, s_j = shear[targets, None].expand_as(r), gathered(shear, sources)
    pairs = ((r, r), (n_i, n_j), (n_i, r), (n_j, r), (s_i, r), (s_j, r))
    return torch.stack([(a * b).sum(dim=-1) for a, b in pairs], dim=-1)


def gathered(
    values: Float[Tensor, "node channel"], places: Int[Tensor, "target k"]
) -> Float[Tensor, "target k channel"]:
    """Rows of some nodes; its gradient is a plain sum, unlike that of indexing."""
    return values.index_select(0, places.flatten()).view(*places.shape, values.shape[1])


def edges_of(
    areas: Float[Tensor, "node"],
    targets: Int[Tensor, "target"],
    sources: Int[Tensor, "target k"],
) -> Edges:
    """The edges from `sources` to `targets`; -1 is nobody.

    Args:
        areas: of the nodes.
        targets: who hears.
        sources: nodes that each of these hears, or -1.
    """
    present = sources >= 0
    sources = sources.clamp(min=0)
    heard = areas[sources] * present
    shares = heard / heard.sum(dim=1, keepdim=True).clamp(min=1e-6)
    return Edges(targets, sources, shares)
