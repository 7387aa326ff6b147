"""Scoring a trained recogniser on recordings."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.errors import RecordingError, SkinMismatchError
from eskin.learn.dataset import Dataset
from eskin.learn.metrics import Score, by_group, calibration_error, score
from eskin.learn.scoring import instant_scores, segment_scores
from eskin.model import ModelCard
from eskin.nn import RecogniserNetwork
from eskin.recording import NONE


@dataclass(frozen=True)
class Evaluation:
    """What a recogniser is worth on some recordings."""

    segments: Score
    """On whole labelled gestures. Of what was not detected the answer is `none`;
    otherwise `none` is no answer where no label says it."""

    instants: Score
    """At every instant, `none` among the classes."""

    per_subject: dict[str, float]
    """Accuracy on segments of each person, or session where people are not known."""

    ece: float
    """Expected calibration error on the gestures that were detected."""


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
    segments = dataset.labelled
    made = [*segments, *dataset.missed]
    truth = np.array([vocabulary.index(example.gesture) for example in made])
    scores = segment_scores(network, dataset, segments, card.temperature)
    if not any(segment.gesture == NONE for segment in segments):
        scores[:, vocabulary.index(NONE)] = -np.inf
    nothing = np.full(len(dataset.missed), vocabulary.index(NONE))
    answered = np.concatenate([scores.argmax(axis=1), nothing])
    rows = np.arange(len(dataset.stamps))
    at_rows = instant_scores(network, dataset, rows, card.temperature).argmax(axis=1)
    now = np.array([vocabulary.index(gesture) for gesture in dataset.gestures])
    people = [person(dataset, example.recording) for example in made]
    right = answered == truth
    return Evaluation(
        segments=score(truth, answered, vocabulary),
        instants=score(now, at_rows, vocabulary),
        per_subject=by_group(right, people),
        ece=calibration_error(confidence(scores), right[: len(segments)]),
    )


def check_fits(card: ModelCard, dataset: Dataset) -> None:
    """Refuse recordings that the model cannot be scored on."""
    if not (dataset.labelled or dataset.missed):
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
