"""The equivariant graph convolutional layer (Satorras, Hoogeboom and Welling 2021)."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import silu

EDGE_SCALARS = 6


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

    def __init__(self, width: int) -> None:
        """Make a layer of `width` channels."""
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.of_target = nn.Linear(width, width)
        self.of_source = nn.Linear(width, width, bias=False)
        self.of_edge = nn.Linear(EDGE_SCALARS, width, bias=False)
        self.message = nn.Linear(width, width)
        self.move = nn.Linear(width, 1, bias=False)
        self.update_hidden = nn.Linear(2 * width, width)
        self.update_out = nn.Linear(width, width)

    def forward(
        self,
        v: Float[Tensor, "node width"],
        x: Float[Tensor, "node 3"],
        normals: Float[Tensor, "node 3"],
        shear: Float[Tensor, "node 3"],
        sources: Int[Tensor, "node k"],
        weights: Float[Tensor, "node k"],
    ) -> tuple[Float[Tensor, "node width"], Float[Tensor, "node 3"]]:
        """Return features and coordinates after one step.

        Args:
            v: invariant features of the nodes.
            x: coordinates of the nodes, in units of `LENGTH_CM`.
            normals: outward unit normals.
            shear: compressed shear traction.
            sources: nodes that each node hears; any where the weight is zero.
            weights: share of each source.
        """
        r = x[:, None] - x[sources]
        e = edge_scalars(r, normals, shear, sources)
        u = self.norm(v)
        hidden = self.of_target(u)[:, None] + self.of_source(u)[sources]
        m = silu(self.message(silu(hidden + self.of_edge(e))))
        step = torch.tanh(self.move(m)) * weights[..., None]
        gathered = (m * weights[..., None]).sum(dim=1)
        update = silu(self.update_hidden(torch.cat([u, gathered], dim=1)))
        return v + self.update_out(update), x + (r * step).sum(dim=1)


def edge_scalars(
    r: Float[Tensor, "node k 3"],
    normals: Float[Tensor, "node 3"],
    shear: Float[Tensor, "node 3"],
    sources: Int[Tensor, "node k"],
) -> Float[Tensor, "node k 6"]:
    """|r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of each edge; r = x_i - x_j."""
    n_i, n_j = normals[:, None].expand_as(r), normals[sources]
    s_i, s_j = shear[:, None].expand_as(r), shear[sources]
    pairs = ((r, r), (n_i, n_j), (n_i, r), (n_j, r), (s_i, r), (s_j, r))
    return torch.stack([(a * b).sum(dim=-1) for a, b in pairs], dim=-1)


def area_shares(
    areas: Float[Tensor, "node"], sources: Int[Tensor, "node k"]
) -> tuple[Int[Tensor, "node k"], Float[Tensor, "node k"]]:
    """Usable source indices, and each source's share of the area that a node hears."""
    present = sources >= 0
    sources = sources.clamp(min=0)
    heard = areas[sources] * present
    return sources, heard / heard.sum(dim=1, keepdim=True).clamp(min=1e-6)
