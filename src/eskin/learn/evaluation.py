"""This module scores a trained recogniser on recordings."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import RecordingError, SkinMismatchError
from eskin.learn.dataset import Dataset
from eskin.learn.metrics import (
    ClassificationScore,
    Reliability,
    bootstrap_accuracy,
    compute_group_accuracies,
    compute_reliability,
    score_predictions,
)
from eskin.learn.scoring import predict_clips, score_instants, score_segments
from eskin.model import ModelCard
from eskin.nn import RecogniserNetwork
from eskin.recording import NONE


@dataclass(frozen=True)
class Evaluation:
    """An evaluation says how well a recogniser does on some recordings."""

    segments: ClassificationScore
    """Scores on whole gestures: the clips of a generated set, else labelled segments.
    The answer to an undetected gesture is `none`; where no label says `none`, it is not
    an answer otherwise."""

    interval: tuple[float, float]
    """95 % bootstrap confidence interval of that accuracy; whole people are drawn."""

    instants: ClassificationScore | None
    """Scores at every instant, `none` among the classes; None for clips, which end too
    soon to tell (streams do)."""

    per_subject: dict[str, float]
    """Accuracy on segments of each person, or session where people are not known."""

    reliability: Reliability
    """Accuracy of the answers by their confidence."""

    @property
    def ece(self) -> float:
        """Return the expected calibration error."""
        return self.reliability.error


class Predictions(NamedTuple):
    """Predictions hold the answers to examples of a data set."""

    truth: Int[np.ndarray, "example"]
    predicted: Int[np.ndarray, "example"]
    confidence: Float[np.ndarray, "example"]
    recording: Int[np.ndarray, "example"]


def evaluate(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> Evaluation:
    """Score a network on prepared recordings.

    Raises:
        RecordingError: if the recordings have no labels.
        SkinMismatchError: if the recordings lack what the model needs, or hold
            gestures that it does not know.
    """
    check_fits(card, dataset)
    vocabulary = list(card.vocabulary)
    found = (classify_clips if any(dataset.clips) else classify_labelled)(
        network, card, dataset
    )
    people = [find_person(dataset, recording) for recording in found.recording.tolist()]
    correct = found.predicted == found.truth
    return Evaluation(
        segments=score_predictions(found.truth, found.predicted, vocabulary),
        interval=bootstrap_accuracy(correct, cluster=people),
        instants=None
        if any(dataset.clips)
        else evaluate_instants(network, card, dataset),
        per_subject=compute_group_accuracies(correct, people),
        reliability=compute_reliability(found.confidence, correct),
    )


def evaluate_instants(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> ClassificationScore:
    """Score the answers at every row."""
    rows = np.arange(len(dataset.stamps))
    scores = score_instants(network, dataset, rows, card.temperature)
    now = np.array([card.vocabulary.index(gesture) for gesture in dataset.gestures])
    return score_predictions(now, scores.argmax(axis=1), card.vocabulary)


def classify_clips(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> Predictions:
    """Return the answers to the clips of generated sets."""
    answers = predict_clips(network, dataset, card.vocabulary, card.temperature)
    confidence = np.exp(answers.log_probabilities.max(axis=1))
    return Predictions(answers.truth, answers.predicted, confidence, answers.recording)


def classify_labelled(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> Predictions:
    """Return the answers to labelled gestures; `none` for undetected ones."""
    vocabulary = list(card.vocabulary)
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
            "the recordings have no labels; scoring needs them; make some with: "
            "eskin label REC"
        )
    if card.kind == "shear" and not dataset.has_shear:
        raise SkinMismatchError(
            "the model needs shear, which these recordings do not have; allowed are "
            "recordings of skins with shear; train a model with --train.no-shear"
        )
    made = {*dataset.gestures, *(example.gesture for example in dataset.missed)}
    made |= {clip.gesture for clips in dataset.clips for clip in clips}
    unknown = sorted(made - set(card.vocabulary))
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
