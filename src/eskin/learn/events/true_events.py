"""What really happened to a skin: every touch, when, where, and what it was."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.recording import Label, Recording, TruthRecord, select_labels
from eskin.units import NS_PER_S

GESTURE_ALIASES = {"tap_many": "double_pat"}
"""Names of gestures that count as another one: three or more pats are a double pat."""


@dataclass(frozen=True, eq=False)
class TrueEvent:
    """One touch as it really was."""

    onset: int
    """First contact [ns since the epoch]."""

    end: int
    """Last contact [ns since the epoch]."""

    gesture: str
    """One of a vocabulary, `none`, or something else."""

    kind: str
    """Variant of the gesture; empty where it is not known."""

    stamps: Int[np.ndarray, "point"]
    """When it was at each point of its path, increasing [ns since the epoch]."""

    path: Float[np.ndarray, "point 3"]
    """Centre of its force in the world [m]; without points where it is not known."""

    def distance(
        self, p_world: Float[np.ndarray, "3"], stamp: int, around: float
    ) -> float:
        """How far a point is from where the touch was about an instant [m].

        The path moves with its link, so only the part of it near in time counts; where
        it has none so near, its point that is nearest in time.

        Args:
            p_world: the point [m].
            stamp: the instant [ns since the epoch].
            around: how far in time a point of the path may be from it [s].

        Returns:
            Zero where the path is not known.
        """
        if not len(self.path):
            return 0.0
        apart = np.abs(self.stamps - stamp)
        near = apart <= max(round(around * NS_PER_S), int(apart.min()))
        return float(np.linalg.norm(self.path[near] - p_world, axis=1).min())


def read_true_events(recording: Recording) -> tuple[TrueEvent, ...]:
    """Every touch of a recording, by its onset.

    They come from `/eskin/truth`, which also has those that overlap; where there is
    none, from the best labels.
    """
    found = build_events(recording.truths())
    found = found or [
        build_label_event(label) for label in select_labels(recording.labels)
    ]
    return tuple(sorted(found, key=lambda event: (event.onset, event.end)))


def build_events(truths: Iterable[TruthRecord]) -> list[TrueEvent]:
    """One event for every touch of the truth."""
    touches: dict[int, list[TruthRecord]] = {}
    for truth in truths:
        touches.setdefault(truth.touch, []).append(truth)
    return [build_touch_event(records) for records in touches.values()]


def build_touch_event(records: Sequence[TruthRecord]) -> TrueEvent:
    """The event whose contact is in these records, in the order of time."""
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
    """The event that a label tells of."""
    return TrueEvent(
        onset=label.start,
        end=label.end,
        gesture=GESTURE_ALIASES.get(label.gesture, label.gesture),
        kind="",
        stamps=np.empty(0, dtype=np.int64),
        path=np.empty((0, 3)),
    )
