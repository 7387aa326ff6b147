"""Scoring."""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.learn.events.matching import (
    NO_GESTURE,
    MatchConfig,
    MatchedStream,
    ScoredStream,
    match_stream,
)
from eskin.learn.events.true_events import TrueEvent
from eskin.learn.metrics import Reliability, compute_reliability, resample_clusters
from eskin.live import UNKNOWN
from eskin.recording import NONE
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class Tally:
    """Events that were to be recognised, and what was said of them."""

    matched: int = 0
    """Events with a detection of the same gesture."""

    missed: int = 0
    """Events without."""

    false: int = 0
    """Detections of a gesture without such an event."""

    @property
    def precision(self) -> float:
        """Share of detections that match; NaN where there is none."""
        return share(self.matched, self.matched + self.false)

    @property
    def recall(self) -> float:
        """Share of events that match; NaN where there is none."""
        return share(self.matched, self.matched + self.missed)

    @property
    def f1(self) -> float:
        """Harmonic mean of both; NaN where there is neither event nor detection."""
        return share(2 * self.matched, 2 * self.matched + self.missed + self.false)

    def __add__(self, other: "Tally") -> "Tally":
        """Both together."""
        return Tally(
            self.matched + other.matched,
            self.missed + other.missed,
            self.false + other.false,
        )


@dataclass(frozen=True)
class NonGestureTally:
    """Events that are no gesture of the vocabulary, of which none should be said."""

    count: int = 0
    """How many there were."""

    mistaken: int = 0
    """How many of them were said to be a gesture."""

    @property
    def share(self) -> float:
        """Share that was mistaken; NaN where there was none."""
        return share(self.mistaken, self.count)

    def __add__(self, other: "NonGestureTally") -> "NonGestureTally":
        """Both together."""
        return NonGestureTally(self.count + other.count, self.mistaken + other.mistaken)


@dataclass(frozen=True, eq=False)
class Delays:
    """When matched detections were said."""

    after_end: Float[np.ndarray, "match"]
    """Since the true last contact; negative where said before it [s]."""

    after_onset: Float[np.ndarray, "match"]
    """Since the true first contact [s]."""

    def latency(self, percent: int) -> float:
        """A percentile of the time since the last contact [s]; NaN without matches."""
        return percentile(self.after_end, percent)

    def from_onset(self, percent: int) -> float:
        """A percentile of the time since the first contact [s]; NaN without matches."""
        return percentile(self.after_onset, percent)


def share(part: int, whole: int) -> float:
    """Part of a whole; NaN where there is nothing."""
    return part / whole if whole else float("nan")


def percentile(values: Float[np.ndarray, "value"], percent: int) -> float:
    """A percentile; NaN without values."""
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def bootstrap_f1(parts: Sequence[Tally], seed: int = 0) -> tuple[float, float]:
    """95 % bootstrap interval of F1, parts such as people drawn anew.

    NaN where there are no events, or only one part, which tells nothing of others.

    Args:
        parts: that do not depend on each other.
        seed: decides the draws.
    """
    counts = np.array([astuple(part) for part in parts], dtype=np.float64)
    if len(parts) < 2 or not counts.sum():
        return float("nan"), float("nan")
    matched, missed, false = resample_clusters(counts, seed).T
    whole = 2 * matched + missed + false
    f1 = 2 * matched[whole > 0] / whole[whole > 0]
    low, high = np.percentile(f1, [2.5, 97.5])
    return float(low), float(high)


ACCIDENTS = (
    "bump",
    "lean",
    "resting_hand",
    "brush",
    "cable",
    "self_contact",
    "electrical",
)
"""Kinds of touches that nobody means."""

HOUR = 3600.0
"""[s]"""


@dataclass(frozen=True, eq=False)
class EventScore:
    """What a recogniser is worth on continuous streams."""

    hours: float
    """How long the streams are [h]."""

    per_gesture: dict[str, Tally]
    """Of each gesture of the vocabulary but `none`."""

    per_subject: dict[str, Tally]
    """Of all gestures, of each person's streams."""

    simultaneous: Tally
    """Of events that overlap another one in time, of any gesture, and of what was
    falsely said meanwhile."""

    delays: dict[str, Delays]
    """Of the matched detections of each gesture."""

    unknown: dict[str, NonGestureTally]
    """Gestures that are not in the vocabulary, by their name."""

    none: dict[str, NonGestureTally]
    """Touches that are no gesture, by their kind."""

    names: tuple[str, ...]
    """Rows and columns of `confusion`: gestures, `none`, `unknown`, `nothing`."""

    confusion: Int[np.ndarray, "true said"]
    """One count an event, and in the last row what else was said."""

    confidence: Float[np.ndarray, "detection"]
    """Of every detection of a gesture."""

    right: Bool[np.ndarray, "detection"]
    """Which of these match an event."""

    @property
    def total(self) -> Tally:
        """Of all gestures."""
        return sum(self.per_gesture.values(), Tally())

    @property
    def f1_interval(self) -> tuple[float, float]:
        """95 % interval of the F1 of all gestures, from drawing people anew."""
        return bootstrap_f1(list(self.per_subject.values()))

    @property
    def false_per_hour(self) -> float:
        """False detections an hour; NaN where there is no time."""
        return self.total.false / self.hours if self.hours else float("nan")

    @property
    def all_delays(self) -> Delays:
        """Of all matched detections."""
        every = self.delays.values()
        return Delays(
            np.concatenate([d.after_end for d in every] or [np.empty(0)]),
            np.concatenate([d.after_onset for d in every] or [np.empty(0)]),
        )

    @property
    def reliability(self) -> Reliability:
        """How sure detections of gestures were, and how often right."""
        return compute_reliability(self.confidence, self.right)

    @property
    def unknown_total(self) -> NonGestureTally:
        """Gestures that are not in the vocabulary, all together."""
        return sum(self.unknown.values(), NonGestureTally())

    @property
    def accidents(self) -> NonGestureTally:
        """Touches that nobody means, all together."""
        kinds = (left for kind, left in self.none.items() if kind in ACCIDENTS)
        return sum(kinds, NonGestureTally())


NOTHING = "nothing"
"""Row of what was said of no event; column of events of which nothing was said."""
"""[s]"""


def score_events(
    takes: Sequence[ScoredStream],
    vocabulary: Sequence[str],
    config: MatchConfig | None = None,
) -> EventScore:
    """Score what was said of continuous streams.

    Args:
        takes: the streams.
        vocabulary: of the recogniser; other gestures are unknown to it.
        config: when a detection is of an event.
    """
    every = [match_stream(take, config or MatchConfig()) for take in takes]
    gestures = tuple(name for name in vocabulary if name not in NO_GESTURE)
    names = (*gestures, NONE, UNKNOWN, NOTHING)
    people = sorted({take.subject for take in takes})
    confusion = np.zeros((len(names), len(names)), dtype=np.int64)
    for marked in every:
        confusion += count_confusions(marked, names)
    return EventScore(
        hours=sum(take.seconds for take in takes) / HOUR,
        per_gesture={name: tally_gestures(every, (name,)) for name in gestures},
        per_subject={
            person: tally_gestures(
                [m for m in every if m.take.subject == person], gestures
            )
            for person in people
        },
        simultaneous=sum(
            (tally_overlapping(marked, gestures) for marked in every), Tally()
        ),
        delays={name: collect_delays(every, name) for name in gestures},
        unknown=tally_non_gestures(
            every, lambda e: None if e.gesture in (*gestures, NONE) else e.gesture
        ),
        none=tally_non_gestures(
            every, lambda e: e.kind or NONE if e.gesture == NONE else None
        ),
        names=names,
        confusion=confusion,
        confidence=np.array(
            [m.take.detections[d].confidence for m in every for d in m.gestures], float
        ),
        right=np.array([d not in m.false for m in every for d in m.gestures], bool),
    )


def tally_gestures(every: Sequence[MatchedStream], gestures: Sequence[str]) -> Tally:
    """Events and detections of some gestures."""
    total = Tally()
    for marked in every:
        made = [e.gesture in gestures for e in marked.take.events]
        matched = sum(made[event] for event in marked.matching.matched)
        said = (marked.take.detections[index].gesture for index in marked.false)
        false = sum(gesture in gestures for gesture in said)
        total += Tally(matched, sum(made) - matched, false)
    return total


def tally_overlapping(marked: MatchedStream, gestures: Sequence[str]) -> Tally:
    """Events that overlap another one, and what was falsely said meanwhile."""
    made = np.array([e.gesture in gestures for e in marked.take.events], dtype=bool)
    wanted = made & marked.overlapping
    matched = int(wanted[list(marked.matching.matched)].sum())
    false = int(marked.is_during_overlap[list(marked.false)].sum())
    return Tally(matched, int(wanted.sum()) - matched, false)


def collect_delays(every: Sequence[MatchedStream], gesture: str) -> Delays:
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


def tally_non_gestures(
    every: Sequence[MatchedStream], name_of: Callable[[TrueEvent], str | None]
) -> dict[str, NonGestureTally]:
    """Events of which no gesture should be said, by a name; None leaves one out."""
    found: dict[str, NonGestureTally] = {}
    for marked in every:
        for index, event in enumerate(marked.take.events):
            name = name_of(event)
            if name is not None:
                one = NonGestureTally(1, int(marked.is_mistaken(index)))
                found[name] = found.get(name, NonGestureTally()) + one
    return dict(sorted(found.items()))


def count_confusions(
    marked: MatchedStream, names: Sequence[str]
) -> Int[np.ndarray, "true said"]:
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
