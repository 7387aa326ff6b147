"""Clips answered: each by its touch of largest impulse, at its last reading."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.summary import N_PER_KPA_CM2, total
from eskin.learn.clips import Clip
from eskin.learn.dataset import Dataset
from eskin.learn.scoring import log_probabilities
from eskin.learn.segments import runs_of
from eskin.nn import RecogniserNetwork
from eskin.recording import NONE


@dataclass(frozen=True, eq=False)
class ClipAnswers:
    """What the recogniser says of every clip of a data set."""

    clips: tuple[Clip, ...]
    """In the order of the recordings."""
    recording: Int[np.ndarray, "clip"]
    """The recording of each, as an index into those of the data set."""
    truth: Int[np.ndarray, "clip"]
    """What it was made for, as an index into the vocabulary."""
    log_chances: Float[np.ndarray, "clip class"]
    """Log-probabilities; certainly `none` where nothing was detected."""

    @property
    def answer(self) -> Int[np.ndarray, "clip"]:
        """The likeliest class of each."""
        return self.log_chances.argmax(axis=1)


def answer_clips(
    network: RecogniserNetwork,
    dataset: Dataset,
    vocabulary: tuple[str, ...],
    temperature: float = 1.0,
    recordings: Collection[int] | None = None,
) -> ClipAnswers:
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
    ends = np.array(list(last_rows(dataset, every)), dtype=np.int64)
    felt = ends >= 0
    chances = np.where(np.array(vocabulary) == NONE, 0.0, -np.inf)
    log_chances = np.tile(chances, (len(every), 1))
    if felt.any():
        log_chances[felt] = log_probabilities(
            network, dataset, ends[felt], dataset.starts[ends[felt]], temperature
        )
    return ClipAnswers(
        clips=tuple(clip for _, clip in every),
        recording=np.array([n for n, _ in every], dtype=np.int64),
        truth=np.array([vocabulary.index(c.gesture) for _, c in every], dtype=np.int64),
        log_chances=log_chances,
    )


def last_rows(dataset: Dataset, every: Sequence[tuple[int, Clip]]) -> Iterator[int]:
    """The last row of the touch of largest impulse of each clip, -1 without a touch.

    Args:
        dataset: where the clips are.
        every: the clips, each with the index of its recording.
    """
    graphs = dataset.graphs
    force = total(graphs.pressure * graphs.areas, graphs) * N_PER_KPA_CM2
    runs = np.array(runs_of(dataset.sequence[:, None]), dtype=np.int64).reshape(-1, 2)
    firsts, ends = runs.T
    work = np.concatenate([[0.0], np.cumsum(force * graphs.seconds, dtype=np.float64)])
    impulse = work[ends] - work[firsts]
    recording, start = dataset.recording[firsts], dataset.stamps[firsts]
    for number, clip in every:
        inside = (start >= clip.start) & (start < clip.end)
        here = np.flatnonzero(inside & (recording == number))
        yield int(ends[here[impulse[here].argmax()]] - 1) if len(here) else -1
