"""This module reads the true events of a recording: what touched, when and where."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.recording import Label, Recording, TruthRecord, select_labels
from eskin.units import NS_PER_S

GESTURE_ALIASES = {"tap_many": "double_pat"}
"""Gestures that count as another one: three or more pats are a double pat."""


@dataclass(frozen=True, eq=False)
class TrueEvent:
    """A true event is one touch as it really was."""

    onset: int
    """Stamp of the first contact [ns since the epoch]."""

    end: int
    """Stamp of the last contact [ns since the epoch]."""

    gesture: str
    """Gesture of the vocabulary, `none`, or another one."""

    kind: str
    """Variant of the gesture; empty where it is not known."""

    stamps: Int[np.ndarray, "point"]
    """Stamp of each point of the path, increasing [ns since the epoch]."""

    path: Float[np.ndarray, "point 3"]
    """Centre of the force in the world at each stamp [m]; empty where it is not
    known."""

    def compute_distance(
        self, p_world: Float[np.ndarray, "3"], stamp: int, around: float
    ) -> float:
        """Return how far a point is from the path of the touch around an instant [m].

        The path moves with its link, so only the part near the instant in time counts,
        or the point that is nearest in time where no part is near.

        Args:
            p_world: position of the point [m].
            stamp: stamp of the instant [ns since the epoch].
            around: largest distance in time of the points that count [s].

        Returns:
            The distance, zero where the path is not known.
        """
        if not len(self.path):
            return 0.0
        apart = np.abs(self.stamps - stamp)
        near = apart <= max(round(around * NS_PER_S), int(apart.min()))
        return float(np.linalg.norm(self.path[near] - p_world, axis=1).min())


def read_true_events(recording: Recording) -> tuple[TrueEvent, ...]:
    """Return every touch of a recording, sorted by its onset.

    They come from `/eskin/truth`, which also has those that overlap; where there is
    none, from the best labels.
    """
    found = build_events(recording.truths())
    found = found or [
        build_label_event(label) for label in select_labels(recording.labels)
    ]
    return tuple(sorted(found, key=lambda event: (event.onset, event.end)))


def build_events(truths: Iterable[TruthRecord]) -> list[TrueEvent]:
    """Return one event for every touch of the truth."""
    touches: dict[int, list[TruthRecord]] = {}
    for truth in truths:
        touches.setdefault(truth.touch, []).append(truth)
    return [build_touch_event(records) for records in touches.values()]


def build_touch_event(records: Sequence[TruthRecord]) -> TrueEvent:
    """Return the event of one touch from its records, sorted by time."""
    first, last = records[0], records[-1]
    return TrueEvent(
        onset=first.stamp,
        end=last.stamp,
        gesture=GESTURE_ALIASES.get(first.gesture, first.gesture),
        kind=first.kind,
        stamps=np.array([record.stamp for record in records], dtype=np.int64),
        path=np.array([record.p_world for record in records]),
    )


def build_label_event(label: Label) -> TrueEvent:
    """Return the event that a label describes."""
    return TrueEvent(
        onset=label.start,
        end=label.end,
        gesture=GESTURE_ALIASES.get(label.gesture, label.gesture),
        kind="",
        stamps=np.empty(0, dtype=np.int64),
        path=np.empty((0, 3)),
    )
