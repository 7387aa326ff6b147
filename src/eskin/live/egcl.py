"""The equivariant layer of `eskin.nn`, in numpy."""

from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.live.layers import LayerNorm, Linear, Weights, silu


@final
class EquivariantLayer:
    """One step of `eskin.nn.EquivariantLayer`, line by line the same."""

    def __init__(self, weights: Weights) -> None:
        """Take the layer's own weights."""
        self.norm = LayerNorm.of(weights, "norm")
        self.of_target = Linear.of(weights, "of_target")
        self.of_source = Linear.of(weights, "of_source")
        self.of_edge = Linear.of(weights, "of_edge")
        self.message = Linear.of(weights, "message")
        self.move = Linear.of(weights, "move")
        self.update_hidden = Linear.of(weights, "update_hidden")
        self.update_out = Linear.of(weights, "update_out")

    def __call__(
        self,
        v: Float[np.ndarray, "node width"],
        x: Float[np.ndarray, "node 3"],
        normals: Float[np.ndarray, "node 3"],
        shear: Float[np.ndarray, "node 3"],
        sources: Int[np.ndarray, "node k"],
        weights: Float[np.ndarray, "node k"],
    ) -> tuple[Float[np.ndarray, "node width"], Float[np.ndarray, "node 3"]]:
        """Features and coordinates after the step.

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
        step = np.tanh(self.move(m)) * weights[..., None]
        gathered = (m * weights[..., None]).sum(axis=1)
        update = silu(self.update_hidden(np.concatenate([u, gathered], axis=1)))
        return v + self.update_out(update), x + (r * step).sum(axis=1)


def edge_scalars(
    r: Float[np.ndarray, "node k 3"],
    normals: Float[np.ndarray, "node 3"],
    shear: Float[np.ndarray, "node 3"],
    sources: Int[np.ndarray, "node k"],
) -> Float[np.ndarray, "node k 6"]:
    """|r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of each edge; r = x_i - x_j."""
    n_i, n_j = normals[:, None], normals[sources]
    s_i, s_j = shear[:, None], shear[sources]
    pairs = ((r, r), (n_i, n_j), (n_i, r), (n_j, r), (s_i, r), (s_j, r))
    return np.stack([(a * b).sum(axis=-1) for a, b in pairs], axis=-1)


def area_shares(
    areas: Float[np.ndarray, "node"], sources: Int[np.ndarray, "node k"]
) -> tuple[Int[np.ndarray, "node k"], Float[np.ndarray, "node k"]]:
    """Usable source indices, and each source's share of the area that a node hears."""
    present = sources >= 0
    sources = np.maximum(sources, 0)
    heard = areas[sources] * present
    return sources, heard / np.maximum(heard.sum(axis=1, keepdims=True), 1e-6)
