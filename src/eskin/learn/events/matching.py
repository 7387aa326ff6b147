"""Which detection is of which true event."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from eskin.learn.events.take import NO_GESTURE
from eskin.learn.events.true_events import TrueEvent
from eskin.live import Detection
from eskin.units import NS_PER_S

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


def match(
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
    cost = np.where(fitting & same, onset_gaps(events, detections), FORBIDDEN)
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    matched = {int(e): int(d) for e, d in pairs if cost[e, d] < FORBIDDEN}
    left = sorted(set(range(len(detections))) - set(matched.values()))
    about = {d: np.flatnonzero(fitting[:, d]) for d in left}
    blamed = {
        d: max(
            which.tolist(), key=lambda event: closeness(events[event], detections[d])
        )
        for d, which in about.items()
        if len(which)
    }
    return Matching(matched, blamed)


def fits(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Which detections are of the time and place of which events."""
    fitting = are_in_time(events, detections, config)
    for event, found in np.argwhere(fitting).tolist():
        p_world, last = detections[found].p_world, detections[found].end
        distance = events[event].distance(p_world, last, config.around)
        fitting[event, found] = distance <= config.near
    return fitting


def are_in_time(
    events: Sequence[TrueEvent], detections: Sequence[Detection], config: MatchConfig
) -> Bool[np.ndarray, "event detection"]:
    """Which detections were said between onset and a while after the end."""
    late = round(config.late * NS_PER_S)
    onsets = np.array([event.onset for event in events], dtype=np.int64)
    ends = np.array([event.end for event in events], dtype=np.int64)
    stamps = np.array([found.stamp for found in detections], dtype=np.int64)
    return (stamps >= onsets[:, None]) & (stamps <= ends[:, None] + late)


def onset_gaps(
    events: Sequence[TrueEvent], detections: Sequence[Detection]
) -> Float[np.ndarray, "event detection"]:
    """How far apart the onsets of events and of detected touches are [s]."""
    onsets = np.array([event.onset for event in events], dtype=np.int64)
    starts = np.array([found.onset for found in detections], dtype=np.int64)
    return np.abs(onsets[:, None] - starts) / NS_PER_S


def closeness(event: TrueEvent, found: Detection) -> tuple[int, int]:
    """Time that an event and a detected touch share, negative if they are apart."""
    shared = min(event.end, found.end) - max(event.onset, found.onset)
    return shared, -abs(event.onset - found.onset)
