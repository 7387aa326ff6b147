"""This module computes the network's input: windows of readings and their graphs."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.live import (
    GraphBatch,
    compress_shear,
    compute_node_scalars,
    compute_summary,
)


@dataclass(frozen=True)
class GraphTensors:
    """Graph tensors hold the features of contact graphs, one graph per reading."""

    scalars: Float[Tensor, "node scalar"]
    """Columns `eskin.live.NODE_SCALARS`."""
    positions: Float[Tensor, "node 3"]
    """Positions [cm]."""
    normals: Float[Tensor, "node 3"]
    """Outward unit normals."""
    shear: Float[Tensor, "node 3"]
    """Compressed shear traction."""
    forces: Float[Tensor, "node"]
    """Pressure times area in any unit, the weights of the mean over nodes."""
    areas: Float[Tensor, "node"]
    """Areas [cm2]."""
    targets: Int[Tensor, "target"]
    """Active nodes, the only ones that receive messages."""
    sources: Int[Tensor, "target k"]
    """Nodes that send a message to each target, or -1."""
    graph_index: Int[Tensor, "node"]
    """Index of the reading of each node."""
    summary: Float[Tensor, "reading feature"]
    """Invariant features of the whole touch at each reading."""


@dataclass(frozen=True)
class SlotIndex:
    """An index gives the window and the time slot of each reading."""

    window: Int[Tensor, "reading"]
    """Index of the window of each reading."""
    slot: Int[Tensor, "reading"]
    """Slot in the window; the last slot is now."""
    windows: int
    """Number of windows."""


@dataclass(frozen=True)
class NetworkInput:
    """An input holds the graphs of the readings of a batch of windows."""

    graphs: GraphTensors
    """One graph per reading."""
    slot_index: SlotIndex
    """Window and slot of each reading."""


def build_graph_tensors(
    batch: GraphBatch, shear: bool, dtype: torch.dtype = torch.float32
) -> GraphTensors:
    """Compute the features of a batch of graphs.

    Args:
        batch: contact graphs, one per reading.
        shear: whether the network uses shear.
        dtype: type of the floating-point tensors.
    """
    vectors = compress_shear(batch.shear) if shear else np.zeros_like(batch.shear)
    scalars = compute_node_scalars(batch)
    if not shear:
        scalars[:, -1] = 0.0

    def real(values: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype)

    def indices(values: np.ndarray) -> Tensor:
        return torch.as_tensor(values.astype(np.int64))

    return GraphTensors(
        scalars=real(scalars),
        positions=real(batch.positions),
        normals=real(batch.normals),
        shear=real(vectors),
        forces=real(batch.pressure * batch.areas),
        areas=real(batch.areas),
        targets=indices(batch.targets),
        sources=indices(batch.sources),
        graph_index=indices(batch.graph_index),
        summary=real(compute_summary(batch, shear)),
    )
