"""This module measures how false detections and missed gestures trade, by threshold."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv, gammaincinv

from eskin.learn.events.event_scoring import Tally, score_events
from eskin.learn.events.matching import ScoredStream
from eskin.live import DecisionConfig

THRESHOLDS = (0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99)
"""Probabilities that a gesture needs, beside that of the model."""
TAIL, DRAWS = 0.025, 1000
"""Share of each end outside an interval, and number of bootstrap samples."""


@dataclass(frozen=True)
class CurvePoint:
    """A point holds both kinds of errors at one threshold."""

    threshold: float
    """Probability that every gesture needs."""
    is_shipped: bool
    """Whether these are the settings of the model."""
    false_per_hour: float
    """Detections of gestures that match no event [1/h]."""
    false_interval: tuple[float, float]
    """95 % interval of that."""
    missed: float
    """Share of the gestures that are missed; NaN without gestures."""
    missed_interval: tuple[float, float]
    """95 % interval of that."""


def raise_threshold(decision: DecisionConfig, threshold: float) -> DecisionConfig:
    """Return settings by which no gesture is detected below a probability.

    A gesture whose own threshold is higher keeps it; only the probability below which a
    touch that closes is unknown may also become lower.
    """
    own = {name: max(value, threshold) for name, value in decision.thresholds.items()}
    return replace(
        decision,
        threshold=max(decision.threshold, threshold),
        thresholds=own,
        lifted=max(decision.lifted, threshold),
        least=threshold,
    )


def measure_curve(
    decide: Callable[[DecisionConfig], Sequence[ScoredStream]],
    decision: DecisionConfig,
    vocabulary: Sequence[str],
) -> list[CurvePoint]:
    """Measure both kinds of errors at each threshold, and at that of the model.

    Args:
        decide: function that returns the streams with the detections of settings.
        decision: settings of the model; its `least` is the threshold that is shipped.
        vocabulary: classes of the model.
    """
    points = []
    for threshold in sorted({*THRESHOLDS, decision.least}):
        streams = decide(raise_threshold(decision, threshold))
        score = score_events(streams, vocabulary)
        hours = [
            sum(s.seconds for s in streams if s.subject == person) / 3600
            for person in score.per_subject
        ]
        false, missed = bound_errors(list(score.per_subject.values()), hours)
        total = score.total
        points.append(
            CurvePoint(
                threshold=threshold,
                is_shipped=threshold == decision.least,
                false_per_hour=score.false_per_hour,
                false_interval=false,
                missed=1 - total.recall,
                missed_interval=missed,
            )
        )
    return points


def bound_errors(
    people: Sequence[Tally], hours: Sequence[float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return 95 % intervals of the false detections an hour and the share missed.

    Each is the union of two: the exact one of a count (Garwood 1936; Clopper and
    Pearson 1934), which knows nothing of differences between people, and a bootstrap
    over people, which knows too little where there are few or no errors.

    Args:
        people: tally of each person.
        hours: time of each person [h].
    """
    counts = np.array([(p.false, p.missed, p.matched + p.missed) for p in people])
    false, missed, events = counts.sum(axis=0).tolist()
    time = sum(hours)
    rng = np.random.default_rng(0)
    draws = rng.integers(len(people), size=(DRAWS, len(people)))
    drawn, spent = counts[draws].sum(axis=1), np.array(hours)[draws].sum(axis=1)
    low = gammaincinv(false, TAIL) if false else 0.0
    rates = (low / time, gammaincinv(false + 1, 1 - TAIL) / time)
    shares = (float("nan"), float("nan"))
    if events:
        hit = events - missed
        low = betaincinv(missed, hit + 1, TAIL) if missed else 0.0
        high = betaincinv(missed + 1, hit, 1 - TAIL) if hit else 1.0
        some = drawn[:, 2] > 0
        shares = widen((low, high), drawn[some, 1] / drawn[some, 2])
    return widen(rates, drawn[:, 0] / spent), shares


def widen(
    interval: tuple[float, float], values: Float[np.ndarray, "draw"]
) -> tuple[float, float]:
    """Return the union of an interval and that of bootstrap values."""
    low, high = np.quantile(values, (TAIL, 1 - TAIL)).tolist()
    return min(float(interval[0]), low), max(float(interval[1]), high)


def draw_curves(
    curves: Mapping[str, Sequence[CurvePoint]], path: Path, title: str
) -> None:
    """Draw missed gestures by false detections an hour, with intervals.

    A dot marks the settings of the model, with which it is shipped.

    Args:
        curves: points of each curve, by its name; empty for a single one.
        path: the file.
        title: title of the figure.
    """
    from matplotlib.figure import Figure

    from eskin.learn.plots import save_figure

    figure = Figure(figsize=(5.6, 4.2), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    for name, points in curves.items():
        x = np.array([p.false_per_hour for p in points])
        y = 100 * np.array([p.missed for p in points])
        (line,) = axes.plot(x, y, label=name or None)
        [n] = [n for n, point in enumerate(points) if point.is_shipped]
        errors = [
            np.abs(np.array([scale * np.array(interval)]).T - middle)
            for scale, interval, middle in (
                (100, points[n].missed_interval, y[n]),
                (1, points[n].false_interval, x[n]),
            )
        ]
        up, across = errors
        colour = line.get_color()
        axes.errorbar(x[n], y[n], up, across, fmt="o", color=colour, capsize=3)
    axes.set(xlabel="false detections an hour", ylabel="missed gestures [%]")
    axes.set(title=title, xlim=(0, None), ylim=(0, None))
    axes.grid(alpha=0.3)
    if any(curves):
        axes.legend(frameon=False)
    save_figure(figure, path)
