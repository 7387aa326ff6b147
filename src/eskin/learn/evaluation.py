"""Scoring a trained recogniser on recordings."""

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
    """What a recogniser is worth on some recordings."""

    segments: ClassificationScore
    """On whole gestures: the clips of a generated set, else what labels speak of. Of
    what was not detected the answer is `none`; where no label says `none`, that is no
    answer."""

    interval: tuple[float, float]
    """95 % bootstrap interval of that accuracy; whole people are drawn."""

    instants: ClassificationScore | None
    """At every instant, `none` among the classes; None for clips, which end too soon to
    tell (streams do)."""

    per_subject: dict[str, float]
    """Accuracy on segments of each person, or session where people are not known."""

    reliability: Reliability
    """How sure the answers were, and how often right."""

    @property
    def ece(self) -> float:
        """Expected calibration error."""
        return self.reliability.error


class Predictions(NamedTuple):
    """Answers to examples of a data set."""

    truth: Int[np.ndarray, "example"]
    answer: Int[np.ndarray, "example"]
    confidence: Float[np.ndarray, "example"]
    recording: Int[np.ndarray, "example"]


def evaluate(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> Evaluation:
    """ClassificationScore a network on prepared recordings.

    Raises:
        RecordingError: if the recordings have no labels.
        SkinMismatchError: if the recordings lack what the model needs, or hold
            gestures that it does not know.
    """
    check_fits(card, dataset)
    vocabulary = list(card.vocabulary)
    found = (of_clips if any(dataset.clips) else of_labels)(network, card, dataset)
    people = [person(dataset, recording) for recording in found.recording.tolist()]
    right = found.answer == found.truth
    return Evaluation(
        segments=score_predictions(found.truth, found.answer, vocabulary),
        interval=bootstrap_accuracy(right, cluster=people),
        instants=None if any(dataset.clips) else at_instants(network, card, dataset),
        per_subject=compute_group_accuracies(right, people),
        reliability=compute_reliability(found.confidence, right),
    )


def at_instants(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> ClassificationScore:
    """Answers at every row."""
    rows = np.arange(len(dataset.stamps))
    scores = score_instants(network, dataset, rows, card.temperature)
    now = np.array([card.vocabulary.index(gesture) for gesture in dataset.gestures])
    return score_predictions(now, scores.argmax(axis=1), card.vocabulary)


def of_clips(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> Predictions:
    """Answers to the clips of generated sets."""
    answers = predict_clips(network, dataset, card.vocabulary, card.temperature)
    confidence = np.exp(answers.log_probabilities.max(axis=1))
    return Predictions(answers.truth, answers.answer, confidence, answers.recording)


def of_labels(
    network: RecogniserNetwork, card: ModelCard, dataset: Dataset
) -> Predictions:
    """Answers to what labels speak of; sure of `none` where nothing was detected."""
    vocabulary = list(card.vocabulary)
    segments = dataset.labelled
    made = [*segments, *dataset.missed]
    scores = score_segments(network, dataset, segments, card.temperature)
    if not any(segment.gesture == NONE for segment in segments):
        scores[:, vocabulary.index(NONE)] = -np.inf
    nothing = np.full(len(dataset.missed), vocabulary.index(NONE))
    return Predictions(
        truth=np.array([vocabulary.index(example.gesture) for example in made]),
        answer=np.concatenate([scores.argmax(axis=1), nothing]),
        confidence=np.append(confidence(scores), np.ones(len(nothing))),
        recording=np.array([example.recording for example in made]),
    )


def check_fits(card: ModelCard, dataset: Dataset) -> None:
    """Refuse recordings that the model cannot be scored on."""
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


def person(dataset: Dataset, recording: int) -> str:
    """The subject of a recording, or its session where the subject is not known."""
    metadata = dataset.recordings[recording].metadata
    return metadata.subject or metadata.session


def confidence(
    scores: Float[np.ndarray, "segment class"],
) -> Float[np.ndarray, "segment"]:
    """Probability of the winner, from mean log-probabilities."""
    shares = np.exp(scores - scores.max(axis=1, keepdims=True))
    return 1.0 / shares.sum(axis=1)
