"""Sums and maxima over the nodes of each graph of a batch."""

import numpy as np
from jaxtyping import Float, Int


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
