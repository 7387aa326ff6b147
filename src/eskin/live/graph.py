"""This module defines contact graphs and operations on batches of them."""

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

HISTORY = ("age", "pause", "contacts", "travel", "farthest", "impulse", "peak force")
"""Columns of the history of a touch: time since onset [s], time since the last contact
[s], number of contacts, distance from its start, now and at most [cm], force integrated
over time [N s], greatest force [N]. On a skin that is not calibrated all are zero."""

NO_HISTORY = np.zeros(len(HISTORY))


class GraphBatch(NamedTuple):
    """A batch holds contact graphs laid end to end.

    A node is an active taxel of the touch, now or one graph ago, or a fixed neighbour
    of one. One touch at one reading is a batch of one graph. In compiled code, arrays
    of nodes may be longer than the last offset; kernels ignore the rest.
    """

    taxels: Int[np.ndarray, "node"]
    """Index in the skin of the taxel of each node."""
    pressure: Float[np.ndarray, "node"]
    """Pressure [kPa]; zero where the taxel is not active."""
    before: Float[np.ndarray, "node"]
    """Pressure one graph earlier [kPa]."""
    age: Float[np.ndarray, "node"]
    """Time since the taxel became active [s]; zero where it is not."""
    areas: Float[np.ndarray, "node"]
    """Area of the taxel [cm2]."""
    positions: Float[np.ndarray, "node 3"]
    """Position relative to the mean of the graph, in the axes of the world [cm]."""
    normals: Float[np.ndarray, "node 3"]
    """Outward unit normal in the world."""
    shear: Float[np.ndarray, "node 3"]
    """Shear traction in the world [kPa]; zero where not active or not measured."""
    shear_before: Float[np.ndarray, "node 3"]
    """Shear one graph earlier, rotated with the taxel since [kPa]."""
    neighbours: Int[np.ndarray, "node k"]
    """Sources j of the edges j -> i to each node i, as nodes of its graph, or -1."""
    offsets: Int[np.ndarray, "bound"]
    """First node of each graph, and after the last one the number of nodes."""
    seconds: Float[np.ndarray, "graph"]
    """Time since the previous graph [s]."""
    history: Float[np.ndarray, "graph column"]
    """History of the touch so far, with the columns `HISTORY`."""

    @property
    def size(self) -> int:
        """Number of graphs."""
        return len(self.seconds)

    @property
    def sizes(self) -> Int[np.ndarray, "graph"]:
        """Number of nodes of each graph."""
        return np.diff(self.offsets)

    @property
    def graph_index(self) -> Int[np.ndarray, "node"]:
        """Index of the graph of each node."""
        return np.repeat(np.arange(self.size), self.sizes)

    @property
    def targets(self) -> Int[np.ndarray, "target"]:
        """Active nodes, the only ones that receive messages."""
        return np.flatnonzero(self.pressure > 0)

    @property
    def sources(self) -> Int[np.ndarray, "target k"]:
        """Nodes of the batch that send a message to each target, or -1.

        Columns without any source are left out.
        """
        targets = self.targets
        neighbours = self.neighbours[targets]
        neighbours = neighbours[:, (neighbours >= 0).any(axis=0)]
        first = np.repeat(self.offsets[:-1], self.sizes)[targets, None]
        return np.where(neighbours >= 0, neighbours + first, -1)

    def for_kernels(self) -> "GraphBatch":
        """Return the batch in the types that compiled code takes, copied if needed."""
        types = {"taxels": np.int64, "neighbours": np.int32, "offsets": np.int64}
        real = self.pressure.dtype
        return GraphBatch(
            *(
                np.require(array, types.get(name, real), ["C", "W"])
                for name, array in self._asdict().items()
            )
        )

    def select(self, graphs: Int[np.ndarray, "some"]) -> "GraphBatch":
        """Return some of the graphs, in the given order."""
        sizes = self.sizes[graphs]
        offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], sizes)
        nodes = np.repeat(self.offsets[graphs], sizes) + within
        return GraphBatch(
            **{name: getattr(self, name)[nodes] for name in NODE_FIELDS},
            **{name: getattr(self, name)[graphs] for name in GRAPH_FIELDS},
            offsets=offsets,
        )

    def sum_nodes(
        self, values: Float[np.ndarray, "node *axes"]
    ) -> Float[np.ndarray, "graph *axes"]:
        """Return the sum over the nodes of each graph; zero for a graph without any."""
        nothing = np.zeros_like(values[:1], shape=(1, *values.shape[1:]))
        padded = np.concatenate([values, nothing])
        sums = np.add.reduceat(padded, self.offsets[:-1], axis=0)
        sums[self.sizes == 0] = 0.0  # where `reduceat` gives the next node
        return sums


SHEAR_FIELDS = ("shear", "shear_before")
"""Fields of the shear at each node."""
NODE_FIELDS = GraphBatch._fields[:-3]
"""Fields that hold a value of each node."""
GRAPH_FIELDS = ("seconds", "history")
"""Fields that hold a value of each graph."""


def join_graphs(batches: Iterable[GraphBatch]) -> GraphBatch:
    """Lay batches end to end.

    What is zero in all of them, as shear is where no skin measures it, takes no memory.

    Raises:
        ValueError: if there is none.
    """
    batches = tuple(batches)
    if not batches:
        raise ValueError("no graphs to join; give at least one batch")

    def join(name: str) -> np.ndarray:
        arrays = [getattr(batch, name) for batch in batches]
        if name in SHEAR_FIELDS and not any(array.any() for array in arrays):
            count = sum(map(len, arrays))
            return np.broadcast_to(np.float32(0), (count, *arrays[0].shape[1:]))
        return np.concatenate(arrays)

    return GraphBatch(
        **{name: join(name) for name in (*NODE_FIELDS, *GRAPH_FIELDS)},
        offsets=np.concatenate([[0], np.cumsum(join("sizes"))]).astype(np.int64),
    )


def create_empty_batch(neighbours: int) -> GraphBatch:
    """Return a batch without graphs; `neighbours` is the width of its table."""
    return allocate_graphs(0, 0, neighbours)


def allocate_graphs(graphs: int, nodes: int, neighbours: int) -> GraphBatch:
    """Return arrays of zeros for so many graphs, nodes and neighbours of each node."""
    real = partial(np.zeros, dtype=np.float32)
    return GraphBatch(
        taxels=np.zeros(nodes, np.int64),
        pressure=real(nodes),
        before=real(nodes),
        age=real(nodes),
        areas=real(nodes),
        positions=real((nodes, 3)),
        normals=real((nodes, 3)),
        shear=real((nodes, 3)),
        shear_before=real((nodes, 3)),
        neighbours=np.zeros((nodes, neighbours), np.int32),
        offsets=np.zeros(graphs + 1, np.int64),
        seconds=real(graphs),
        history=real((graphs, len(HISTORY))),
    )
