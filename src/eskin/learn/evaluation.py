"""This module evaluates a recogniser on windows, segments and clips."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import log_softmax

from eskin.errors import RecordingError, SkinMismatchError
from eskin.learn.batches import cut_windows
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Clip, Segment, find_runs
from eskin.learn.live_answers import LiveAnswers
from eskin.learn.metrics import (
    ClassificationScore,
    Reliability,
    bound_accuracy,
    compute_group_accuracies,
    compute_reliability,
    score_predictions,
)
from eskin.learn.nn import (
    RecogniserNetwork,
    SlotIndex,
    build_graph_tensors,
)
from eskin.live import ModelCard
from eskin.live.summary_kernels import N_PER_KPA_CM2
from eskin.progress import track_progress
from eskin.recording import NONE
from eskin.units import format_count

WINDOW_BATCH = 256
"""Number of windows classified at once."""

READING_BATCH = 512
"""Number of readings embedded at once."""

HOP = 0.5  # [s] between the ends of a segment's windows
WINDOW = 2.0  # [s]


def compute_log_probabilities(
    network: RecogniserNetwork | LiveAnswers,
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    temperature: float = 1.0,
    closing: bool | Bool[np.ndarray, "window"] = False,
) -> Float[np.ndarray, "window class"]:
    """Return log-probabilities of the windows that end with the rows `ends`.

    As live, each reading is embedded only once, however many windows hold it. Answers
    that were made live are those at the rows `ends`, whatever `firsts` are.

    Args:
        network: network that classifies, or its answers.
        dataset: data set that holds the rows.
        ends: last row of each window.
        firsts: earliest row that each window may hold.
        temperature: divisor of the logits.
        closing: whether a window ends with its touch, so that the closing layer
            answers.
    """
    if isinstance(network, LiveAnswers):
        opened = torch.from_numpy(network.logits[ends])
        closed = torch.from_numpy(network.closing[ends])
    else:
        statistics = compute_statistics(network, dataset, ends, firsts)
        with torch.no_grad():
            opened = network.classify_statistics(statistics)
            closed = network.classify_statistics(statistics, closing=True)
    logits = torch.where(torch.as_tensor(closing)[..., None], closed, opened)
    return log_softmax(logits / temperature, dim=1).numpy()


def compute_statistics(
    network: RecogniserNetwork,
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
) -> Float[Tensor, "window statistic"]:
    """Return the statistics of windows that the last layers of a network take.

    Args are as in `compute_log_probabilities`.
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
            own = e[torch.as_tensor(place[chosen])]
            parts.append(network.summarise(own, slot_index))
    return torch.cat(parts)


def embed_rows(
    network: RecogniserNetwork, dataset: Dataset, rows: Int[np.ndarray, "row"]
) -> Float[Tensor, "row feature"]:
    """Return the features of each row, summary and embedding."""
    parts = []
    lows = range(0, len(rows), READING_BATCH)
    for low in track_progress(lows, "batches of readings embedded", len(lows)):
        graphs = dataset.graphs.select(rows[low : low + READING_BATCH])
        parts.append(network.embed(build_graph_tensors(graphs, network.shear)))
    return torch.cat(parts)


def score_segments(
    network: RecogniserNetwork | LiveAnswers,
    dataset: Dataset,
    segments: Sequence[Segment],
    temperature: float = 1.0,
) -> Float[np.ndarray, "segment class"]:
    """Return mean log-probabilities over the windows of each segment.

    Windows end every half second, from two seconds into the segment, and with its last
    reading, which is taken for the end of a touch. They hold nothing from outside the
    segment.
    """
    if not segments:
        return np.zeros((0, network.classes))
    ends = [find_window_ends(dataset, segment) for segment in segments]
    counts = np.array([len(rows) for rows in ends])
    firsts = np.repeat([segment.first for segment in segments], counts)
    joined = np.concatenate(ends)
    closing = np.isin(np.arange(len(joined)), np.cumsum(counts) - 1)
    scores = compute_log_probabilities(
        network, dataset, joined, firsts, temperature, closing
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
    network: RecogniserNetwork | LiveAnswers,
    dataset: Dataset,
    rows: Int[np.ndarray, "row"],
    temperature: float = 1.0,
) -> Float[np.ndarray, "row class"]:
    """Return log-probabilities at each row, from the two seconds before it."""
    return compute_log_probabilities(
        network, dataset, rows, dataset.starts[rows], temperature
    )


@dataclass(frozen=True, eq=False)
class ClipPredictions:
    """Clip predictions hold the recogniser's prediction for each clip."""

    clips: tuple[Clip, ...]
    """Clips in the order of the recordings."""
    recording: Int[np.ndarray, "clip"]
    """Index of each clip's recording in the data set."""
    truth: Int[np.ndarray, "clip"]
    """True class of each clip, as an index into the vocabulary."""
    log_probabilities: Float[np.ndarray, "clip class"]
    """Log-probabilities of each clip; 0 for `none` where there is no touch."""

    @property
    def predicted(self) -> Int[np.ndarray, "clip"]:
        """Return the most probable class of each clip."""
        return self.log_probabilities.argmax(axis=1)


def predict_clips(
    network: RecogniserNetwork | LiveAnswers,
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
        recordings: indices of the recordings whose clips are used; all where None.
    """
    chosen = range(len(dataset.clips)) if recordings is None else sorted(recordings)
    every = [(n, clip) for n in chosen for clip in dataset.clips[n]]
    clips = [(n, clip) for n, clip in every if clip.gesture in vocabulary]
    ends = np.array(list(find_last_rows(dataset, clips)), dtype=np.int64)
    touched = ends >= 0
    certainly_none = np.where(np.array(vocabulary) == NONE, 0.0, -np.inf)
    log_probabilities = np.tile(certainly_none, (len(clips), 1))
    if touched.any():
        log_probabilities[touched] = compute_log_probabilities(
            network,
            dataset,
            ends[touched],
            dataset.starts[ends[touched]],
            temperature,
            closing=True,
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

    `clips` come with the index of their recording.
    """
    graphs = dataset.graphs
    force = graphs.sum_nodes(graphs.pressure * graphs.areas) * N_PER_KPA_CM2
    runs = np.array(find_runs(dataset.sequence[:, None]), dtype=np.int64).reshape(-1, 2)
    firsts, ends = runs.T
    total = np.concatenate([[0.0], np.cumsum(force * graphs.seconds, dtype=np.float64)])
    impulse = total[ends] - total[firsts]
    recording = dataset.recording[firsts]
    start = dataset.stamps[firsts]
    for number, clip in clips:
        inside = (start >= clip.start) & (start < clip.end)
        here = np.flatnonzero(inside & (recording == number))
        yield int(ends[here[impulse[here].argmax()]] - 1) if len(here) else -1


@dataclass(frozen=True)
class Evaluation:
    """An evaluation holds the scores of a recogniser on some recordings."""

    segments: ClassificationScore
    """Scores on whole gestures: the clips of a generated set, else labelled segments.
    An undetected gesture counts as `none`; where no label is `none`, no other
    prediction is."""
    interval: tuple[float, float]
    """95 % confidence interval of that accuracy on further people (`bound_accuracy`);
    NaN where there is only one."""
    instants: ClassificationScore | None
    """Scores at every instant, `none` among the classes; None for clips, which are too
    short."""
    per_subject: dict[str, float]
    """Accuracy on segments of each person, or session where people are not known."""
    reliability: Reliability
    """Accuracy of the predictions by their confidence."""

    @property
    def ece(self) -> float:
        """Return the expected calibration error."""
        return self.reliability.error


class Predictions(NamedTuple):
    """Predictions hold true and predicted class, confidence and recording."""

    truth: Int[np.ndarray, "example"]
    predicted: Int[np.ndarray, "example"]
    confidence: Float[np.ndarray, "example"]
    recording: Int[np.ndarray, "example"]


def score_dataset(
    network: RecogniserNetwork | LiveAnswers, card: ModelCard, dataset: Dataset
) -> Evaluation:
    """Score a network on prepared recordings.

    Raises:
        RecordingError: if no label is of a gesture or holds a touch.
        SkinMismatchError: if the recordings lack what the model needs, or hold
            gestures that it does not know.
    """
    check_fits(card, dataset)
    if any(dataset.clips):
        found = classify_clips(network, card, dataset)
        instants = None
    else:
        found = classify_labelled(network, card, dataset)
        instants = evaluate_instants(network, card, dataset)
    people = [find_person(dataset, recording) for recording in found.recording.tolist()]
    correct = found.predicted == found.truth
    return Evaluation(
        segments=score_predictions(found.truth, found.predicted, card.vocabulary),
        interval=bound_accuracy(correct, people),
        instants=instants,
        per_subject=compute_group_accuracies(correct, people),
        reliability=compute_reliability(found.confidence, correct),
    )


def score_held_out(
    network: RecogniserNetwork,
    card: ModelCard,
    dataset: Dataset,
    recordings: Collection[int],
) -> ClassificationScore | None:
    """Score the labelled gestures of some recordings of a data set, each as a whole.

    Returns:
        The score; None where there are none, and for clips of generated sets.
    """
    known = card.vocabulary
    segments, missed = (
        tuple(x for x in part if x.recording in recordings and x.gesture in known)
        for part in (dataset.segments, dataset.missed)
    )
    part = replace(dataset, segments=segments, missed=missed)
    if any(dataset.clips) or not (part.labelled or part.missed):
        return None
    found = classify_labelled(network, card, part)
    return score_predictions(found.truth, found.predicted, known)


def evaluate_instants(
    network: RecogniserNetwork | LiveAnswers, card: ModelCard, dataset: Dataset
) -> ClassificationScore:
    """Score the predictions at every row."""
    rows = np.arange(len(dataset.stamps))
    scores = score_instants(network, dataset, rows, card.temperature)
    truth = np.array([card.vocabulary.index(gesture) for gesture in dataset.gestures])
    return score_predictions(truth, scores.argmax(axis=1), card.vocabulary)


def classify_clips(
    network: RecogniserNetwork | LiveAnswers, card: ModelCard, dataset: Dataset
) -> Predictions:
    """Return the predictions for the clips of generated sets."""
    found = predict_clips(network, dataset, card.vocabulary, card.temperature)
    confidence = np.exp(found.log_probabilities.max(axis=1))
    return Predictions(found.truth, found.predicted, confidence, found.recording)


def classify_labelled(
    network: RecogniserNetwork | LiveAnswers, card: ModelCard, dataset: Dataset
) -> Predictions:
    """Return the predictions for labelled gestures; `none` for undetected ones."""
    vocabulary = card.vocabulary
    segments = dataset.labelled
    examples = [*segments, *dataset.missed]
    scores = score_segments(network, dataset, segments, card.temperature)
    if not any(segment.gesture == NONE for segment in segments):
        scores[:, vocabulary.index(NONE)] = -np.inf
    missed = np.full(len(dataset.missed), vocabulary.index(NONE))
    return Predictions(
        truth=np.array([vocabulary.index(example.gesture) for example in examples]),
        predicted=np.concatenate([scores.argmax(axis=1), missed]),
        confidence=np.append(compute_confidence(scores), np.ones(len(missed))),
        recording=np.array([example.recording for example in examples]),
    )


def check_fits(card: ModelCard, dataset: Dataset) -> None:
    """Reject recordings that the model cannot be scored on."""
    if not (dataset.labelled or dataset.missed or any(dataset.clips)):
        raise RecordingError(
            f"no label of {format_count(dataset.original_count, 'recording')} is of a "
            "gesture or holds a touch; allowed is one and more; label their gestures"
        )
    if card.kind == "shear" and not dataset.has_shear:
        raise SkinMismatchError(
            "the model needs shear, which these recordings do not have; allowed are "
            "recordings of skins with shear; train a model with --train.no-shear"
        )
    gestures = {*dataset.gestures, *(example.gesture for example in dataset.missed)}
    gestures |= {clip.gesture for clips in dataset.clips for clip in clips}
    unknown = sorted(gestures - set(card.vocabulary))
    if unknown:
        raise SkinMismatchError(
            f"the recordings hold {', '.join(unknown)}, which the model does not know; "
            f"it knows {', '.join(card.vocabulary)}; evaluate it on other recordings, "
            "or train it on these gestures"
        )


def find_person(dataset: Dataset, recording: int) -> str:
    """Return the subject of a recording, or its session where that is unknown."""
    metadata = dataset.recordings[recording].metadata
    return metadata.subject or metadata.session


def compute_confidence(
    scores: Float[np.ndarray, "segment class"],
) -> Float[np.ndarray, "segment"]:
    """Return the probability of the likeliest class, from log-probabilities."""
    shares = np.exp(scores - scores.max(axis=1, keepdims=True))
    return 1.0 / shares.sum(axis=1)
