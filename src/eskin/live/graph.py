"""One contact graph as the kernels take it: plain arrays, long enough or longer."""

from typing import NamedTuple

import numpy as np

from eskin.graph import GraphBatch


class Graph(NamedTuple):
    """The fields of `eskin.graph.GraphBatch` for one graph.

    The arrays may be longer than the graph, so that one set of them serves every
    reading; what lies behind its nodes is not looked at.
    """

    nodes: int
    """Number of nodes."""
    seconds: float
    """Time since the reading before [s]."""
    pressure: np.ndarray
    """(node) [kPa]"""
    before: np.ndarray
    """(node) [kPa]"""
    age: np.ndarray
    """(node) [s]"""
    areas: np.ndarray
    """(node) [cm2]"""
    positions: np.ndarray
    """(node, 3) [cm]"""
    normals: np.ndarray
    """(node, 3)"""
    shear: np.ndarray
    """(node, 3) [kPa]"""
    shear_before: np.ndarray
    """(node, 3) [kPa]"""
    neighbours: np.ndarray
    """(node, k) as nodes of the graph, or -1"""
    history: np.ndarray
    """(column)"""


def graph_of(batch: GraphBatch, index: int = 0) -> Graph:
    """One graph of a batch, its arrays shared with the batch's where they fit."""
    first, last = int(batch.offsets[index]), int(batch.offsets[index + 1])
    return Graph(
        last - first,
        float(batch.seconds[index]),
        real(batch.pressure[first:last]),
        real(batch.before[first:last]),
        real(batch.age[first:last]),
        real(batch.areas[first:last]),
        real(batch.positions[first:last]),
        real(batch.normals[first:last]),
        real(batch.shear[first:last]),
        real(batch.shear_before[first:last]),
        np.ascontiguousarray(batch.neighbours[first:last], np.int32),
        real(batch.history[index]),
    )


def real(values: np.ndarray) -> np.ndarray:
    """The values as the kernels take them."""
    return np.ascontiguousarray(values, np.float32)
