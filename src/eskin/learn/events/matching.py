"""Matching."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from eskin.learn.events.true_events import TrueEvent
from eskin.live import UNKNOWN, Detection
from eskin.recording import NONE
from eskin.units import NS_PER_S

NO_GESTURE = (NONE, UNKNOWN)
"""What a detection may say that is no gesture."""


@dataclass(frozen=True, eq=False)
class ScoredStream:
    """What was done to a skin in one go, and what was said of it."""

    events: Sequence[TrueEvent]
    """What was done."""

    detections: Sequence[Detection]
    """What was said."""

    seconds: float
    """How long it took [s]."""

    subject: str
    """Who did it."""


FORBIDDEN = 1e9
"""Cost of a pair that does not match; onsets are never so many seconds apart."""


@dataclass(frozen=True)
class MatchConfig:
    """When a detection is of an event."""

    late: float = 1.0
    """How long after the last contact it may be said [s]."""

    near: float = 0.1
    """How far from the true path it may be [m]."""

    around: float = 0.5
    """How far in time from the detection's last contact the true path is looked at,
    since it moves with its link [s]."""


@dataclass(frozen=True)
class Matching:
    """Detections and the events that they are of."""

    matched: dict[int, int]
    """Index of the detection of each event that was recognised, by the event's."""

    blamed: dict[int, int]
    """Index of the event that each other detection was about, by the detection's; those
    that were about nothing are in neither."""


def match_events(
    events: Sequence[TrueEvent],
    detections: Sequence[Detection],
    config: MatchConfig | None = None,
) -> Matching:
    """Match one to one: as many as possible, and of those ways the best in time.

    A detection matches an event of the same gesture if it was said between its onset
    and a while after its end, near its path. Of all matchings with the most pairs it is
    the one in which the onsets of touch and event agree best. What is left is about the
    event, of any gesture, with which its touch shares most time.
    """
    fitting = fits(events, detections, config or MatchConfig())
    named = np.array([event.gesture for event in events], dtype=np.str_)
    said = np.array([found.gesture for found in detections], dtype=np.str_)
    same = (named[:, None] == said) & ~np.isin(said, NO_GESTURE)
    cost = np.where(fitting & same, compute_onset_gaps(events, detections), FORBIDDEN)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    matched = {int(e): int(d) for e, d in pairs if cost[e, d] < FORBIDDEN}
    left = sorted(set(range(len(detections))) - set(matched.values()))
    about = {d: np.flatnonzero(fitting[:, d]) for d in left}
    blamed = {
        d: max(
            which.tolist(),
            key=lambda event: compute_overlap(events[event], detections[d]),
        )
        for d, which in about.items()
        if len(which)
    }
    return Matching(matched, blamed)


def fits(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Which detections are of the time and place of which events."""
    fitting = find_timely(events, detections, config)
    for event, found in np.argwhere(fitting).tolist():
        p_world, last = detections[found].p_world, detections[found].end
        distance = events[event].distance(p_world, last, config.around)
        fitting[event, found] = distance <= config.near
    return fitting


def find_timely(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Which detections were said between onset and a while after the end."""
    late = round(config.late * NS_PER_S)
    onsets = np.array([event.onset for event in events], dtype=np.int64)
    ends = np.array([event.end for event in events], dtype=np.int64)
    stamps = np.array([found.stamp for found in detections], dtype=np.int64)
    return (stamps >= onsets[:, None]) & (stamps <= ends[:, None] + late)


def compute_onset_gaps(
    events: Sequence[TrueEvent], detections: Sequence[Detection]
) -> Float[np.ndarray, "event detection"]:
    """How far apart the onsets of events and of detected touches are [s]."""
    onsets = np.array([event.onset for event in events], dtype=np.int64)
    starts = np.array([found.onset for found in detections], dtype=np.int64)
    return np.abs(onsets[:, None] - starts) / NS_PER_S


def compute_overlap(event: TrueEvent, found: Detection) -> tuple[int, int]:
    """Time that an event and a detected touch share, negative if they are apart."""
    shared = min(event.end, found.end) - max(event.onset, found.onset)
    return shared, -abs(event.onset - found.onset)


@dataclass(frozen=True, eq=False)
class MatchedStream:
    """A stream, and which of its detections are of which of its events."""

    take: ScoredStream
    """The stream."""

    matching: Matching
    """Of its events and detections."""

    config: MatchConfig
    """How they were matched."""

    def word(self, event: int) -> int | None:
        """Index of the detection that stands for an event; None where there is none.

        It is its match, or else the nearest that was about it, a gesture if possible.
        """
        if event in self.matching.matched:
            return self.matching.matched[event]
        truth, said = self.take.events[event], self.take.detections
        about = [d for d, blamed in self.matching.blamed.items() if blamed == event]
        return max(
            about,
            key=lambda d: (
                said[d].gesture not in NO_GESTURE,
                compute_overlap(truth, said[d]),
            ),
            default=None,
        )

    def is_mistaken(self, event: int) -> bool:
        """Whether an event that is no gesture was said to be one."""
        word = self.word(event)
        return word is not None and self.take.detections[word].gesture not in NO_GESTURE

    @property
    def gestures(self) -> tuple[int, ...]:
        """Indices of the detections of a gesture."""
        every = enumerate(self.take.detections)
        return tuple(index for index, d in every if d.gesture not in NO_GESTURE)

    @property
    def false(self) -> tuple[int, ...]:
        """Indices of the detections of a gesture that match no event."""
        matched = set(self.matching.matched.values())
        return tuple(index for index in self.gestures if index not in matched)

    @property
    def overlapping(self) -> Bool[np.ndarray, "event"]:
        """Which events overlap another one in time."""
        onsets = np.array([e.onset for e in self.take.events], dtype=np.int64)
        ends = np.array([e.end for e in self.take.events], dtype=np.int64)
        together = (onsets[:, None] <= ends) & (onsets <= ends[:, None])
        return together.sum(axis=1) > 1

    @property
    def is_during_overlap(self) -> Bool[np.ndarray, "detection"]:
        """Which detections were said when one of an overlapping event might be."""
        events, detections = self.take.events, self.take.detections
        timely = find_timely(events, detections, self.config)
        return np.any(timely[self.overlapping], axis=0, keepdims=True)[0]


def match_stream(take: ScoredStream, config: MatchConfig) -> MatchedStream:
    """Compare what was done with what was said."""
    return MatchedStream(
        take, match_events(take.events, take.detections, config), config
    )
