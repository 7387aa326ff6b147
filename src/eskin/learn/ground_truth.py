"""This module reads what truly happened in a recording: clips, touches and labels."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import RecordingError
from eskin.recording import NONE, Label, Recording, select_labels
from eskin.units import NS_PER_S

INDEX_NAME = "clips.jsonl"


@dataclass(frozen=True)
class Clip:
    """One clip: what was done in two seconds of a recording."""

    start: int
    """Stamp of its first reading [ns since the epoch]."""
    end: int
    """Stamp behind its last one [ns since the epoch]."""
    gesture: str
    """What it was made for."""
    kind: str
    """Variant of the gesture."""


def read_clips(path: Path) -> tuple[Clip, ...]:
    """The clips of a recording, in order; none where it is no file of a set of clips.

    Raises:
        RecordingError: there is an index that cannot be read.
    """
    for folder in (path.parent, path.parent.parent):
        index = folder / INDEX_NAME
        if index.is_file():
            name = path.relative_to(folder).as_posix()
            return read_clip_index(index).get(name, ())
    return ()


@lru_cache(maxsize=4)
def read_clip_index(index: Path) -> dict[str, tuple[Clip, ...]]:
    """The clips of each file of a set."""
    found: dict[str, list[Clip]] = {}
    for number, line in enumerate(index.read_text(encoding="utf-8").splitlines(), 1):
        try:
            facts = json.loads(line)
            if facts["gesture"]:
                start, seconds = int(facts["start"]), float(facts["plan"]["seconds"])
                clip = Clip(
                    start,
                    start + round(seconds * NS_PER_S),
                    str(facts["gesture"]),
                    str(facts["kind"]),
                )
                found.setdefault(str(facts["file"]), []).append(clip)
        except (ValueError, KeyError, TypeError) as error:
            raise RecordingError(
                f"{index} line {number} is no clip ({type(error).__name__}: {error}); "
                "run the same eskin generate again to repair it"
            ) from error
    return {name: tuple(clips) for name, clips in found.items()}


MAX_DISTANCE = 0.1
"""Farthest that a contact may be from the centre of the true touch it is of [m]."""


class TouchLabel(NamedTuple):
    """What a sequence truly is."""

    touch: int
    """Number of the touch in its file."""
    gesture: str
    """What was done."""
    kind: str
    """Variant of the gesture."""


@dataclass(frozen=True, eq=False)
class TrueTouches:
    """Every true touch of a recording at every reading at which it presses."""

    stamps: Int[np.ndarray, "truth"]
    """Ascending [ns since the epoch]."""
    touch: Int[np.ndarray, "truth"]
    """Number of the touch in its file."""
    p_world: Float[np.ndarray, "truth 3"]
    """Centre of its force [m]."""
    names: dict[int, TouchLabel]
    """What each touch is, by its number."""

    def fit(
        self,
        stamps: Int[np.ndarray, "row"],
        centres: Float[np.ndarray, "row 3"],
        forces: Float[np.ndarray, "row"],
    ) -> TouchLabel | None:
        """The true touch that most of the force of a sequence lies near.

        Args:
            stamps: of the sequence's readings [ns since the epoch].
            centres: of its contacts [m]; NaN without contact.
            forces: of these contacts [N].
        """
        votes: dict[int, float] = {}
        lows = np.searchsorted(self.stamps, stamps, side="left").tolist()
        highs = np.searchsorted(self.stamps, stamps, side="right").tolist()
        for row, (low, high) in enumerate(zip(lows, highs, strict=True)):
            if low == high or forces[row] <= 0:
                continue
            gaps = np.linalg.norm(self.p_world[low:high] - centres[row], axis=1)
            nearest = int(gaps.argmin())
            if gaps[nearest] <= MAX_DISTANCE:
                number = int(self.touch[low + nearest])
                votes[number] = votes.get(number, 0.0) + float(forces[row])
        return self.names[max(votes, key=lambda n: (votes[n], -n))] if votes else None


def read_true_touches(recording: Recording) -> TrueTouches | None:
    """The truth of a recording; None where it is not known."""
    if not recording.metadata.simulated:
        return None
    records = sorted(recording.truths(), key=lambda truth: (truth.stamp, truth.touch))
    return TrueTouches(
        stamps=np.array([truth.stamp for truth in records], dtype=np.int64),
        touch=np.array([truth.touch for truth in records], dtype=np.int64),
        p_world=np.array([t.p_world for t in records], dtype=np.float64).reshape(-1, 3),
        names={t.touch: TouchLabel(t.touch, t.gesture, t.kind) for t in records},
    )


LINGER_NS = 600_000_000
"""How long after its end a gesture on a calibrated skin is still asked for [ns]."""

LAST_STAMP = 2**63 - 1
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
class MissedGesture:
    """One labelled gesture that nothing was detected of."""

    gesture: str
    """What was done."""

    recording: int
    """Index into `Dataset.recordings`."""


def extend_labels(recording: Recording) -> list[Label]:
    """Its best labels, as long as its touches keep their gesture.

    On a calibrated skin a label lasts 0.6 s longer, or until the next one: a touch
    keeps its gesture until it closes.
    """
    truth = select_labels(recording.labels)
    if not truth or not recording.skin.calibrated:
        return list(truth)
    nexts = [label.start for label in truth[1:]] + [LAST_STAMP]
    return [
        replace(label, end=max(label.end, min(label.end + LINGER_NS, start)))
        for label, start in zip(truth, nexts, strict=True)
    ]


def find_label_indices(
    labels: list[Label], stamps: Int[np.ndarray, "row"]
) -> Int[np.ndarray, "row"]:
    """Index of the label at each stamp, the one that started last; -1 in silence."""
    places = np.full(len(stamps), -1)
    for place, label in enumerate(labels):
        places[(stamps >= label.start) & (stamps < label.end)] = place
    return places


def look_up_gestures(labels: list[Label], places: Int[np.ndarray, "row"]) -> list[str]:
    """The gesture at each row, `none` in silence."""
    return [labels[place].gesture if place >= 0 else NONE for place in places]


def build_labelled_segments(
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
    names = look_up_gestures(labels, places)
    return [
        Segment(
            names[first],
            recording,
            offset + first,
            offset + end,
            bool(places[first] >= 0),
        )
        for first, end in find_runs(np.stack([places, sequence], axis=1))
    ]


def build_true_segments(
    sequence: Int[np.ndarray, "row"],
    fits: Sequence[TouchLabel | None],
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
    for first, end in find_runs(sequence[:, None]):
        fit = fits[sequence[first]]
        gesture = fit.gesture if fit else NONE
        found.append(Segment(gesture, recording, offset + first, offset + end, True))
    return found


def find_runs(values: Int[np.ndarray, "row value"]) -> list[tuple[int, int]]:
    """First row of each run of equal values, and the row behind its last."""
    if not len(values):
        return []
    breaks = np.flatnonzero((values[1:] != values[:-1]).any(axis=1)) + 1
    bounds = [0, *breaks.tolist(), len(values)]
    return list(zip(bounds[:-1], bounds[1:], strict=True))


def find_missed_gestures(
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
