"""Segments: what the labels of a recording say of rows of readings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from eskin.learn.fitting import Fit
from eskin.recording import NONE, Label, Recording, best_labels

LINGER_NS = 600_000_000
"""How long after its end a gesture on a calibrated skin is still asked for [ns]."""

LATEST = 2**63 - 1
"""Later than every stamp [ns]."""


@dataclass(frozen=True)
class Segment:
    """One labelled gesture in one sequence of graphs."""

    gesture: str
    """What was done."""

    recording: int
    """Index into `Dataset.recordings`."""

    first: int
    """Its first row."""

    end: int
    """The row behind its last one."""

    labelled: bool
    """Whether a label says so; where there is none, it is `none` by silence."""


@dataclass(frozen=True)
class Missed:
    """One labelled gesture that nothing was detected of."""

    gesture: str
    """What was done."""

    recording: int
    """Index into `Dataset.recordings`."""


def labels_of(recording: Recording) -> list[Label]:
    """Its best labels, as long as its touches keep their gesture.

    On a calibrated skin a label lasts 0.6 s longer, or until the next one: a touch
    keeps its gesture until it closes.
    """
    truth = best_labels(recording.labels)
    if not truth or not recording.skin.calibrated:
        return list(truth)
    nexts = [label.start for label in truth[1:]] + [LATEST]
    return [
        replace(label, end=max(label.end, min(label.end + LINGER_NS, start)))
        for label, start in zip(truth, nexts, strict=True)
    ]


def places_at(
    labels: list[Label], stamps: Int[np.ndarray, "row"]
) -> Int[np.ndarray, "row"]:
    """Index of the label at each stamp, the one that started last; -1 in silence."""
    places = np.full(len(stamps), -1)
    for place, label in enumerate(labels):
        places[(stamps >= label.start) & (stamps < label.end)] = place
    return places


def gestures_at(labels: list[Label], places: Int[np.ndarray, "row"]) -> list[str]:
    """The gesture at each row, `none` in silence."""
    return [labels[place].gesture if place >= 0 else NONE for place in places]


def labelled_segments(
    labels: list[Label],
    places: Int[np.ndarray, "row"],
    sequence: Int[np.ndarray, "row"],
    recording: int,
    offset: int,
) -> list[Segment]:
    """One segment for each run of one label, or of silence, within a sequence.

    Args:
        labels: of the recording.
        places: index of the label at each row, -1 in silence.
        sequence: of each row.
        recording: the recording of the rows.
        offset: the place of the first row in the data set.
    """
    names = gestures_at(labels, places)
    return [
        Segment(
            names[first],
            recording,
            offset + first,
            offset + end,
            bool(places[first] >= 0),
        )
        for first, end in runs_of(np.stack([places, sequence], axis=1))
    ]


def fitted_segments(
    sequence: Int[np.ndarray, "row"],
    fits: Sequence[Fit | None],
    recording: int,
    offset: int,
) -> list[Segment]:
    """One segment for each sequence: what is no touch truly made is `none`.

    Args:
        sequence: of each row.
        fits: the true touch of each sequence.
        recording: the recording of the rows.
        offset: the place of the first row in the data set.
    """
    found = []
    for first, end in runs_of(sequence[:, None]):
        fit = fits[sequence[first]]
        gesture = fit.gesture if fit else NONE
        found.append(Segment(gesture, recording, offset + first, offset + end, True))
    return found


def runs_of(values: Int[np.ndarray, "row value"]) -> list[tuple[int, int]]:
    """First row of each run of equal values, and the row behind its last."""
    if not len(values):
        return []
    breaks = np.flatnonzero((values[1:] != values[:-1]).any(axis=1)) + 1
    bounds = [0, *breaks.tolist(), len(values)]
    return list(zip(bounds[:-1], bounds[1:], strict=True))


def missed_gestures(
    recording: Recording, labels: list[Label], felt: set[int]
) -> list[str]:
    """The gestures of a calibrated skin's labels that no touch was detected in.

    Args:
        recording: what was labelled.
        labels: its labels.
        felt: indices of the labels that rows have.
    """
    if not recording.skin.calibrated:
        return []
    return [
        label.gesture
        for place, label in enumerate(labels)
        if place not in felt
        and label.gesture != NONE
        and label.start <= recording.end
        and label.end > recording.start
    ]
