"""This module chooses the decision settings on streams set aside for it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from eskin.learn.events.event_scoring import EventScore, score_events
from eskin.learn.events.matching import NO_GESTURE
from eskin.learn.events.traces import TracedStream
from eskin.model import DecisionConfig

Choice = tuple[DecisionConfig, EventScore]


@dataclass(frozen=True)
class TuningConfig:
    """These settings say which decisions are tried, and how they are rated."""

    thresholds: tuple[float, ...] = (0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 1.1)
    """Thresholds of all gestures, then of each alone; the last one waits for contact to
    end."""
    lifteds: tuple[float, ...] = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.1)
    """Thresholds of all gestures without contact."""
    lifts: tuple[float, ...] = (0.1, 0.15, 0.2, 0.25, 0.3)
    """Times without contact [s]."""
    leasts: tuple[float, ...] = (0.3, 0.5, 0.6, 0.7, 0.8)
    """Probabilities below which a touch that closes is unknown."""
    holds: tuple[float, ...] = (0.06, 0.12, 0.2)
    """Times for which a gesture must stay above its threshold [s]."""
    each: bool = True
    """Whether each gesture gets a threshold of its own."""
    latency: float = 0.3
    """Largest median latency [s]."""
    accidents: float = 1.0
    """Loss of F1 that is accepted for detecting no accidental contact rather than
    all."""
    unknown: float = 0.1
    """Loss of F1 that is accepted for detecting no gesture outside the vocabulary
    rather than all."""


@dataclass(frozen=True)
class Candidate:
    """A candidate is one value of one setting to try."""

    setting: str
    """Name of the setting of a `DecisionConfig`."""
    value: float
    """Value to try."""
    gesture: str = ""
    """Gesture that it is for, where each gesture has a value."""


def choose_decision(
    streams: Sequence[TracedStream],
    config: TuningConfig | None = None,
    temperature: float | None = None,
) -> Choice:
    """Return the decision settings that do best on some streams, and their score.

    The best value of each setting is kept in turn, over and over, until none gets
    better. Of decisions whose median latency is small enough the best has the highest
    F1, less the costs of mistaken accidents and unknown gestures.

    Args:
        streams: streams for this purpose alone, not those of a test.
        config: values to try.
        temperature: temperature to use instead of the model's.
    """
    config = config or TuningConfig()
    vocabulary = streams[0].trace.vocabulary

    def scored(decision: DecisionConfig) -> Choice:
        decided = [stream.decide(decision, temperature) for stream in streams]
        return decision, score_events(decided, vocabulary)

    best = scored(DecisionConfig())
    better = True
    while better:
        before = rate_score(best[1], config)
        for candidate in list_candidates(vocabulary, config):
            decision = apply_candidate(best[0], candidate)
            if decision == best[0]:
                continue
            tried = scored(decision)
            if rate_score(tried[1], config) > rate_score(best[1], config):
                best = tried
        better = rate_score(best[1], config) > before
    return best


def list_candidates(
    vocabulary: Sequence[str], config: TuningConfig
) -> Iterator[Candidate]:
    """Yield every value of every setting that is tried."""
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


def apply_candidate(decision: DecisionConfig, candidate: Candidate) -> DecisionConfig:
    """Return decision settings with one of them changed."""
    value: object = candidate.value
    if candidate.gesture:
        value = {**decision.thresholds, candidate.gesture: candidate.value}
    return replace(decision, **{candidate.setting: value})


def rate_score(score: EventScore, config: TuningConfig) -> tuple[bool, float]:
    """Return whether a decision is fast enough, and its F1 less its costs."""
    fast = score.all_delays.latency(50) <= config.latency
    accidents = config.accidents * (
        score.accidents.share if score.accidents.count else 0
    )
    total = score.unknown_total
    unknown = config.unknown * (total.share if total.count else 0)
    f1 = score.total.f1 if score.total.matched else 0.0
    return fast, f1 - accidents - unknown
