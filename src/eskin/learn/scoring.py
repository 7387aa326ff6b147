"""Probabilities of segments and of instants."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import log_softmax

from eskin.learn.dataset import Dataset
from eskin.learn.segments import Segment
from eskin.learn.windows import cut
from eskin.nn import Places, RecogniserNetwork, graph_tensors

BATCH = 256
"""Windows classified at once."""

READINGS = 512
"""Readings embedded at once."""

HOP = 0.5  # [s] between the windows of a segment
WINDOW = 2.0  # [s]


def log_probabilities(
    network: RecogniserNetwork,
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "window class"]:
    """Log-probabilities of the windows that end with the rows `ends`.

    Each reading is embedded once, however many windows see it, as live.
    """
    windows = cut(dataset, ends, firsts, network.config.slots)
    rows, place = np.unique(windows.rows, return_inverse=True)
    parts = []
    with torch.no_grad():
        e = embeddings(network, dataset, rows)
        for low in range(0, len(ends), BATCH):
            seen = (windows.window >= low) & (windows.window < low + BATCH)
            places = Places(
                torch.as_tensor(windows.window[seen] - low),
                torch.as_tensor(windows.slot[seen]),
                min(BATCH, len(ends) - low),
            )
            views = network.classify(e[torch.as_tensor(place[seen])], places)
            logits = views.mean(dim=0) / temperature
            parts.append(log_softmax(logits, dim=1).numpy())
    return np.concatenate(parts)


def embeddings(
    network: RecogniserNetwork, dataset: Dataset, rows: Int[np.ndarray, "row"]
) -> Float[Tensor, "row feature"]:
    """What the network makes of each row on its own."""
    parts = [
        network.embed(
            graph_tensors(
                dataset.graphs.select(rows[low : low + READINGS]), network.shear
            )
        )
        for low in range(0, len(rows), READINGS)
    ]
    return torch.cat(parts)


def segment_scores(
    network: RecogniserNetwork,
    dataset: Dataset,
    segments: Sequence[Segment],
    temperature: float = 1.0,
) -> Float[np.ndarray, "segment class"]:
    """Mean log-probability over the windows of each segment.

    Windows end every half second, first when the segment is as long as a window, and
    with its last reading. They see nothing from outside of the segment.
    """
    if not segments:
        return np.zeros((0, network.graph_head.classify.out_features))
    ends = [window_ends(dataset, segment) for segment in segments]
    counts = np.array([len(rows) for rows in ends])
    firsts = np.repeat([segment.first for segment in segments], counts)
    scores = log_probabilities(
        network, dataset, np.concatenate(ends), firsts, temperature
    )
    starts = np.cumsum(counts) - counts
    return np.add.reduceat(scores, starts, axis=0) / counts[:, None]


def window_ends(dataset: Dataset, segment: Segment) -> Int[np.ndarray, "window"]:
    """Last rows of the windows of a segment."""
    stamps = dataset.stamps[segment.first : segment.end]
    seconds = (stamps - stamps[0]) * 1e-9
    times = np.arange(WINDOW, seconds[-1], HOP)
    rows = np.searchsorted(seconds, times)
    return segment.first + np.unique(np.append(rows, len(stamps) - 1))


def instant_scores(
    network: RecogniserNetwork,
    dataset: Dataset,
    rows: Int[np.ndarray, "row"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "row class"]:
    """Log-probabilities at every row, from the two seconds before it."""
    return log_probabilities(network, dataset, rows, dataset.starts[rows], temperature)
