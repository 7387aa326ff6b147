"""This module defines encoders for ablations: each lacks one part of ours."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Literal, final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.learn.nn import Encoder, GraphTensors
from eskin.learn.nn.encoder import (
    Edges,
    build_edges,
    gather_rows,
)
from eskin.live import LENGTH_CM, NODE_SCALARS, NetworkConfig

EncoderKind = Literal["equivariant", "plain", "max", "mean"]


@final
class PlainLayer(nn.Module):
    """This layer is as large as ours, but its messages are of plain coordinates."""

    def __init__(self, width: int) -> None:
        """Create a layer of `width` channels."""
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
        """Return the features after the layer; `x` is in units of `LENGTH_CM`."""
        i, j = edges.targets, edges.sources
        r = x.index_select(0, i)[:, None] - gather_rows(x, j)
        n_i = normals[i, None].expand_as(r)
        e = torch.cat([r, n_i, gather_rows(normals, j)], dim=-1)
        u = self.norm(v)
        u_i = u.index_select(0, i)
        hidden = self.of_target(u_i)[:, None] + gather_rows(self.of_source(u), j)
        m = silu(self.message(silu(hidden + self.of_edge(e))))
        messages = (m * edges.weights[..., None]).sum(dim=1)
        update = silu(self.update_hidden(torch.cat([u_i, messages], dim=1)))
        return v.index_add(0, i, self.update_out(update))


@final
class PlainEncoder(Encoder):
    """This encoder is not equivariant: it uses directions in the world.

    Coordinates are relative to the touch's centre, so it is invariant to translations.
    """

    def __init__(self, config: NetworkConfig) -> None:
        """Create the encoder."""
        super().__init__(config)
        self.embed = nn.Linear(len(NODE_SCALARS) + 6, config.width)
        layers = (PlainLayer(config.width) for _ in range(config.layers))
        self.layers = nn.ModuleList(layers)

    def forward(self, graphs: GraphTensors) -> Float[Tensor, "reading embedding"]:
        """Embed every reading."""
        x = graphs.positions / LENGTH_CM
        v = silu(self.embed(torch.cat([graphs.scalars, x, graphs.normals], dim=1)))
        edges = build_edges(graphs.areas, graphs.targets, graphs.sources)
        for layer in self.layers:
            v = layer(v, x, graphs.normals, edges)
        return self.pool(v, graphs)


@final
class OnePoolEncoder(Encoder):
    """This encoder pools in one way only, repeated to keep all sizes the same."""

    def __init__(self, config: NetworkConfig, kept: Literal["max", "mean"]) -> None:
        """Create the encoder with the pooling to keep."""
        super().__init__(config)
        self.kept = kept

    def combine(
        self,
        largest: Float[Tensor, "reading width"],
        mean: Float[Tensor, "reading width"],
    ) -> Float[Tensor, "reading embedding"]:
        """Return one of the two poolings, twice."""
        one = largest if self.kept == "max" else mean
        return torch.cat([one, one], dim=1)


ENCODERS: Mapping[EncoderKind, Callable[[NetworkConfig], Encoder]] = {
    "equivariant": Encoder,
    "plain": PlainEncoder,
    "max": partial(OnePoolEncoder, kept="max"),
    "mean": partial(OnePoolEncoder, kept="mean"),
}
"""Encoders by name; the first one is ours."""
