"""This module reads the true events of recordings and matches detections to them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from eskin.live import UNKNOWN, Detection
from eskin.recording import NONE, Label, Recording, TruthRecord
from eskin.units import NS_PER_S

GESTURE_ALIASES = {"tap_many": "double_pat"}
"""Gestures that count as another one: three or more pats are a double pat."""


@dataclass(frozen=True, eq=False)
class TrueEvent:
    """A true event is one touch of the ground truth."""

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
    """Centre of the force in the world at each stamp [m]; empty if unknown."""

    def compute_distance(
        self, p_world: Float[np.ndarray, "3"], stamp: int, around: float
    ) -> float:
        """Return the distance of a point from the path of the touch [m].

        The path moves with its link, so only its points near `stamp` in time count, or
        else the point nearest in time. Zero where the path is unknown.

        Args:
            p_world: position of the point [m].
            stamp: stamp at which the distance is taken [ns since the epoch].
            around: largest distance in time of the points that count [s].
        """
        if not len(self.path):
            return 0.0
        gaps = np.abs(self.stamps - stamp)
        near = gaps <= max(round(around * NS_PER_S), int(gaps.min()))
        return float(np.linalg.norm(self.path[near] - p_world, axis=1).min())


def read_true_events(recording: Recording) -> tuple[TrueEvent, ...]:
    """Return the true events of a recording, sorted by onset.

    They come from `/eskin/truth`, which also has those that overlap; where there is
    none, from the labels that count.
    """
    labels = recording.label_set.inside
    events = build_events(recording.truths()) or list(map(build_label_event, labels))
    return tuple(sorted(events, key=lambda event: (event.onset, event.end)))


def build_events(truths: Iterable[TruthRecord]) -> list[TrueEvent]:
    """Return one event for every touch among records of the truth."""
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
    """A scored stream holds true events and detections of one continuous stream."""

    events: Sequence[TrueEvent]
    """True events."""
    detections: Sequence[Detection]
    """Detections of the recogniser."""
    seconds: float
    """Duration [s]."""
    subject: str
    """Person who touched."""


FORBIDDEN = 1e9
"""Cost of a pair that does not match; far above any gap of onsets [s]."""


@dataclass(frozen=True)
class MatchConfig:
    """These settings determine when a detection matches an event."""

    late: float = 1.0
    """Longest time from the last contact to the detection [s]."""
    near: float = 0.1
    """Largest distance from the true path [m]."""
    around: float = 0.5
    """Largest distance in time of the points of the path that count from the detected
    touch's last contact [s]; the path moves with its link."""


@dataclass(frozen=True)
class Matching:
    """A matching assigns detections to events."""

    matched: dict[int, int]
    """Index of the matching detection, by the index of each recognised event."""
    assigned: dict[int, int]
    """Index of the event with the most common time, by the index of each other
    detection; detections that fit no event are left out."""


def match_events(
    events: Sequence[TrueEvent],
    detections: Sequence[Detection],
    config: MatchConfig | None = None,
) -> Matching:
    """Match detections to events one to one, with as many pairs as possible.

    A detection fits an event in time if it was made between the event's onset and
    `MatchConfig.late` after its end, and in place if it is near its path; it matches if
    the gesture is the same. Of all matchings with the most pairs the one with the
    smallest gaps of onsets is chosen. Each other detection is assigned to the event it
    fits, of any gesture, with which its touch has the most time in common.
    """
    fits = find_candidates(events, detections, config or MatchConfig())
    true = np.array([event.gesture for event in events], dtype=np.str_)
    predicted = np.array([found.gesture for found in detections], dtype=np.str_)
    same = (true[:, None] == predicted) & ~np.isin(predicted, NO_GESTURE)
    cost = np.where(fits & same, compute_onset_gaps(events, detections), FORBIDDEN)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    matched = {int(e): int(d) for e, d in pairs if cost[e, d] < FORBIDDEN}
    assigned = {}
    for d in sorted(set(range(len(detections))) - set(matched.values())):
        candidates = np.flatnonzero(fits[:, d]).tolist()
        overlaps = [compute_overlap(events[e], detections[d]) for e in candidates]
        if candidates:
            assigned[d] = candidates[overlaps.index(max(overlaps))]
    return Matching(matched, assigned)


def find_candidates(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Return which detections fit which events in time and place."""
    fits = find_timely(events, detections, config)
    for event, n in np.argwhere(fits).tolist():
        p_world = detections[n].p_world
        last = detections[n].end
        distance = events[event].compute_distance(p_world, last, config.around)
        fits[event, n] = distance <= config.near
    return fits


def find_timely(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Return which detections fit which events in time."""
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
    """Return the time that event and touch have in common, negative if none.

    A second number, minus the gap of their onsets, breaks ties.
    """
    shared = min(event.end, found.end) - max(event.onset, found.onset)
    return shared, -abs(event.onset - found.onset)


@dataclass(frozen=True, eq=False)
class MatchedStream:
    """A matched stream is a scored stream with the matching of its detections."""

    stream: ScoredStream
    """Stream that was matched."""
    matching: Matching
    """Matching of its events and detections."""
    config: MatchConfig
    """Settings of the matching."""

    def find_detection(self, event: int) -> int | None:
        """Return the index of the detection that represents an event, or None.

        It is the matching one, or else that of those assigned to the event with the
        most common time, a gesture if possible.
        """
        if event in self.matching.matched:
            return self.matching.matched[event]
        true = self.stream.events[event]
        detections = self.stream.detections

        def rank(d: int) -> tuple[bool, tuple[int, int]]:
            is_gesture = detections[d].gesture not in NO_GESTURE
            return is_gesture, compute_overlap(true, detections[d])

        assigned = (d for d, e in self.matching.assigned.items() if e == event)
        return max(assigned, key=rank, default=None)

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
        numbered = enumerate(self.stream.detections)
        return tuple(index for index, d in numbered if d.gesture not in NO_GESTURE)

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
        """Return which detections fit an overlapping event in time."""
        events = self.stream.events
        detections = self.stream.detections
        timely = find_timely(events, detections, self.config)
        return np.any(timely[self.overlapping], axis=0, keepdims=True)[0]


def match_stream(stream: ScoredStream, config: MatchConfig) -> MatchedStream:
    """Match the events and detections of a stream."""
    matching = match_events(stream.events, stream.detections, config)
    return MatchedStream(stream, matching, config)
