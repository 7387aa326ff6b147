"""The encoder of `eskin.nn`, in numpy."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphBatch, compressed, node_scalars
from eskin.graph.segments import segment_max, segment_sum
from eskin.live.egcl import EquivariantLayer, edges_of
from eskin.live.layers import LayerNorm, Linear, Weights, silu, under
from eskin.model import LENGTH_CM


@final
class Encoder:
    """Contact graphs to embeddings, as `eskin.nn.Encoder` does it."""

    def __init__(self, weights: Weights, layers: int, shear: bool) -> None:
        """Take the encoder's own weights."""
        self.shear = shear
        self.embed = Linear.of(weights, "embed")
        self.layers = [
            EquivariantLayer(under(weights, f"layers.{n}")) for n in range(layers)
        ]
        self.norm = LayerNorm.of(weights, "norm")

    def __call__(self, batch: GraphBatch) -> Float[np.ndarray, "graph embedding"]:
        """Embed every graph; one without contact as zeros."""
        scalars, shear = node_scalars(batch), compressed(batch.shear)
        if not self.shear:
            scalars[:, -1], shear = 0.0, np.zeros_like(shear)
        v = silu(self.embed(scalars))
        x = batch.positions / LENGTH_CM
        edges = edges_of(batch.areas, batch.targets, batch.sources)
        for layer in self.layers:
            v, x = layer(v, x, batch.normals, shear, edges)
        return self.pool(v, batch)

    def pool(
        self, v: Float[np.ndarray, "node width"], batch: GraphBatch
    ) -> Float[np.ndarray, "graph embedding"]:
        """Largest and force-weighted mean feature of each graph's active nodes."""
        forces = batch.pressure * batch.areas
        force = segment_sum(forces, batch.offsets)
        share = forces / np.maximum(force, 1e-6)[batch.graph_index]
        mean = segment_sum(v * share[:, None], batch.offsets)
        active = np.where((forces > 0)[:, None], v, -np.inf)
        touched = (force > 0)[:, None]
        largest = np.where(touched, segment_max(active, batch.offsets), 0.0)
        pooled = np.concatenate([largest, mean], axis=1)
        return np.where(touched, self.norm(pooled), 0.0)
