"""What the network is given: windows of readings, each with its contact graph."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.graph import (
    GraphBatch,
    compressed,
    node_scalars,
    pressure_summary,
    shear_summary,
)


@dataclass(frozen=True)
class GraphTensors:
    """Contact graphs with their features, one graph a reading, laid end to end."""

    scalars: Float[Tensor, "node scalar"]
    """See `eskin.graph.NODE_SCALARS`."""
    positions: Float[Tensor, "node 3"]
    """[cm]"""
    normals: Float[Tensor, "node 3"]
    """Outward unit normals."""
    shear: Float[Tensor, "node 3"]
    """Compressed shear traction."""
    forces: Float[Tensor, "node"]
    """Pressure times area, in any unit: weights of the mean over nodes."""
    areas: Float[Tensor, "node"]
    """[cm2]"""
    targets: Int[Tensor, "target"]
    """The active nodes: those that hear others."""
    sources: Int[Tensor, "target k"]
    """Nodes that each of these hears, or -1; columns that nobody uses are left out."""
    graph_index: Int[Tensor, "node"]
    """The reading of each node."""
    summary: Float[Tensor, "reading feature"]
    """Invariants of the whole touch at each reading."""


@dataclass(frozen=True)
class Places:
    """Where readings stand in windows, on the head's clock."""

    window: Int[Tensor, "reading"]
    """The window of each reading."""
    slot: Int[Tensor, "reading"]
    """Its place in the window; the last slot is now."""
    windows: int
    """Number of windows."""


@dataclass(frozen=True)
class NetworkInput:
    """A batch of windows: their readings' graphs, and where each reading stands."""

    graphs: GraphTensors
    """One graph a reading."""
    places: Places
    """One place a reading."""


def summary(batch: GraphBatch, shear: bool) -> Float[np.ndarray, "reading feature"]:
    """Pressure and, where the network takes it, shear summary of each graph."""
    parts = [pressure_summary(batch)] + ([shear_summary(batch)] if shear else [])
    return np.concatenate(parts, axis=1)


def graph_tensors(
    batch: GraphBatch, shear: bool, dtype: torch.dtype = torch.float32
) -> GraphTensors:
    """Compute the features of a batch of graphs.

    Args:
        batch: the contact graphs, one a reading.
        shear: whether the network takes shear; else it is left out.
        dtype: of the floating-point tensors.
    """
    vectors = compressed(batch.shear) if shear else np.zeros_like(batch.shear)
    scalars = node_scalars(batch)
    if not shear:
        scalars[:, -1] = 0.0

    def real(values: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(values), dtype=dtype)

    return GraphTensors(
        scalars=real(scalars),
        positions=real(batch.positions),
        normals=real(batch.normals),
        shear=real(vectors),
        forces=real(batch.pressure * batch.areas),
        areas=real(batch.areas),
        targets=whole(batch.targets),
        sources=whole(batch.sources),
        graph_index=whole(batch.graph_index),
        summary=real(summary(batch, shear)),
    )


def whole(values: np.ndarray) -> Tensor:
    """Indices for torch."""
    return torch.as_tensor(values.astype(np.int64))


def network_input(
    batch: GraphBatch,
    window: Int[np.ndarray, "reading"],
    slot: Int[np.ndarray, "reading"],
    windows: int,
    shear: bool,
    dtype: torch.dtype = torch.float32,
) -> NetworkInput:
    """The features of a batch of graphs, and the place of each in its window.

    Args:
        batch: the contact graphs, one a reading.
        window: the window that each belongs to.
        slot: its place in it on the head's clock.
        windows: how many windows there are.
        shear: whether the network takes shear; else it is left out.
        dtype: of the floating-point tensors.
    """
    places = Places(whole(window), whole(slot), windows)
    return NetworkInput(graph_tensors(batch, shear, dtype), places)
