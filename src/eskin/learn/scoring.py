"""This module computes class probabilities of windows, segments and clips."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import log_softmax

from eskin.graph.features import N_PER_KPA_CM2, total
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Clip, Segment, find_runs
from eskin.learn.windows import cut_windows
from eskin.nn import Places, RecogniserNetwork, graph_tensors
from eskin.recording import NONE

BATCH = 256
"""Windows classified at once."""

READINGS = 512
"""Readings embedded at once."""

HOP = 0.5  # [s] between the windows of a segment
WINDOW = 2.0  # [s]


def compute_log_probabilities(
    network: RecogniserNetwork,
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "window class"]:
    """Log-probabilities of the windows that end with the rows `ends`.

    Each reading is embedded once, however many windows see it, as live.
    """
    windows = cut_windows(dataset, ends, firsts, network.config.slots)
    rows, place = np.unique(windows.rows, return_inverse=True)
    parts = []
    with torch.no_grad():
        e = embed_rows(network, dataset, rows)
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


def embed_rows(
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


def score_segments(
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
    ends = [find_window_ends(dataset, segment) for segment in segments]
    counts = np.array([len(rows) for rows in ends])
    firsts = np.repeat([segment.first for segment in segments], counts)
    scores = compute_log_probabilities(
        network, dataset, np.concatenate(ends), firsts, temperature
    )
    starts = np.cumsum(counts) - counts
    return np.add.reduceat(scores, starts, axis=0) / counts[:, None]


def find_window_ends(dataset: Dataset, segment: Segment) -> Int[np.ndarray, "window"]:
    """Last rows of the windows of a segment."""
    stamps = dataset.stamps[segment.first : segment.end]
    seconds = (stamps - stamps[0]) * 1e-9
    times = np.arange(WINDOW, seconds[-1], HOP)
    rows = np.searchsorted(seconds, times)
    return segment.first + np.unique(np.append(rows, len(stamps) - 1))


def score_instants(
    network: RecogniserNetwork,
    dataset: Dataset,
    rows: Int[np.ndarray, "row"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "row class"]:
    """Log-probabilities at every row, from the two seconds before it."""
    return compute_log_probabilities(
        network, dataset, rows, dataset.starts[rows], temperature
    )


@dataclass(frozen=True, eq=False)
class ClipPredictions:
    """What the recogniser says of every clip of a data set."""

    clips: tuple[Clip, ...]
    """In the order of the recordings."""
    recording: Int[np.ndarray, "clip"]
    """The recording of each, as an index into those of the data set."""
    truth: Int[np.ndarray, "clip"]
    """What it was made for, as an index into the vocabulary."""
    log_probabilities: Float[np.ndarray, "clip class"]
    """Log-probabilities; certainly `none` where nothing was detected."""

    @property
    def answer(self) -> Int[np.ndarray, "clip"]:
        """The likeliest class of each."""
        return self.log_probabilities.argmax(axis=1)


def predict_clips(
    network: RecogniserNetwork,
    dataset: Dataset,
    vocabulary: tuple[str, ...],
    temperature: float = 1.0,
    recordings: Collection[int] | None = None,
) -> ClipPredictions:
    """Answer every clip; abstention is off.

    A touch keeps its last word: what is said of it at its last reading in the clip.

    Args:
        network: that answers.
        dataset: where the clips are.
        vocabulary: classes of the network; clips of others are passed over.
        temperature: divides its logits.
        recordings: those whose clips are asked for; all where None.
    """
    chosen = range(len(dataset.clips)) if recordings is None else sorted(recordings)
    every = [
        (n, clip)
        for n in chosen
        for clip in dataset.clips[n]
        if clip.gesture in vocabulary
    ]
    ends = np.array(list(find_last_rows(dataset, every)), dtype=np.int64)
    felt = ends >= 0
    chances = np.where(np.array(vocabulary) == NONE, 0.0, -np.inf)
    log_probabilities = np.tile(chances, (len(every), 1))
    if felt.any():
        log_probabilities[felt] = compute_log_probabilities(
            network, dataset, ends[felt], dataset.starts[ends[felt]], temperature
        )
    return ClipPredictions(
        clips=tuple(clip for _, clip in every),
        recording=np.array([n for n, _ in every], dtype=np.int64),
        truth=np.array([vocabulary.index(c.gesture) for _, c in every], dtype=np.int64),
        log_probabilities=log_probabilities,
    )


def find_last_rows(
    dataset: Dataset, every: Sequence[tuple[int, Clip]]
) -> Iterator[int]:
    """The last row of the touch of largest impulse of each clip, -1 without a touch.

    Args:
        dataset: where the clips are.
        every: the clips, each with the index of its recording.
    """
    graphs = dataset.graphs
    force = total(graphs.pressure * graphs.areas, graphs) * N_PER_KPA_CM2
    runs = np.array(find_runs(dataset.sequence[:, None]), dtype=np.int64).reshape(-1, 2)
    firsts, ends = runs.T
    work = np.concatenate([[0.0], np.cumsum(force * graphs.seconds, dtype=np.float64)])
    impulse = work[ends] - work[firsts]
    recording, start = dataset.recording[firsts], dataset.stamps[firsts]
    for number, clip in every:
        inside = (start >= clip.start) & (start < clip.end)
        here = np.flatnonzero(inside & (recording == number))
        yield int(ends[here[impulse[here].argmax()]] - 1) if len(here) else -1
