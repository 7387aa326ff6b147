"""True events and detections on a table, by seconds and metres along it."""

import numpy as np

from eskin.learn.events import ScoredStream, TrueEvent
from eskin.live import Detection

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
VOCABULARY = ("none", "poke", "stroke", "grab")


def stamp(seconds) -> int:
    return START + round(seconds * SECOND)


def event(onset, end, gesture="poke", x=0.0, to=None, kind="") -> TrueEvent:
    """A touch that goes from one place to another at 50 Hz."""
    times = np.arange(onset, end + 0.01, 0.02)
    path = np.zeros((len(times), 3))
    path[:, 0] = np.linspace(x, x if to is None else to, len(times))
    stamps = np.array([stamp(t) for t in times])
    return TrueEvent(stamp(onset), stamp(end), gesture, kind, stamps, path)


def nowhere(onset, end, gesture="poke") -> TrueEvent:
    """A touch of which the place is not known, as from a label."""
    none = np.empty(0, np.int64), np.empty((0, 3))
    return TrueEvent(stamp(onset), stamp(end), gesture, "", *none)


def said(at, gesture="poke", x=0.0, onset=None, end=None, sure=0.9) -> Detection:
    """A detection said at a time, of a touch that began a moment before."""
    return Detection(
        stamp=stamp(at),
        touch=1,
        gesture=gesture,
        confidence=sure,
        onset=stamp(at - 0.2 if onset is None else onset),
        end=stamp(at if end is None else end),
        link="table",
        patch="grid",
        p_world=np.array([x, 0.0, 0.0]),
        n_world=np.array([0.0, 0.0, 1.0]),
        direction_world=np.zeros(3),
        peak_force=1.0,
    )


def take(events, detections, seconds=3600.0, subject="ann") -> ScoredStream:
    return ScoredStream(tuple(events), list(detections), seconds, subject)


def answers(events, gestures=None) -> list[Detection]:
    """One detection at the end of each event, of its gesture or another."""
    return [
        said(
            (e.end - START) / SECOND + 0.1,
            e.gesture if gestures is None else gestures[i],
            e.path[-1, 0],
            (e.onset - START) / SECOND,
            (e.end - START) / SECOND,
        )
        for i, e in enumerate(events)
    ]
