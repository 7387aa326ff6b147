"""This module reads the ground truth of a recording: clips, true touches, labels."""

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import RecordingError
from eskin.files import read_file
from eskin.recording import NONE, Label, LabelSet, Recording
from eskin.units import NS_PER_S, format_count

logger = logging.getLogger(__name__)

INDEX_NAME = "clips.jsonl"
MAX_INDEX_BYTES = 256 << 20
"""Largest size of an index; a clip takes about 1.5 kB [bytes]."""


@dataclass(frozen=True)
class Clip:
    """A clip is two seconds of a recording in which one gesture is made."""

    start: int
    """Stamp of the first reading [ns since the epoch]."""
    end: int
    """Stamp just after the last reading [ns since the epoch]."""
    gesture: str
    """The gesture that the clip was generated for."""
    kind: str
    """Variant of the gesture."""


def read_clips(path: Path) -> tuple[Clip, ...]:
    """Return the clips of a recording in order; none if it is of no set of clips.

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
    """Return the clips of every file that an index lists."""
    found: dict[str, list[Clip]] = {}
    text = read_file(index, MAX_INDEX_BYTES).decode("utf-8", "replace")
    for number, line in enumerate(text.splitlines(), 1):
        try:
            facts = json.loads(line)
            if facts["gesture"]:
                start = int(facts["start"])
                seconds = float(facts["plan"]["seconds"])
                end = start + round(seconds * NS_PER_S)
                clip = Clip(start, end, str(facts["gesture"]), str(facts["kind"]))
                found.setdefault(str(facts["file"]), []).append(clip)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise RecordingError(
                f"{index} line {number} is no clip ({type(error).__name__}: {error}); "
                "run the same eskin generate again to repair it"
            ) from error
    return {name: tuple(clips) for name, clips in found.items()}


MAX_DISTANCE = 0.1
"""Largest distance between a contact and the true touch it belongs to [m]."""


class TouchLabel(NamedTuple):
    """A touch label names the true touch that a sequence belongs to."""

    touch: int
    """Number of the touch in its recording."""
    gesture: str
    """Gesture that was made."""
    kind: str
    """Variant of the gesture."""


@dataclass(frozen=True, eq=False)
class TrueTouches:
    """True touches are a table of every true touch at every reading with contact."""

    stamps: Int[np.ndarray, "truth"]
    """Stamp of each entry, ascending [ns since the epoch]."""
    touch: Int[np.ndarray, "truth"]
    """Number of the touch."""
    p_world: Float[np.ndarray, "truth 3"]
    """Centre of the force [m]."""
    labels: dict[int, TouchLabel]
    """Label of each touch, by its number."""

    def identify(
        self,
        stamps: Int[np.ndarray, "row"],
        centres: Float[np.ndarray, "row 3"],
        forces: Float[np.ndarray, "row"],
    ) -> TouchLabel | None:
        """Return the true touch nearest to most of the force of a sequence.

        Args:
            stamps: stamps of the sequence's readings [ns since the epoch].
            centres: centres of its contacts in the world [m]; NaN without contact.
            forces: forces of these contacts [N].
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
        return self.labels[max(votes, key=lambda n: (votes[n], -n))] if votes else None


def read_true_touches(recording: Recording) -> TrueTouches | None:
    """Return the true touches of a recording; None where they are unknown."""
    if not recording.metadata.simulated:
        return None
    records = sorted(recording.truths(), key=lambda truth: (truth.stamp, truth.touch))
    return TrueTouches(
        stamps=np.array([truth.stamp for truth in records], dtype=np.int64),
        touch=np.array([truth.touch for truth in records], dtype=np.int64),
        p_world=np.array([t.p_world for t in records], dtype=np.float64).reshape(-1, 3),
        labels={t.touch: TouchLabel(t.touch, t.gesture, t.kind) for t in records},
    )


LINGER_NS = 600_000_000
"""Largest extension of a label on a calibrated skin [ns]."""

LAST_STAMP = 2**63 - 1
"""Largest stamp [ns]."""


@dataclass(frozen=True)
class Segment:
    """A segment is a run of rows of one sequence with one gesture."""

    gesture: str
    """Gesture of the rows."""
    recording: int
    """Index into `Dataset.recordings`."""
    first: int
    """First row."""
    end: int
    """Row after the last one."""
    labelled: bool
    """Whether the gesture is labelled; without a label it is `none`."""


@dataclass(frozen=True)
class MissedGesture:
    """A missed gesture was labelled, but no touch was detected during it."""

    gesture: str
    """Gesture of the label."""
    recording: int
    """Index into `Dataset.recordings`."""


def extend_labels(recording: Recording) -> list[Label]:
    """Return the labels of a recording that count, until their touches close.

    On a calibrated skin a label is extended by 0.6 s, or up to the next one.
    """
    labels = recording.label_set.inside
    if not labels or not recording.skin.calibrated:
        return list(labels)
    nexts = [label.start for label in labels[1:]] + [LAST_STAMP]
    return [
        replace(label, end=max(label.end, min(label.end + LINGER_NS, start)))
        for label, start in zip(labels, nexts, strict=True)
    ]


def find_label_indices(
    labels: Sequence[Label], stamps: Int[np.ndarray, "row"]
) -> Int[np.ndarray, "row"]:
    """Return the index of the last label to start at each stamp, or -1."""
    label_index = np.full(len(stamps), -1)
    for index, label in enumerate(labels):
        label_index[(stamps >= label.start) & (stamps < label.end)] = index
    return label_index


def build_labelled_segments(
    labels: Sequence[Label],
    label_index: Int[np.ndarray, "row"],
    sequence: Int[np.ndarray, "row"],
    recording: int,
    offset: int,
) -> list[Segment]:
    """Return a segment for each run of one label, or of none, in a sequence.

    Args:
        labels: labels of the recording.
        label_index: index of the label at each row, -1 without one.
        sequence: number of the sequence of each row.
        recording: index of the recording of the rows.
        offset: row of the data set at which these rows begin.
    """
    segments = []
    for first, end in find_runs(np.stack([label_index, sequence], axis=1)):
        n = int(label_index[first])
        name = labels[n].gesture if n >= 0 else NONE
        segments.append(Segment(name, recording, offset + first, offset + end, n >= 0))
    return segments


def build_true_segments(
    sequence: Int[np.ndarray, "row"],
    touches: Sequence[TouchLabel | None],
    recording: int,
    offset: int,
) -> list[Segment]:
    """Return one segment for each sequence; segments of no true touch are `none`.

    Args are as in `build_labelled_segments`; `touches` holds that of each sequence.
    """
    segments = []
    for first, end in find_runs(sequence[:, None]):
        touch = touches[sequence[first]]
        name = touch.gesture if touch else NONE
        segments.append(Segment(name, recording, offset + first, offset + end, True))
    return segments


def find_runs(values: Int[np.ndarray, "row value"]) -> list[tuple[int, int]]:
    """Return the first row and the row after the last of each run of equal values."""
    if not len(values):
        return []
    breaks = np.flatnonzero((values[1:] != values[:-1]).any(axis=1)) + 1
    bounds = [0, *breaks.tolist(), len(values)]
    return list(zip(bounds[:-1], bounds[1:], strict=True))


@dataclass(frozen=True, eq=False)
class LabelMatch:
    """A label match tells which labels of a recording hold which of its touches."""

    recording: Recording
    """The recording."""
    labels: tuple[Label, ...]
    """Its labels, as `extend_labels` returns them."""
    label_index: Int[np.ndarray, "row"]
    """Index of the label at each row of a touch, -1 without one."""
    touches: Int[np.ndarray, "touch 2"]
    """Stamps of first and last reading of each touch [ns since the epoch]."""

    @property
    def label_set(self) -> LabelSet:
        """Return the labels of the recording with the touches that they must hold."""
        touches = self.touches if self.recording.skin.calibrated else None
        return replace(self.recording.label_set, touches=touches)

    @property
    def missed(self) -> tuple[Label, ...]:
        """Return the labels of gestures during which no touch was detected.

        Only a calibrated skin can miss one: others have a graph at every reading.
        """
        if not self.recording.skin.calibrated:
            return ()
        detected = set(self.label_index.tolist())
        return tuple(
            label
            for index, label in enumerate(self.labels)
            if index not in detected and label.gesture != NONE
        )


def match_labels(
    recording: Recording,
    stamps: Int[np.ndarray, "row"],
    sequence: Int[np.ndarray, "row"],
) -> LabelMatch:
    """Match the labels of a recording with its touches.

    Args:
        recording: the recording.
        stamps: stamps of the readings of its touches [ns since the epoch].
        sequence: number of the touch of each row; rows of one touch are neighbours.
    """
    labels = tuple(extend_labels(recording))
    runs = np.array(find_runs(sequence[:, None]), np.int64).reshape(-1, 2)
    touches = np.stack([stamps[runs[:, 0]], stamps[runs[:, 1] - 1]], axis=1)
    return LabelMatch(recording, labels, find_label_indices(labels, stamps), touches)


def warn_of_missed(matches: Sequence[LabelMatch]) -> None:
    """Tell how many labelled gestures were not felt, and the first of them."""
    missed = [(each.recording, label) for each in matches for label in each.missed]
    if missed:
        recording, first = missed[0]
        logger.warning(
            "%s; the first is '%s' at %.2f s of %s; what is not felt counts as missed",
            f"{format_count(len(missed), 'label')} without a touch",
            first.gesture,
            (first.start - recording.start) / NS_PER_S,
            recording.path,
        )
