"""This module reads the true events of recordings and matches detections to them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from eskin.live import UNKNOWN, Detection
from eskin.recording import NONE, Label, Recording, TruthRecord, select_labels
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


NO_GESTURE = (NONE, UNKNOWN)
"""Answers of a detection that are not a gesture."""


@dataclass(frozen=True, eq=False)
class ScoredStream:
    """A scored stream holds what was done to a skin in one go and the detections."""

    events: Sequence[TrueEvent]
    """Events that truly happened."""
    detections: Sequence[Detection]
    """Detections of the recogniser."""
    seconds: float
    """Duration [s]."""
    subject: str
    """Person who touched."""


FORBIDDEN = 1e9
"""Cost of a pair that does not match; onsets are never this many seconds apart."""


@dataclass(frozen=True)
class MatchConfig:
    """These settings say when a detection matches an event."""

    late: float = 1.0
    """Longest time from the last contact to the detection [s]."""
    near: float = 0.1
    """Largest distance from the true path [m]."""
    around: float = 0.5
    """Part of the true path, which moves with its link, that counts before and after
    the detection's last contact [s]."""


@dataclass(frozen=True)
class Matching:
    """A matching assigns detections to events."""

    matched: dict[int, int]
    """Index of the matching detection of each recognised event, by the event's
    index."""
    assigned: dict[int, int]
    """Index of the event nearest to each other detection, by the detection's index;
    detections near no event are left out."""


def match_events(
    events: Sequence[TrueEvent],
    detections: Sequence[Detection],
    config: MatchConfig | None = None,
) -> Matching:
    """Match one to one: as many pairs as possible, the best in time among those.

    A detection matches an event of the same gesture if it was made between its onset
    and a while after its end, near its path. Of all matchings with the most pairs it is
    the one in which the onsets of touch and event agree best. Other detections are
    assigned to the event, of any gesture, with which their touch shares most time.
    """
    fitting = find_candidates(events, detections, config or MatchConfig())
    named = np.array([event.gesture for event in events], dtype=np.str_)
    said = np.array([found.gesture for found in detections], dtype=np.str_)
    same = (named[:, None] == said) & ~np.isin(said, NO_GESTURE)
    cost = np.where(fitting & same, compute_onset_gaps(events, detections), FORBIDDEN)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    matched = {int(e): int(d) for e, d in pairs if cost[e, d] < FORBIDDEN}
    left = sorted(set(range(len(detections))) - set(matched.values()))
    about = {d: np.flatnonzero(fitting[:, d]) for d in left}
    assigned = {
        d: max(
            which.tolist(),
            key=lambda event: compute_overlap(events[event], detections[d]),
        )
        for d, which in about.items()
        if len(which)
    }
    return Matching(matched, assigned)


def find_candidates(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Return which detections fit which events in time and place."""
    fitting = find_timely(events, detections, config)
    for event, found in np.argwhere(fitting).tolist():
        p_world, last = detections[found].p_world, detections[found].end
        distance = events[event].compute_distance(p_world, last, config.around)
        fitting[event, found] = distance <= config.near
    return fitting


def find_timely(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Return which detections were made between onset and a while after the end."""
    late = round(config.late * NS_PER_S)
    onsets = np.array([event.onset for event in events], dtype=np.int64)
    ends = np.array([event.end for event in events], dtype=np.int64)
    stamps = np.array([found.stamp for found in detections], dtype=np.int64)
    return (stamps >= onsets[:, None]) & (stamps <= ends[:, None] + late)


def compute_onset_gaps(
    events: Sequence[TrueEvent], detections: Sequence[Detection]
) -> Float[np.ndarray, "event detection"]:
    """Return the time between the onsets of events and of detected touches [s]."""
    onsets = np.array([event.onset for event in events], dtype=np.int64)
    starts = np.array([found.onset for found in detections], dtype=np.int64)
    return np.abs(onsets[:, None] - starts) / NS_PER_S


def compute_overlap(event: TrueEvent, found: Detection) -> tuple[int, int]:
    """Return the time that event and touch share, negative if they are apart.

    A second number, the distance of their onsets, breaks ties.
    """
    shared = min(event.end, found.end) - max(event.onset, found.onset)
    return shared, -abs(event.onset - found.onset)


@dataclass(frozen=True, eq=False)
class MatchedStream:
    """A matched stream says which detections belong to which events."""

    stream: ScoredStream
    """Stream that was matched."""
    matching: Matching
    """Matching of its events and detections."""
    config: MatchConfig
    """Settings of the matching."""

    def find_detection(self, event: int) -> int | None:
        """Return the index of the detection that stands for an event, or None.

        It is the matching one, or else the nearest of those assigned to the event, a
        gesture if possible.
        """
        if event in self.matching.matched:
            return self.matching.matched[event]
        truth, said = self.stream.events[event], self.stream.detections
        about = [
            d for d, assigned in self.matching.assigned.items() if assigned == event
        ]
        return max(
            about,
            key=lambda d: (
                said[d].gesture not in NO_GESTURE,
                compute_overlap(truth, said[d]),
            ),
            default=None,
        )

    def is_mistaken(self, event: int) -> bool:
        """Tell whether an event that is not a gesture was detected as one."""
        index = self.find_detection(event)
        return (
            index is not None
            and self.stream.detections[index].gesture not in NO_GESTURE
        )

    @property
    def gesture_detections(self) -> tuple[int, ...]:
        """Return the indices of the detections of a gesture."""
        every = enumerate(self.stream.detections)
        return tuple(index for index, d in every if d.gesture not in NO_GESTURE)

    @property
    def false_detections(self) -> tuple[int, ...]:
        """Return the indices of the detections of a gesture that match no event."""
        matched = set(self.matching.matched.values())
        return tuple(index for index in self.gesture_detections if index not in matched)

    @property
    def overlapping(self) -> Bool[np.ndarray, "event"]:
        """Return which events overlap another one in time."""
        onsets = np.array([e.onset for e in self.stream.events], dtype=np.int64)
        ends = np.array([e.end for e in self.stream.events], dtype=np.int64)
        together = (onsets[:, None] <= ends) & (onsets <= ends[:, None])
        return together.sum(axis=1) > 1

    @property
    def is_during_overlap(self) -> Bool[np.ndarray, "detection"]:
        """Return which detections were made while overlapping events could be."""
        events, detections = self.stream.events, self.stream.detections
        timely = find_timely(events, detections, self.config)
        return np.any(timely[self.overlapping], axis=0, keepdims=True)[0]


def match_stream(stream: ScoredStream, config: MatchConfig) -> MatchedStream:
    """Match the events and detections of a stream."""
    return MatchedStream(
        stream, match_events(stream.events, stream.detections, config), config
    )
