"""This module scores the detections of a recogniser on continuous streams."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.learn.events.matching import (
    NO_GESTURE,
    MatchConfig,
    MatchedStream,
    ScoredStream,
    TrueEvent,
    match_stream,
)
from eskin.learn.metrics import (
    Reliability,
    bound_rate,
    bound_share,
    compute_reliability,
    resample_clusters,
)
from eskin.live import UNKNOWN
from eskin.recording import NONE
from eskin.units import NS_PER_S


class TouchGroup(Enum):
    """A group says what detecting a gesture is where no known gesture was made.

    The words follow reports on wake words, which give the misses at a number of false
    accepts an hour without speech, and words that sound alike in a table of their own.
    """

    ACCIDENT = "accident"
    """Nobody means the touch, or a thing makes it: every detection is an accident."""
    NEAR_WORD = "near-word"
    """A hand touches on purpose in a way that has no name."""
    OTHER_NAME = "other name"
    """A hand makes a gesture of the vocabulary under another name, by which it is no
    error to call it; by any other it is a near-word."""


GROUPS = {
    "bump": TouchGroup.ACCIDENT,
    "lean": TouchGroup.ACCIDENT,
    "resting_hand": TouchGroup.ACCIDENT,
    "brush": TouchGroup.ACCIDENT,
    "cable": TouchGroup.ACCIDENT,
    "self_contact": TouchGroup.ACCIDENT,
    "electrical": TouchGroup.ACCIDENT,
    "single_pat": TouchGroup.NEAR_WORD,
    "press": TouchGroup.NEAR_WORD,
    "squeeze_hold": TouchGroup.NEAR_WORD,
    "guiding": TouchGroup.NEAR_WORD,
    "rub": TouchGroup.NEAR_WORD,
    "tickle": TouchGroup.NEAR_WORD,
    # Grabs of what is too wide for a hand to close round it, which are presses.
    "full_hand": TouchGroup.NEAR_WORD,
    "fingers_thumb": TouchGroup.NEAR_WORD,
    "tips_thumb": TouchGroup.NEAR_WORD,
    "clasp": TouchGroup.NEAR_WORD,
    "squeeze": TouchGroup.OTHER_NAME,
}
"""TouchGroup of each kind of `none`, and of each gesture that is not in the vocabulary.

A brush is a body that stands and that the arm passes; a hand that a person draws over
the skin is a stroke, and its true gesture says so.
"""

OTHER_NAMES = {"squeeze": "grab"}
"""Gesture of the vocabulary that each kind of `TouchGroup.OTHER_NAME` may be called."""


def find_group(event: TrueEvent) -> TouchGroup:
    """Return the group of an event that is no gesture of the vocabulary.

    A touch of `none` whose kind is not known is an accident, and a gesture that nobody
    has listed is a near-word.
    """
    if event.gesture == NONE:
        return GROUPS.get(event.kind, TouchGroup.ACCIDENT)
    return GROUPS.get(event.gesture, TouchGroup.NEAR_WORD)


class DetectionOutcome(Enum):
    """An outcome says what one detection of a gesture is."""

    FOUND = "found"
    """It matches a gesture that was made."""
    WRONG_NAME = "wrong name"
    """A gesture of the vocabulary was made, and this names another one."""
    ACCIDENT = "accident"
    """Nobody meant a touch there, or nothing touched."""
    NEAR_WORD = "near-word"
    """A hand touched on purpose in a way that has no name."""
    DUPLICATE = "duplicate"
    """A gesture or a near-word has another detection already."""
    NO_ERROR = "no error"
    """It names a gesture that was made under another name."""


@dataclass(frozen=True)
class ErrorCount:
    """This count says what became of the gestures made, and what detections are."""

    hours: float = 0.0
    """Duration of the streams [h]."""
    made: int = 0
    """Number of gestures of the vocabulary that were made."""
    found: int = 0
    """Number of them that were detected by their name."""
    wrong_names: int = 0
    """Number of them that were detected as another gesture of the vocabulary."""
    accidents: int = 0
    """Number of detections that are an accident."""
    near_words: int = 0
    """Number of detections that are a near-word, one at most for each touch."""
    duplicates: int = 0
    """Number of detections of a touch that has another detection already."""
    no_errors: int = 0
    """Number of detections of a gesture that was made under another name."""

    @property
    def missed(self) -> int:
        """Return the number of gestures made that were not detected as any gesture."""
        return self.made - self.found - self.wrong_names

    @property
    def missed_share(self) -> float:
        """Return the share of the gestures made that were missed; NaN without any."""
        return compute_ratio(self.missed, self.made)

    @property
    def wrong_name_share(self) -> float:
        """Return the share of the gestures made with a wrong name; NaN without any."""
        return compute_ratio(self.wrong_names, self.made)

    @property
    def accidents_per_hour(self) -> float:
        """Return the number of accidents an hour of stream; NaN without time."""
        return self.accidents / self.hours if self.hours else float("nan")

    @property
    def accidents_interval(self) -> tuple[float, float]:
        """Return the 95 % interval of that, of a Poisson count (Garwood 1936) [1/h]."""
        return bound_rate(self.accidents, self.hours)

    def __add__(self, other: "ErrorCount") -> "ErrorCount":
        """Return the sum of two counts."""
        pairs = zip(astuple(self), astuple(other), strict=True)
        return ErrorCount(*(one + more for one, more in pairs))


@dataclass(frozen=True)
class Tally:
    """A tally counts events that should be recognised, and their detections."""

    matched: int = 0
    """Number of events with a matching detection."""
    missed: int = 0
    """Number of events without one."""
    false: int = 0
    """Number of detections of a gesture that match no event, of any outcome."""

    @property
    def precision(self) -> float:
        """Return the share of detections that match; NaN where there is none."""
        return compute_ratio(self.matched, self.matched + self.false)

    @property
    def recall(self) -> float:
        """Return the share of events that match; NaN where there is none."""
        return compute_ratio(self.matched, self.matched + self.missed)

    @property
    def f1(self) -> float:
        """Return the harmonic mean of both; NaN without events and detections."""
        return compute_ratio(
            2 * self.matched, 2 * self.matched + self.missed + self.false
        )

    def __add__(self, other: "Tally") -> "Tally":
        """Return the sum of two tallies."""
        return Tally(
            self.matched + other.matched,
            self.missed + other.missed,
            self.false + other.false,
        )


@dataclass(frozen=True)
class NonGestureTally:
    """This tally counts events that should not be detected as a gesture."""

    count: int = 0
    """Number of events."""
    mistaken: int = 0
    """Number of them that were detected as a gesture."""

    @property
    def share(self) -> float:
        """Return the share that was mistaken; NaN where there was none."""
        return compute_ratio(self.mistaken, self.count)

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of that share (Wilson 1927); NaN without events."""
        return bound_share(self.mistaken, self.count)

    def __add__(self, other: "NonGestureTally") -> "NonGestureTally":
        """Return the sum of two tallies."""
        return NonGestureTally(self.count + other.count, self.mistaken + other.mistaken)


@dataclass(frozen=True, eq=False)
class Delays:
    """Delays are the times of matching detections after the true contacts."""

    after_end: Float[np.ndarray, "match"]
    """Time since the true last contact; negative for a detection before it [s]."""
    after_onset: Float[np.ndarray, "match"]
    """Time since the true first contact [s]."""

    def latency(self, percent: int) -> float:
        """Return a percentile of the time since the last contact [s]; NaN if empty."""
        return compute_percentile(self.after_end, percent)

    def from_onset(self, percent: int) -> float:
        """Return a percentile of the time since the first contact [s]; NaN if empty."""
        return compute_percentile(self.after_onset, percent)


def compute_ratio(part: int, whole: int) -> float:
    """Return a part of a whole; NaN where the whole is zero."""
    return part / whole if whole else float("nan")


def compute_percentile(values: Float[np.ndarray, "value"], percent: int) -> float:
    """Return a percentile; NaN without values."""
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def bootstrap_f1(parts: Sequence[Tally], seed: int = 0) -> tuple[float, float]:
    """Return a 95 % bootstrap interval of F1 over independent tallies, as of people.

    It is NaN where there are no events, or only one tally.
    """
    counts = np.array([astuple(part) for part in parts], dtype=np.float64)
    if len(parts) < 2 or not counts.sum():
        return float("nan"), float("nan")
    matched, missed, false = resample_clusters(counts, seed).T
    whole = 2 * matched + missed + false
    f1 = 2 * matched[whole > 0] / whole[whole > 0]
    low, high = np.percentile(f1, [2.5, 97.5])
    return float(low), float(high)


HOUR = 3600.0  # [s]


@dataclass(frozen=True, eq=False)
class EventScore:
    """An event score holds the scores of a recogniser on continuous streams."""

    hours: float
    """Total duration of the streams [h]."""
    per_gesture: dict[str, Tally]
    """Tally of each gesture of the vocabulary but `none`."""
    per_subject: dict[str, Tally]
    """Tally of all gestures in each person's streams."""
    errors: dict[str, ErrorCount]
    """Errors in each person's streams."""
    near_words: dict[str, NonGestureTally]
    """Near-words by their kind; mistaken ones were detected as a gesture, and not as
    the one that they may be called."""
    simultaneous: Tally
    """Tally of gestures that overlap another event in time, and of the false detections
    during overlaps."""
    delays: dict[str, Delays]
    """Delays of the matching detections of each gesture."""
    unknown: dict[str, NonGestureTally]
    """Gestures that are not in the vocabulary, by their name."""
    none: dict[str, NonGestureTally]
    """Touches that are not a gesture, by their kind."""
    names: tuple[str, ...]
    """Rows and columns of `confusion`: gestures, `none`, `unknown`, `nothing`."""
    confusion: Int[np.ndarray, "true predicted"]
    """Number of events by true and by detected class; detections of no event are in the
    last row."""
    confidence: Float[np.ndarray, "detection"]
    """Confidence of every detection of a gesture."""
    correct: Bool[np.ndarray, "detection"]
    """Whether each of these matches an event."""

    @property
    def total(self) -> Tally:
        """Return the tally of all gestures."""
        return sum(self.per_gesture.values(), Tally())

    @property
    def total_errors(self) -> ErrorCount:
        """Return the errors in all streams."""
        return sum(self.errors.values(), ErrorCount())

    @property
    def total_near_words(self) -> NonGestureTally:
        """Return the tally of near-words of all kinds."""
        return sum(self.near_words.values(), NonGestureTally())

    @property
    def f1_interval(self) -> tuple[float, float]:
        """Return the 95 % bootstrap interval of the F1 of all gestures, over people."""
        return bootstrap_f1(list(self.per_subject.values()))

    @property
    def false_per_hour(self) -> float:
        """Return the number of detections an hour that match no event, of any outcome.

        NaN without time.
        """
        return self.total.false / self.hours if self.hours else float("nan")

    @property
    def all_delays(self) -> Delays:
        """Return the delays of all matching detections."""
        nothing = np.empty(0)
        delays = self.delays.values()
        return Delays(
            np.concatenate([nothing, *(d.after_end for d in delays)]),
            np.concatenate([nothing, *(d.after_onset for d in delays)]),
        )

    @property
    def reliability(self) -> Reliability:
        """Return the accuracy of detections of gestures by their confidence."""
        return compute_reliability(self.confidence, self.correct)

    @property
    def unknown_total(self) -> NonGestureTally:
        """Return the tally of all gestures that are not in the vocabulary."""
        return sum(self.unknown.values(), NonGestureTally())

    @property
    def accidents(self) -> NonGestureTally:
        """Return the tally of all touches of a known kind that nobody means."""
        tallies = (
            tally
            for kind, tally in self.none.items()
            if GROUPS.get(kind) is TouchGroup.ACCIDENT
        )
        return sum(tallies, NonGestureTally())


NOTHING = "nothing"
"""Row of detections of no event, and column of events without a detection."""


def score_events(
    streams: Sequence[ScoredStream],
    vocabulary: Sequence[str],
    config: MatchConfig | None = None,
) -> EventScore:
    """Score the detections on continuous streams.

    Args:
        streams: streams to score.
        vocabulary: classes of the recogniser; other gestures are unknown to it.
        config: settings of the matching.
    """
    matched = [match_stream(stream, config or MatchConfig()) for stream in streams]
    gestures = tuple(name for name in vocabulary if name not in NO_GESTURE)
    names = (*gestures, NONE, UNKNOWN, NOTHING)
    people = sorted({stream.subject for stream in streams})
    confusion = np.zeros((len(names), len(names)), dtype=np.int64)
    for each in matched:
        confusion += count_confusions(each, names)
    found = [(each, d) for each in matched for d in each.gesture_detections]
    return EventScore(
        hours=sum(stream.seconds for stream in streams) / HOUR,
        per_gesture={name: tally_gestures(matched, (name,)) for name in gestures},
        per_subject={
            person: tally_gestures(
                [m for m in matched if m.stream.subject == person], gestures
            )
            for person in people
        },
        errors={
            person: count_errors(
                [m for m in matched if m.stream.subject == person], gestures
            )
            for person in people
        },
        near_words=tally_near_words(matched, gestures),
        simultaneous=sum(
            (tally_overlapping(each, gestures) for each in matched), Tally()
        ),
        delays={name: collect_delays(matched, name) for name in gestures},
        unknown=tally_non_gestures(
            matched, lambda e: None if e.gesture in (*gestures, NONE) else e.gesture
        ),
        none=tally_non_gestures(
            matched, lambda e: e.kind or NONE if e.gesture == NONE else None
        ),
        names=names,
        confusion=confusion,
        confidence=np.array(
            [m.stream.detections[d].confidence for m, d in found], float
        ),
        correct=np.array([d not in m.false_detections for m, d in found], bool),
    )


def tally_gestures(matched: Sequence[MatchedStream], gestures: Sequence[str]) -> Tally:
    """Count events and detections of some gestures."""
    total = Tally()
    for each in matched:
        wanted = [e.gesture in gestures for e in each.stream.events]
        found = sum(wanted[event] for event in each.matching.matched)
        detected = (each.stream.detections[n].gesture for n in each.false_detections)
        false = sum(gesture in gestures for gesture in detected)
        total += Tally(found, sum(wanted) - found, false)
    return total


def count_errors(
    matched: Sequence[MatchedStream], gestures: Sequence[str]
) -> ErrorCount:
    """Count what became of the gestures made, and what the detections are."""
    made = sum(e.gesture in gestures for m in matched for e in m.stream.events)
    outcomes = Counter(
        find_outcome(each, d, gestures)
        for each in matched
        for d in each.gesture_detections
    )
    return ErrorCount(
        hours=sum(each.stream.seconds for each in matched) / HOUR,
        made=made,
        found=outcomes[DetectionOutcome.FOUND],
        wrong_names=outcomes[DetectionOutcome.WRONG_NAME],
        accidents=outcomes[DetectionOutcome.ACCIDENT],
        near_words=outcomes[DetectionOutcome.NEAR_WORD],
        duplicates=outcomes[DetectionOutcome.DUPLICATE],
        no_errors=outcomes[DetectionOutcome.NO_ERROR],
    )


def find_outcome(
    stream: MatchedStream, detection: int, gestures: Sequence[str]
) -> DetectionOutcome:
    """Return what a detection of a gesture is, by its index.

    Every detection during an accident counts, as each may start a command; of a touch
    on purpose all but the one that represents it are duplicates.
    """
    index = stream.matching.assigned.get(detection)
    if index is None:
        is_found = detection in stream.matching.matched.values()
        return DetectionOutcome.FOUND if is_found else DetectionOutcome.ACCIDENT
    event = stream.stream.events[index]
    is_made = event.gesture in gestures
    if not is_made and find_group(event) is TouchGroup.ACCIDENT:
        return DetectionOutcome.ACCIDENT
    if stream.find_detection(index) != detection:
        return DetectionOutcome.DUPLICATE
    if is_made:
        return DetectionOutcome.WRONG_NAME
    name = stream.stream.detections[detection].gesture
    is_right = OTHER_NAMES.get(event.gesture) == name
    return DetectionOutcome.NO_ERROR if is_right else DetectionOutcome.NEAR_WORD


def tally_near_words(
    matched: Sequence[MatchedStream], gestures: Sequence[str]
) -> dict[str, NonGestureTally]:
    """Count the touches on purpose that have no name, by their kind."""
    tallies: dict[str, NonGestureTally] = {}
    for each in matched:
        mistaken = {
            each.matching.assigned[d]
            for d in each.gesture_detections
            if find_outcome(each, d, gestures) is DetectionOutcome.NEAR_WORD
        }
        for index, event in enumerate(each.stream.events):
            if event.gesture in gestures or find_group(event) is TouchGroup.ACCIDENT:
                continue
            name = event.kind if event.gesture == NONE else event.gesture
            one = NonGestureTally(1, int(index in mistaken))
            tallies[name] = tallies.get(name, NonGestureTally()) + one
    return dict(sorted(tallies.items()))


def tally_overlapping(stream: MatchedStream, gestures: Sequence[str]) -> Tally:
    """Count events that overlap another one, and false detections during overlaps."""
    events = stream.stream.events
    wanted = np.array([event.gesture in gestures for event in events], dtype=bool)
    wanted &= stream.overlapping
    found = int(wanted[list(stream.matching.matched)].sum())
    false = int(stream.is_during_overlap[list(stream.false_detections)].sum())
    return Tally(found, int(wanted.sum()) - found, false)


def collect_delays(matched: Sequence[MatchedStream], gesture: str) -> Delays:
    """Return the delays of the matching detections of a gesture."""
    pairs = [
        (each.stream.events[event], each.stream.detections[found].stamp)
        for each in matched
        for event, found in sorted(each.matching.matched.items())
        if each.stream.events[event].gesture == gesture
    ]
    return Delays(
        np.array([stamp - event.end for event, stamp in pairs], float) / NS_PER_S,
        np.array([stamp - event.onset for event, stamp in pairs], float) / NS_PER_S,
    )


def tally_non_gestures(
    matched: Sequence[MatchedStream], get_name: Callable[[TrueEvent], str | None]
) -> dict[str, NonGestureTally]:
    """Count events that should not be detected, by name; those without are skipped."""
    tallies: dict[str, NonGestureTally] = {}
    for each in matched:
        for index, event in enumerate(each.stream.events):
            name = get_name(event)
            if name is not None:
                one = NonGestureTally(1, int(each.is_mistaken(index)))
                tallies[name] = tallies.get(name, NonGestureTally()) + one
    return dict(sorted(tallies.items()))


def count_confusions(
    matched: MatchedStream, names: Sequence[str]
) -> Int[np.ndarray, "true predicted"]:
    """Count events by true and detected class; detections of no event come last."""
    counts = np.zeros((len(names), len(names)), dtype=np.int64)
    place = {name: index for index, name in enumerate(names)}
    predicted = [place[found.gesture] for found in matched.stream.detections]
    left = set(range(len(predicted)))
    for index, event in enumerate(matched.stream.events):
        number = matched.find_detection(index)
        column = place[NOTHING] if number is None else predicted[number]
        counts[place.get(event.gesture, place[UNKNOWN]), column] += 1
        left -= {number}
    for number in left:
        counts[place[NOTHING], predicted[number]] += 1
    return counts
