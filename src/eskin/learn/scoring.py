"""Probabilities of segments and of instants."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from torch.nn.functional import log_softmax

from eskin.learn.dataset import Dataset, Segment
from eskin.learn.windows import cut, to_input
from eskin.nn import RecogniserNetwork

BATCH = 64
HOP = 0.5  # [s] between the windows of a segment
WINDOW = 2.0  # [s]


def log_probabilities(
    network: RecogniserNetwork,
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "window class"]:
    """Log-probabilities of the windows that end with the rows `ends`."""
    parts = []
    with torch.no_grad():
        for low in range(0, len(ends), BATCH):
            part = slice(low, low + BATCH)
            windows = cut(dataset, ends[part], firsts[part], network.config.slots)
            graphs = dataset.graphs.select(windows.rows)
            logits = network(to_input(graphs, windows, network.shear)) / temperature
            parts.append(log_softmax(logits, dim=1).numpy())
    return np.concatenate(parts)


def segment_scores(
    network: RecogniserNetwork, dataset: Dataset, segments: Sequence[Segment]
) -> Float[np.ndarray, "segment class"]:
    """Mean log-probability over the windows of each segment.

    Windows end every half second, first when the segment is as long as a window, and
    with its last reading. They see nothing from outside of the segment.
    """
    ends = [window_ends(dataset, segment) for segment in segments]
    counts = [len(rows) for rows in ends]
    firsts = np.repeat([segment.first for segment in segments], counts)
    scores = log_probabilities(network, dataset, np.concatenate(ends), firsts)
    starts = np.cumsum(counts) - counts
    return np.add.reduceat(scores, starts, axis=0) / np.array(counts)[:, None]


def window_ends(dataset: Dataset, segment: Segment) -> Int[np.ndarray, "window"]:
    """Last rows of the windows of a segment."""
    stamps = dataset.stamps[segment.first : segment.end]
    seconds = (stamps - stamps[0]) * 1e-9
    times = np.arange(WINDOW, seconds[-1], HOP)
    rows = np.searchsorted(seconds, times)
    return segment.first + np.unique(np.append(rows, len(stamps) - 1))


def instant_scores(
    network: RecogniserNetwork, dataset: Dataset, rows: Int[np.ndarray, "row"]
) -> Float[np.ndarray, "row class"]:
    """Log-probabilities at every row, from the two seconds before it."""
    return log_probabilities(network, dataset, rows, dataset.starts[rows])
