"""This module gathers what a recogniser says live at each row of a data set.

So recognisers of other packages are scored on the same rows, by the same truth, as
eskin's own network.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.learn.dataset import Dataset
from eskin.live import Model, Recognizer
from eskin.progress import track_progress
from eskin.recording import Recording
from eskin.skin import MountedSkin


@dataclass(frozen=True, eq=False)
class LiveAnswers:
    """Live answers hold logits from a replay, in place of a network that makes them."""

    logits: Float[np.ndarray, "row class"]
    """Logits of each row of a data set, while its touch is open."""
    closing: Float[np.ndarray, "row class"]
    """Logits of each row for the decision if its touch closes after it."""

    @property
    def classes(self) -> int:
        """Return the number of classes."""
        return self.logits.shape[1]


def gather_answers(model: Model, dataset: Dataset) -> LiveAnswers:
    """Replay all recordings of a data set through a recogniser.

    Args:
        model: weights and their card.
        dataset: data set of rows that were prepared with the pipeline of that card.
    """
    classes = len(model.card.vocabulary)
    logits = np.empty((len(dataset.stamps), 2, classes), np.float32)
    numbered = enumerate(dataset.recordings)
    for n, recording in track_progress(numbered, "Replaying", len(dataset.recordings)):
        rows = np.flatnonzero(dataset.recording == n)
        sequences = replay_sequences(recording, model)
        _, place = np.unique(dataset.sequence[rows], return_inverse=True)
        stamps = dataset.stamps[rows].tolist()
        pairs = zip(place.tolist(), stamps, strict=True)
        logits[rows] = [sequences[sequence][stamp] for sequence, stamp in pairs]
    return LiveAnswers(logits[:, 0], logits[:, 1])


def replay_sequences(
    recording: Recording, model: Model
) -> list[dict[int, Float[np.ndarray, "2 class"]]]:
    """Return the logits of each sequence of confirmed touches, by stamp.

    The first row is for an open touch, the second for one that closes.
    Sequences are in the order in which they begin, as in a prepared recording.
    """
    mounted = MountedSkin(recording.skin, recording.load_robot())
    recognizer = Recognizer(model, mounted, recording.calibration)
    sequences: dict[int, dict[int, Float[np.ndarray, "2 class"]]] = {}
    confirmed: set[int] = set()
    for scan in recording.scans():
        recognizer.push(scan)
        closing = recognizer.classifier.closing_logits
        for key, logits in recognizer.logits.items():
            both = np.stack([logits, closing[key]])
            sequences.setdefault(key, {})[scan.stamp] = both
        confirmed.update(map(recognizer.classifier.get_key, recognizer.probabilities))
    if not recording.skin.calibrated:
        return list(sequences.values())
    return [sequences[key] for key in sorted(confirmed)]
