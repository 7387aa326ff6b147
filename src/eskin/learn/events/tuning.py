"""Choosing how sure is sure, on streams that are for that alone."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

from eskin.learn.events.hearing import HeardStream
from eskin.learn.events.judge import score_events
from eskin.learn.events.score import EventScore
from eskin.learn.events.take import NO_GESTURE
from eskin.model import DecisionConfig

Choice = tuple[DecisionConfig, EventScore]


@dataclass(frozen=True)
class TuningConfig:
    """Which decisions are tried, and what makes one better."""

    thresholds: tuple[float, ...] = (0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98)
    """Of all gestures, then of each alone."""

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


def choose_decision(
    streams: Sequence[HeardStream],
    config: TuningConfig | None = None,
    temperature: float | None = None,
) -> Choice:
    """The decision that does best on some streams, and what it does there.

    First one threshold, `hold_seconds` and `least` for all; then, gesture by gesture,
    its own threshold. Of those whose median latency is small enough it is the one with
    the highest F1 after what mistaken accidents and unknown gestures cost.

    Args:
        streams: for this purpose alone, not those of a test.
        config: what to try.
        temperature: in place of that of the model.
    """
    config = config or TuningConfig()
    vocabulary = streams[0].trace.vocabulary

    def best(decisions: Iterable[DecisionConfig]) -> Choice:
        return max(
            (
                (
                    decision,
                    score_events(
                        [stream.take(decision, temperature) for stream in streams],
                        vocabulary,
                    ),
                )
                for decision in decisions
            ),
            key=lambda choice: worth(choice[1], config),
        )

    grid = product(config.thresholds, config.holds, config.leasts)
    chosen, score = best(
        DecisionConfig(threshold=threshold, hold_seconds=hold, least=least)
        for threshold, hold, least in grid
    )
    for gesture in vocabulary if config.each else ():
        if gesture not in NO_GESTURE:
            chosen, score = best(
                replace(chosen, thresholds={**chosen.thresholds, gesture: threshold})
                for threshold in (chosen.threshold, *config.thresholds)
            )
    return chosen, score


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
