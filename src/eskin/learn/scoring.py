"""This module computes class probabilities of windows, segments and clips."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import log_softmax

from eskin.graph.summary_kernels import N_PER_KPA_CM2
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Clip, Segment, find_runs
from eskin.learn.windows import cut_windows
from eskin.nn import RecogniserNetwork, SlotIndex, build_graph_tensors
from eskin.recording import NONE

WINDOW_BATCH = 256
"""Number of windows classified at once."""

READING_BATCH = 512
"""Number of readings embedded at once."""

HOP = 0.5  # [s] between the windows of a segment
WINDOW = 2.0  # [s]


def compute_log_probabilities(
    network: RecogniserNetwork,
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "window class"]:
    """Return log-probabilities of the windows that end with the rows `ends`.

    Each reading is embedded once, however many windows hold it, as live.
    """
    windows = cut_windows(dataset, ends, firsts, network.config.slots)
    rows, place = np.unique(windows.rows, return_inverse=True)
    parts = []
    with torch.no_grad():
        e = embed_rows(network, dataset, rows)
        for low in range(0, len(ends), WINDOW_BATCH):
            chosen = (windows.window >= low) & (windows.window < low + WINDOW_BATCH)
            slot_index = SlotIndex(
                torch.as_tensor(windows.window[chosen] - low),
                torch.as_tensor(windows.slot[chosen]),
                min(WINDOW_BATCH, len(ends) - low),
            )
            views = network.classify(e[torch.as_tensor(place[chosen])], slot_index)
            logits = views.mean(dim=0) / temperature
            parts.append(log_softmax(logits, dim=1).numpy())
    return np.concatenate(parts)


def embed_rows(
    network: RecogniserNetwork, dataset: Dataset, rows: Int[np.ndarray, "row"]
) -> Float[Tensor, "row feature"]:
    """Return the embedding of each row on its own."""
    parts = [
        network.embed(
            build_graph_tensors(
                dataset.graphs.select(rows[low : low + READING_BATCH]), network.shear
            )
        )
        for low in range(0, len(rows), READING_BATCH)
    ]
    return torch.cat(parts)


def score_segments(
    network: RecogniserNetwork,
    dataset: Dataset,
    segments: Sequence[Segment],
    temperature: float = 1.0,
) -> Float[np.ndarray, "segment class"]:
    """Return mean log-probabilities over the windows of each segment.

    Windows end every half second, first when the segment is as long as a window, and
    with its last reading. They hold nothing from outside the segment.
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
    """Return the last rows of the windows of a segment."""
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
    """Return log-probabilities at every row, from the two seconds before it."""
    return compute_log_probabilities(
        network, dataset, rows, dataset.starts[rows], temperature
    )


@dataclass(frozen=True, eq=False)
class ClipPredictions:
    """Clip predictions hold the recogniser's answer to every clip of a data set."""

    clips: tuple[Clip, ...]
    """Clips in the order of the recordings."""
    recording: Int[np.ndarray, "clip"]
    """Index of each clip's recording in the data set."""
    truth: Int[np.ndarray, "clip"]
    """True class of each clip, as an index into the vocabulary."""
    log_probabilities: Float[np.ndarray, "clip class"]
    """Log-probabilities of each clip; `none` is certain where nothing was detected."""

    @property
    def predicted(self) -> Int[np.ndarray, "clip"]:
        """Return the most probable class of each clip."""
        return self.log_probabilities.argmax(axis=1)


def predict_clips(
    network: RecogniserNetwork,
    dataset: Dataset,
    vocabulary: tuple[str, ...],
    temperature: float = 1.0,
    recordings: Collection[int] | None = None,
) -> ClipPredictions:
    """Classify every clip by its touch of largest impulse, without abstention.

    The prediction is the one at the touch's last reading in the clip.

    Args:
        network: network that classifies.
        dataset: data set that holds the clips.
        vocabulary: classes of the network; clips of others are skipped.
        temperature: divisor of the logits.
        recordings: indices of the recordings whose clips count; all where None.
    """
    chosen = range(len(dataset.clips)) if recordings is None else sorted(recordings)
    clips = [
        (n, clip)
        for n in chosen
        for clip in dataset.clips[n]
        if clip.gesture in vocabulary
    ]
    ends = np.array(list(find_last_rows(dataset, clips)), dtype=np.int64)
    touched = ends >= 0
    certainly_none = np.where(np.array(vocabulary) == NONE, 0.0, -np.inf)
    log_probabilities = np.tile(certainly_none, (len(clips), 1))
    if touched.any():
        log_probabilities[touched] = compute_log_probabilities(
            network, dataset, ends[touched], dataset.starts[ends[touched]], temperature
        )
    return ClipPredictions(
        clips=tuple(clip for _, clip in clips),
        recording=np.array([n for n, _ in clips], dtype=np.int64),
        truth=np.array([vocabulary.index(c.gesture) for _, c in clips], dtype=np.int64),
        log_probabilities=log_probabilities,
    )


def find_last_rows(
    dataset: Dataset, clips: Sequence[tuple[int, Clip]]
) -> Iterator[int]:
    """Yield the last row of each clip's touch of largest impulse, -1 without one.

    Args:
        dataset: data set that holds the clips.
        clips: clips, each with the index of its recording.
    """
    graphs = dataset.graphs
    force = graphs.sum_nodes(graphs.pressure * graphs.areas) * N_PER_KPA_CM2
    runs = np.array(find_runs(dataset.sequence[:, None]), dtype=np.int64).reshape(-1, 2)
    firsts, ends = runs.T
    work = np.concatenate([[0.0], np.cumsum(force * graphs.seconds, dtype=np.float64)])
    impulse = work[ends] - work[firsts]
    recording, start = dataset.recording[firsts], dataset.stamps[firsts]
    for number, clip in clips:
        inside = (start >= clip.start) & (start < clip.end)
        here = np.flatnonzero(inside & (recording == number))
        yield int(ends[here[impulse[here].argmax()]] - 1) if len(here) else -1
