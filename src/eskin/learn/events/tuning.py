"""Choosing how sure is sure, on streams that are for that alone."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from eskin.learn.events.event_scoring import EventScore, score_events
from eskin.learn.events.matching import NO_GESTURE
from eskin.learn.events.traces import TracedStream
from eskin.model import DecisionConfig

Choice = tuple[DecisionConfig, EventScore]


@dataclass(frozen=True)
class TuningConfig:
    """Which decisions are tried, and what makes one better."""

    thresholds: tuple[float, ...] = (0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 1.1)
    """Of all gestures, then of each alone; the last waits for contact to end."""

    lifteds: tuple[float, ...] = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.1)
    """Of all gestures without contact."""

    lifts: tuple[float, ...] = (0.1, 0.15, 0.2, 0.25, 0.3)
    """How long without contact [s]."""

    leasts: tuple[float, ...] = (0.3, 0.5, 0.6, 0.7, 0.8)
    """Probabilities below which a touch that closes is unknown."""

    holds: tuple[float, ...] = (0.06, 0.12, 0.2)
    """How long a gesture must stay above its threshold [s]."""

    each: bool = True
    """Whether each gesture gets a threshold of its own."""

    latency: float = 0.3
    """Largest median latency [s]."""

    accidents: float = 1.0
    """F1 that is given up for accidental contacts becoming detections: all of them
    cost this much."""

    unknown: float = 0.1
    """The same for gestures that are not in the vocabulary."""


@dataclass(frozen=True)
class Candidate:
    """One value to try."""

    setting: str
    """Of a `DecisionConfig`."""

    value: float
    """What to set it to."""

    gesture: str = ""
    """Whose, where each gesture has one."""


def choose_decision(
    streams: Sequence[TracedStream],
    config: TuningConfig | None = None,
    temperature: float | None = None,
) -> Choice:
    """The decision that does best on some streams, and what it does there.

    Setting by setting the best value is kept, then all over again, until none gets
    better. Of decisions whose median latency is small enough that one is best which has
    the highest F1 after what mistaken accidents and unknown gestures cost.

    Args:
        streams: for this purpose alone, not those of a test.
        config: what to try.
        temperature: in place of that of the model.
    """
    config = config or TuningConfig()
    vocabulary = streams[0].trace.vocabulary

    def scored(decision: DecisionConfig) -> Choice:
        takes = [stream.take(decision, temperature) for stream in streams]
        return decision, score_events(takes, vocabulary)

    best = scored(DecisionConfig())
    better = True
    while better:
        before = worth(best[1], config)
        for candidate in candidates(vocabulary, config):
            decision = changed(best[0], candidate)
            if decision == best[0]:
                continue
            tried = scored(decision)
            if worth(tried[1], config) > worth(best[1], config):
                best = tried
        better = worth(best[1], config) > before
    return best


def candidates(vocabulary: Sequence[str], config: TuningConfig) -> Iterator[Candidate]:
    """Every value of every setting that is tried."""
    settings = {
        "threshold": config.thresholds,
        "lifted": config.lifteds,
        "lift_seconds": config.lifts,
        "hold_seconds": config.holds,
        "least": config.leasts,
    }
    for name, values in settings.items():
        yield from (Candidate(name, value) for value in values)
    for gesture in vocabulary if config.each else ():
        if gesture not in NO_GESTURE:
            for value in config.thresholds:
                yield Candidate("thresholds", value, gesture)


def changed(decision: DecisionConfig, candidate: Candidate) -> DecisionConfig:
    """A decision with one setting changed."""
    value: object = candidate.value
    if candidate.gesture:
        value = {**decision.thresholds, candidate.gesture: candidate.value}
    return replace(decision, **{candidate.setting: value})


def worth(score: EventScore, config: TuningConfig) -> tuple[bool, float]:
    """What a decision is worth: fast enough first, then few mistakes."""
    fast = score.all_delays.latency(50) <= config.latency
    accidents = config.accidents * (
        score.accidents.share if score.accidents.count else 0
    )
    total = score.unknown_total
    unknown = config.unknown * (total.share if total.count else 0)
    f1 = score.total.f1 if score.total.matched else 0.0
    return fast, f1 - accidents - unknown
