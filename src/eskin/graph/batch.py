"""This module defines contact graphs and operations on batches of them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

HISTORY = (
    "age",
    "pause",
    "contacts",
    "travel",
    "farthest",
    "impulse",
    "peak force",
)
"""Columns of a history: time since onset [s], since the last contact [s], how often it
made contact, distance from where it began, now and at most [cm], force integrated over
time [N s], greatest force [N]. On a skin that is not calibrated all are zero."""

CM_PER_M = 100.0
NANOSECOND = 1e-9
NOTHING = np.zeros(len(HISTORY))


def segment_sum(
    values: Float[np.ndarray, "node *axes"], offsets: Int[np.ndarray, "bound"]
) -> Float[np.ndarray, "graph *axes"]:
    """Sum over the nodes of each graph; zero for a graph without nodes."""
    padded = np.concatenate(
        [values, np.zeros_like(values[:1], shape=(1, *values.shape[1:]))]
    )
    sums = np.add.reduceat(padded, offsets[:-1], axis=0)
    return blank_empty(sums, offsets)


def segment_max(
    values: Float[np.ndarray, "node *axes"], offsets: Int[np.ndarray, "bound"]
) -> Float[np.ndarray, "graph *axes"]:
    """Largest of the nodes of each graph; zero for a graph without nodes."""
    lowest = np.full_like(values, -np.inf, shape=(1, *values.shape[1:]))
    padded = np.concatenate([values, lowest])
    largest = np.maximum.reduceat(padded, offsets[:-1], axis=0)
    return blank_empty(largest, offsets)


def blank_empty(
    values: Float[np.ndarray, "graph *axes"], offsets: Int[np.ndarray, "bound"]
) -> Float[np.ndarray, "graph *axes"]:
    """Zero the rows of graphs without nodes, where `reduceat` gives the next one's."""
    empty = (np.diff(offsets) == 0).reshape(-1, *(1,) * (values.ndim - 1))
    return np.where(empty, np.zeros_like(values), values)


@dataclass(frozen=True)
class GraphBatch:
    """Contact graphs laid end to end: what the network's features are made of.

    A node is an active taxel of the touch, now or one reading ago, or a fixed neighbour
    of one. One touch at one reading is a batch of one graph.
    """

    taxels: Int[np.ndarray, "node"]
    """Which taxel of the skin each node is."""

    pressure: Float[np.ndarray, "node"]
    """[kPa], zero where the taxel is not active."""

    before: Float[np.ndarray, "node"]
    """The same one reading earlier [kPa]."""

    age: Float[np.ndarray, "node"]
    """Time since the taxel became active [s]; zero where it is not."""

    areas: Float[np.ndarray, "node"]
    """[cm2]"""

    positions: Float[np.ndarray, "node 3"]
    """About the middle of the graph, in the directions of the world [cm]."""

    normals: Float[np.ndarray, "node 3"]
    """Outward unit normals in the world."""

    shear: Float[np.ndarray, "node 3"]
    """Shear traction in the world [kPa]; zero where not active or not measured."""

    shear_before: Float[np.ndarray, "node 3"]
    """The same one reading earlier, turned with the taxel since [kPa]."""

    neighbours: Int[np.ndarray, "node k"]
    """Sources j of the edges j -> i to each node i, as nodes of its graph, or -1."""

    offsets: Int[np.ndarray, "bound"]
    """First node of each graph, and behind the last the number of nodes."""

    seconds: Float[np.ndarray, "graph"]
    """Time since the reading before [s]."""

    history: Float[np.ndarray, "graph column"]
    """What the touch has been so far; see `eskin.graph.batch.HISTORY`."""

    @property
    def count(self) -> int:
        """Number of graphs."""
        return len(self.seconds)

    @property
    def sizes(self) -> Int[np.ndarray, "graph"]:
        """Number of nodes of each graph."""
        return np.diff(self.offsets)

    @property
    def graph_index(self) -> Int[np.ndarray, "node"]:
        """The graph of each node."""
        return np.repeat(np.arange(self.count), self.sizes)

    @cached_property
    def targets(self) -> Int[np.ndarray, "target"]:
        """The active nodes: those that hear others."""
        return np.flatnonzero(self.pressure > 0)

    @property
    def sources(self) -> Int[np.ndarray, "target k"]:
        """Nodes of the batch that each target hears, or -1.

        Columns that nobody uses are left out.
        """
        heard = self.neighbours[self.targets]
        heard = heard[:, (heard >= 0).any(axis=0)]
        first = np.repeat(self.offsets[:-1], self.sizes)[self.targets, None]
        return np.where(heard >= 0, heard + first, -1)

    def select(self, graphs: Int[np.ndarray, "some"]) -> "GraphBatch":
        """Some of the graphs, in the order asked for."""
        sizes = self.sizes[graphs]
        offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], sizes)
        nodes = np.repeat(self.offsets[graphs], sizes) + within
        taken = {name: getattr(self, name)[nodes] for name in NODE_FIELDS}
        return GraphBatch(
            **taken,
            offsets=offsets,
            seconds=self.seconds[graphs],
            history=self.history[graphs],
        )


NODE_FIELDS = tuple(
    field.name
    for field in fields(GraphBatch)
    if field.name not in ("offsets", "seconds", "history")
)


def join(batches: Sequence[GraphBatch]) -> GraphBatch:
    """Lay batches end to end.

    Raises:
        ValueError: if there is none.
    """
    if not batches:
        raise ValueError("no graphs to join; give at least one batch")
    sizes = np.concatenate([batch.sizes for batch in batches])
    nodes = {
        name: np.concatenate([getattr(batch, name) for batch in batches])
        for name in NODE_FIELDS
    }
    return GraphBatch(
        **nodes,
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        seconds=np.concatenate([batch.seconds for batch in batches]),
        history=np.concatenate([batch.history for batch in batches]),
    )


def no_graphs(neighbours: int) -> GraphBatch:
    """A batch without graphs, of nodes that would have so many neighbours."""
    real, vector = np.zeros(0, np.float32), np.zeros((0, 3), np.float32)
    whole = np.zeros(0, np.int64)
    return GraphBatch(
        taxels=whole,
        pressure=real,
        before=real,
        age=real,
        areas=real,
        positions=vector,
        normals=vector,
        shear=vector,
        shear_before=vector,
        neighbours=np.zeros((0, neighbours), np.int32),
        offsets=np.zeros(1, np.int64),
        seconds=real,
        history=np.zeros((0, len(HISTORY)), np.float32),
    )
