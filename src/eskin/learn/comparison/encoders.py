"""Encoders that lack something ours has, to see what it is worth."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Literal, final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.graph import NODE_SCALARS
from eskin.model import LENGTH_CM, NetworkConfig
from eskin.nn import Encoder, GraphTensors
from eskin.nn.encoder import Edges, build_edges, gather_rows

EncoderKind = Literal["equivariant", "plain", "max", "mean"]


@final
class PlainLayer(nn.Module):
    """As large as an `EquivariantLayer`, but its messages see plain coordinates."""

    def __init__(self, width: int) -> None:
        """Make a layer of `width` channels."""
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.of_target = nn.Linear(width, width)
        self.of_source = nn.Linear(width, width, bias=False)
        self.of_edge = nn.Linear(9, width, bias=False)
        self.message = nn.Linear(width, width)
        self.update_hidden = nn.Linear(2 * width, width)
        self.update_out = nn.Linear(width, width)

    def forward(
        self,
        v: Float[Tensor, "node width"],
        x: Float[Tensor, "node 3"],
        normals: Float[Tensor, "node 3"],
        edges: Edges,
    ) -> Float[Tensor, "node width"]:
        """Features after one step.

        Args:
            v: features of the nodes.
            x: coordinates about the middle of the touch, in the directions of the
                world, in units of `LENGTH_CM`.
            normals: outward unit normals in the world.
            edges: who hears whom.
        """
        i, j = edges.targets, edges.sources
        r = x.index_select(0, i)[:, None] - gather_rows(x, j)
        n_i = normals[i, None].expand_as(r)
        e = torch.cat([r, n_i, gather_rows(normals, j)], dim=-1)
        u = self.norm(v)
        u_i = u.index_select(0, i)
        hidden = self.of_target(u_i)[:, None] + gather_rows(self.of_source(u), j)
        m = silu(self.message(silu(hidden + self.of_edge(e))))
        heard = (m * edges.weights[..., None]).sum(dim=1)
        update = silu(self.update_hidden(torch.cat([u_i, heard], dim=1)))
        return v.index_add(0, i, self.update_out(update))


@final
class PlainEncoder(Encoder):
    """Sees directions in the world: the same touch, turned, is another one to it.

    Where in the world it is, it does not see: coordinates are about its middle.
    """

    def __init__(self, config: NetworkConfig) -> None:
        """Make an encoder."""
        super().__init__(config)
        self.embed = nn.Linear(len(NODE_SCALARS) + 6, config.width)
        layers = (PlainLayer(config.width) for _ in range(config.layers))
        self.layers = nn.ModuleList(layers)

    def forward(self, graphs: GraphTensors) -> Float[Tensor, "reading embedding"]:
        """Embed every reading."""
        x = graphs.positions / LENGTH_CM
        seen = torch.cat([graphs.scalars, x, graphs.normals], dim=1)
        v = silu(self.embed(seen))
        edges = build_edges(graphs.areas, graphs.targets, graphs.sources)
        for layer in self.layers:
            v = layer(v, x, graphs.normals, edges)
        return self.pool(v, graphs)


@final
class OnePoolEncoder(Encoder):
    """Pools in one way only, and says it twice so that all else is as large."""

    def __init__(self, config: NetworkConfig, kept: Literal["max", "mean"]) -> None:
        """Make an encoder that keeps one of the two ways."""
        super().__init__(config)
        self.kept = kept

    def pooled(
        self,
        largest: Float[Tensor, "reading width"],
        mean: Float[Tensor, "reading width"],
    ) -> Float[Tensor, "reading embedding"]:
        """One of them, twice."""
        one = largest if self.kept == "max" else mean
        return torch.cat([one, one], dim=1)


ENCODERS: Mapping[EncoderKind, Callable[[NetworkConfig], Encoder]] = {
    "equivariant": Encoder,
    "plain": PlainEncoder,
    "max": partial(OnePoolEncoder, kept="max"),
    "mean": partial(OnePoolEncoder, kept="mean"),
}
"""By what sets them apart; the first is ours."""
