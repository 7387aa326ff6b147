"""Scoring continuous streams."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Int

from eskin.learn.events.counting import Delays, LeftAlone, Tally
from eskin.learn.events.marked import Marked, mark
from eskin.learn.events.matching import MatchConfig
from eskin.learn.events.score import EventScore
from eskin.learn.events.take import NO_GESTURE, Take
from eskin.learn.events.true_events import TrueEvent
from eskin.live import UNKNOWN
from eskin.recording import NONE
from eskin.units import NS_PER_S

NOTHING = "nothing"
"""Row of what was said of no event; column of events of which nothing was said."""

HOUR = 3600.0
"""[s]"""


def score_events(
    takes: Sequence[Take],
    vocabulary: Sequence[str],
    config: MatchConfig | None = None,
) -> EventScore:
    """Score what was said of continuous streams.

    Args:
        takes: the streams.
        vocabulary: of the recogniser; other gestures are unknown to it.
        config: when a detection is of an event.
    """
    every = [mark(take, config or MatchConfig()) for take in takes]
    gestures = tuple(name for name in vocabulary if name not in NO_GESTURE)
    names = (*gestures, NONE, UNKNOWN, NOTHING)
    people = sorted({take.subject for take in takes})
    confusion = np.zeros((len(names), len(names)), dtype=np.int64)
    for marked in every:
        confusion += confusion_of(marked, names)
    return EventScore(
        hours=sum(take.seconds for take in takes) / HOUR,
        per_gesture={name: tally_of(every, (name,)) for name in gestures},
        per_subject={
            person: tally_of([m for m in every if m.take.subject == person], gestures)
            for person in people
        },
        simultaneous=sum((at_once(marked, gestures) for marked in every), Tally()),
        delays={name: delays_of(every, name) for name in gestures},
        unknown=left_alone_of(
            every, lambda e: None if e.gesture in (*gestures, NONE) else e.gesture
        ),
        none=left_alone_of(
            every, lambda e: e.kind or NONE if e.gesture == NONE else None
        ),
        names=names,
        confusion=confusion,
        confidence=np.array(
            [m.take.detections[d].confidence for m in every for d in m.gestures], float
        ),
        right=np.array([d not in m.false for m in every for d in m.gestures], bool),
    )


def tally_of(every: Sequence[Marked], gestures: Sequence[str]) -> Tally:
    """Events and detections of some gestures."""
    total = Tally()
    for marked in every:
        made = [e.gesture in gestures for e in marked.take.events]
        matched = sum(made[event] for event in marked.matching.matched)
        said = (marked.take.detections[index].gesture for index in marked.false)
        false = sum(gesture in gestures for gesture in said)
        total += Tally(matched, sum(made) - matched, false)
    return total


def at_once(marked: Marked, gestures: Sequence[str]) -> Tally:
    """Events that overlap another one, and what was falsely said meanwhile."""
    made = np.array([e.gesture in gestures for e in marked.take.events], dtype=bool)
    wanted = made & marked.overlapping
    matched = int(wanted[list(marked.matching.matched)].sum())
    false = int(marked.said_meanwhile[list(marked.false)].sum())
    return Tally(matched, int(wanted.sum()) - matched, false)


def delays_of(every: Sequence[Marked], gesture: str) -> Delays:
    """When the matched detections of a gesture were said."""
    pairs = [
        (marked.take.events[event], marked.take.detections[found].stamp)
        for marked in every
        for event, found in sorted(marked.matching.matched.items())
        if marked.take.events[event].gesture == gesture
    ]
    return Delays(
        np.array([stamp - event.end for event, stamp in pairs], float) / NS_PER_S,
        np.array([stamp - event.onset for event, stamp in pairs], float) / NS_PER_S,
    )


def left_alone_of(
    every: Sequence[Marked], name_of: Callable[[TrueEvent], str | None]
) -> dict[str, LeftAlone]:
    """Events of which no gesture should be said, by a name; None leaves one out."""
    found: dict[str, LeftAlone] = {}
    for marked in every:
        for index, event in enumerate(marked.take.events):
            name = name_of(event)
            if name is not None:
                one = LeftAlone(1, int(marked.is_mistaken(index)))
                found[name] = found.get(name, LeftAlone()) + one
    return dict(sorted(found.items()))


def confusion_of(marked: Marked, names: Sequence[str]) -> Int[np.ndarray, "true said"]:
    """What was said of each event, and in the last row what else was said."""
    counts = np.zeros((len(names), len(names)), dtype=np.int64)
    place = {name: index for index, name in enumerate(names)}
    left = set(range(len(marked.take.detections)))
    for index, event in enumerate(marked.take.events):
        word = marked.word(index)
        said = NOTHING if word is None else marked.take.detections[word].gesture
        counts[place.get(event.gesture, place[UNKNOWN]), place[said]] += 1
        left.discard(-1 if word is None else word)
    for index in left:
        counts[place[NOTHING], place[marked.take.detections[index].gesture]] += 1
    return counts
