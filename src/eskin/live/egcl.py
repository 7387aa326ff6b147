"""The equivariant layer of `eskin.nn`, in numpy."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.live.layers import LayerNorm, Linear, Weights, silu


@dataclass(frozen=True, eq=False)
class Edges:
    """Who hears whom."""

    targets: Int[np.ndarray, "target"]
    """Nodes that hear others."""
    sources: Int[np.ndarray, "target k"]
    """Nodes that each of these hears; any where the weight is zero."""
    weights: Float[np.ndarray, "target k"]
    """Share of each source in the area that its target hears."""


@final
class EquivariantLayer:
    """One step of `eskin.nn.EquivariantLayer`, line by line the same."""

    def __init__(self, weights: Weights) -> None:
        """Take the layer's own weights; the last one has none to move by."""
        self.norm = LayerNorm.of(weights, "norm")
        self.of_target = Linear.of(weights, "of_target")
        self.of_source = Linear.of(weights, "of_source")
        self.of_edge = Linear.of(weights, "of_edge")
        self.message = Linear.of(weights, "message")
        moves = "move.weight" in weights
        self.move = Linear.of(weights, "move") if moves else None
        self.update_hidden = Linear.of(weights, "update_hidden")
        self.update_out = Linear.of(weights, "update_out")

    def __call__(
        self,
        v: Float[np.ndarray, "node width"],
        x: Float[np.ndarray, "node 3"],
        normals: Float[np.ndarray, "node 3"],
        shear: Float[np.ndarray, "node 3"],
        edges: Edges,
    ) -> tuple[Float[np.ndarray, "node width"], Float[np.ndarray, "node 3"]]:
        """Features and coordinates after the step.

        Args:
            v: invariant features of the nodes.
            x: coordinates of the nodes, in units of `LENGTH_CM`.
            normals: outward unit normals.
            shear: compressed shear traction.
            edges: who hears whom; who hears nobody stays as it is.
        """
        i, j = edges.targets, edges.sources
        r = x[i, None] - x[j]
        e = edge_scalars(r, normals, shear, i, j)
        u = self.norm(v)
        hidden = self.of_target(u[i])[:, None] + self.of_source(u)[j]
        m = silu(self.message(silu(hidden + self.of_edge(e))))
        gathered = (m * edges.weights[..., None]).sum(axis=1)
        update = silu(self.update_hidden(np.concatenate([u[i], gathered], axis=1)))
        v = v.copy()
        v[i] += self.update_out(update)
        if self.move is not None:
            step = np.tanh(self.move(m)) * edges.weights[..., None]
            x = x.copy()
            x[i] += (r * step).sum(axis=1)
        return v, x


def edge_scalars(
    r: Float[np.ndarray, "target k 3"],
    normals: Float[np.ndarray, "node 3"],
    shear: Float[np.ndarray, "node 3"],
    targets: Int[np.ndarray, "target"],
    sources: Int[np.ndarray, "target k"],
) -> Float[np.ndarray, "target k 6"]:
    """|r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of each edge; r = x_i - x_j."""
    n_i, n_j = normals[targets, None], normals[sources]
    s_i, s_j = shear[targets, None], shear[sources]
    pairs = ((r, r), (n_i, n_j), (n_i, r), (n_j, r), (s_i, r), (s_j, r))
    return np.stack([(a * b).sum(axis=-1) for a, b in pairs], axis=-1)


def edges_of(
    areas: Float[np.ndarray, "node"],
    targets: Int[np.ndarray, "target"],
    sources: Int[np.ndarray, "target k"],
) -> Edges:
    """The edges from `sources` to `targets`; -1 is nobody.

    Args:
        areas: of the nodes.
        targets: who hears.
        sources: nodes that each of these hears, or -1.
    """
    present = sources >= 0
    sources = np.maximum(sources, 0)
    heard = areas[sources] * present
    shares = heard / np.maximum(heard.sum(axis=1, keepdims=True), 1e-6)
    return Edges(targets, sources, shares)
