"""From the contact graph of a reading to its embedding."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import silu

from eskin.graph import NODE_SCALARS
from eskin.model import LENGTH_CM, NetworkConfig
from eskin.nn.batch import GraphTensors
from eskin.nn.egcl import EquivariantLayer, edges_of


class Encoder(nn.Module):
    """Equivariant layers, then a maximum and a force-weighted mean over active taxels.

    Only active taxels hear others; their neighbours at rest are heard but stay as they
    are, since nothing changes there. That is a third of the work and loses nothing.
    The embedding is invariant to motions and mirror images of the whole scene and to
    the order of the taxels. A reading without contact is embedded as zeros.
    """

    def __init__(self, config: NetworkConfig) -> None:
        """Make an encoder."""
        super().__init__()
        self.embed = nn.Linear(len(NODE_SCALARS), config.width)
        self.layers = nn.ModuleList(
            EquivariantLayer(config.width, last=n == config.layers - 1)
            for n in range(config.layers)
        )
        self.norm = nn.LayerNorm(2 * config.width)

    @property
    def size(self) -> int:
        """Channels of the embedding."""
        return self.norm.normalized_shape[0]

    def forward(self, graphs: GraphTensors) -> Float[Tensor, "reading embedding"]:
        """Embed every reading."""
        v = silu(self.embed(graphs.scalars))
        x = graphs.positions / LENGTH_CM
        edges = edges_of(graphs.areas, graphs.targets, graphs.sources)
        for layer in self.layers:
            v, x = layer(v, x, graphs.normals, graphs.shear, edges)
        return self.pool(v, graphs)

    def pool(
        self, v: Float[Tensor, "node width"], graphs: GraphTensors
    ) -> Float[Tensor, "reading embedding"]:
        """Largest and force-weighted mean feature of each reading's active nodes."""
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
        pooled = self.pooled(torch.where(touched, largest, 0.0), mean)
        return torch.where(touched, self.norm(pooled), 0.0)

    def pooled(
        self,
        largest: Float[Tensor, "reading width"],
        mean: Float[Tensor, "reading width"],
    ) -> Float[Tensor, "reading embedding"]:
        """Both ways of pooling beside each other."""
        return torch.cat([largest, mean], dim=1)
