"""This module tunes the decision settings on streams held out for that."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from eskin.learn.events.event_scoring import EventScore, score_events
from eskin.learn.events.matching import NO_GESTURE
from eskin.learn.events.traces import TracedStream
from eskin.live import DecisionConfig

Choice = tuple[DecisionConfig, EventScore]


@dataclass(frozen=True)
class TuningConfig:
    """These settings hold the values that are tried, and the costs by which to rate."""

    thresholds: tuple[float, ...] = (
        0.4,
        0.5,
        0.6,
        0.7,
        0.8,
        0.85,
        0.9,
        0.95,
        0.98,
        1.1,
    )
    """Thresholds of all gestures, then of each alone; the last one waits for contact to
    end."""
    lifteds: tuple[float, ...] = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.1)
    """Thresholds of all gestures without contact; the last one waits for the touch to
    close."""
    lifts: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4)
    """Times without contact [s]."""
    leasts: tuple[float, ...] = (
        0.0,
        0.3,
        0.4,
        0.45,
        0.5,
        0.55,
        0.6,
        0.65,
        0.7,
        0.75,
        0.8,
        0.9,
        0.95,
    )
    """Probabilities below which a touch that closes is unknown."""
    deliberates: tuple[float, ...] = (0.0, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)
    """Probabilities of any gesture below which it is unknown, too."""
    dwells: tuple[float, ...] = (0.0, 0.03, 0.06, 0.12, 0.2, 0.3, 0.4)
    """Times for which a gesture must stay above its threshold [s]."""
    each: bool = True
    """Whether each gesture gets a threshold of its own."""
    latency: float = 0.3
    """Largest median latency [s]."""
    false: float = 1.0
    """Cost of a detection of no gesture that was made, in units of that of a missed
    gesture; a gesture that is taken for another one costs both."""
    accident: float = 1.0
    """Additional cost of such a detection where a touch was an accident."""


@dataclass(frozen=True)
class Candidate:
    """A candidate is one value of one setting to try."""

    setting: str
    """Name of a field of `DecisionConfig`."""
    value: float
    """Value to try."""
    gesture: str = ""
    """Gesture that the value is for, where each gesture has one of its own."""


def choose_decision(
    streams: Sequence[TracedStream],
    config: TuningConfig | None = None,
    temperature: float | None = None,
) -> Choice:
    """Return the decision settings rated best on some streams, and their score.

    This is coordinate ascent: settings are varied one at a time, over and over, until
    none gets better. Settings whose median latency is small enough are better than
    others; then the cost of wrong, missed and unasked detections counts.

    Args:
        streams: streams for tuning alone, none of a test.
        config: values to try.
        temperature: temperature to use instead of the model's.
    """
    config = config or TuningConfig()
    vocabulary = streams[0].trace.vocabulary

    def score(decision: DecisionConfig) -> Choice:
        decided = [stream.decide(decision, temperature) for stream in streams]
        return decision, score_events(decided, vocabulary)

    best = score(DecisionConfig())
    better = True
    while better:
        before = rate_score(best[1], config)
        for candidate in list_candidates(vocabulary, config):
            decision = apply_candidate(best[0], candidate)
            if decision == best[0]:
                continue
            tried = score(decision)
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
        "dwell_seconds": config.dwells,
        "least": config.leasts,
        "deliberate": config.deliberates,
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
    """Return whether the median latency is small enough, and minus the cost a gesture.

    The first is false where no gesture is detected.
    """
    is_fast = score.all_delays.latency(50) <= config.latency
    total = score.total
    accidents = score.accidents.mistaken
    cost = total.missed + config.false * total.false + config.accident * accidents
    return is_fast, -cost / max(total.matched + total.missed, 1)
