"""This module measures how accidents and missed gestures trade, by threshold."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv

from eskin.learn.events.event_scoring import ErrorCount, score_events
from eskin.learn.events.matching import ScoredStream
from eskin.learn.metrics import TAIL, bound_rate, resample_clusters
from eskin.live import DecisionConfig

THRESHOLDS = (0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99)
"""Probabilities that a gesture needs, beside the model's own."""
RATES = (0.5, 5.0)
"""Accidents an hour at which the share of missed gestures is reported [1/h]."""


@dataclass(frozen=True)
class CurvePoint:
    """A point holds both kinds of errors at one threshold."""

    threshold: float
    """Probability that every gesture needs."""
    is_shipped: bool
    """Whether these are the settings of the model."""
    accidents_per_hour: float
    """Detections of gestures in accidents, or of nothing [1/h]."""
    accidents_interval: tuple[float, float]
    """95 % interval of that."""
    missed: float
    """Share of the gestures that are missed; NaN without gestures."""
    missed_interval: tuple[float, float]
    """95 % interval of that."""
    wrong_names: float
    """Share of the gestures that are detected as another one; NaN without gestures."""
    false_per_hour: float
    """Detections of gestures that match no event, of any outcome [1/h]."""
    false_interval: tuple[float, float]
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
    """Measure both kinds of errors at each threshold, and at the model's.

    Args:
        decide: function that returns the streams with the detections of settings.
        decision: settings of the model; its `least` is the threshold that is shipped.
        vocabulary: classes of the model.
    """
    points = []
    for threshold in sorted({*THRESHOLDS, decision.least}):
        streams = decide(raise_threshold(decision, threshold))
        score = score_events(streams, vocabulary)
        people = list(score.errors.values())
        hours = [person.hours for person in people]
        total = score.total_errors
        points.append(
            CurvePoint(
                threshold=threshold,
                is_shipped=threshold == decision.least,
                accidents_per_hour=total.accidents_per_hour,
                accidents_interval=bound_person_rate(
                    [person.accidents for person in people], hours
                ),
                missed=total.missed_share,
                missed_interval=bound_missed(people),
                wrong_names=total.wrong_name_share,
                false_per_hour=score.false_per_hour,
                false_interval=bound_person_rate(
                    [tally.false for tally in score.per_subject.values()], hours
                ),
            )
        )
    return points


def interpolate_missed(points: Sequence[CurvePoint], rate: float) -> float:
    """Return the share of gestures missed at a number of accidents an hour.

    It is interpolated between the two thresholds that have more and at most as many
    accidents, or is that of the lowest threshold where that has fewer. It is NaN where
    no threshold has as few, or without gestures.

    Args:
        points: points of a curve, by increasing threshold.
        rate: accidents an hour [1/h].
    """
    rates = [point.accidents_per_hour for point in points]
    below = [n for n, found in enumerate(rates) if found <= rate]
    if not below:
        return float("nan")
    n = below[0]
    if n == 0:
        return points[0].missed
    share = (rates[n - 1] - rate) / (rates[n - 1] - rates[n])
    return (1 - share) * points[n - 1].missed + share * points[n].missed


def bound_person_rate(
    counts: Sequence[int], hours: Sequence[float]
) -> tuple[float, float]:
    """Return the 95 % interval of a number of detections an hour.

    It is the union of two: the exact one of a count (Garwood 1936), which knows nothing
    of differences between people, and a bootstrap over people, which knows too little
    where there are few or no errors.

    Args:
        counts: number of detections of each person.
        hours: time of each person [h].
    """
    drawn = resample_clusters(np.stack([counts, hours], axis=1), 0)
    return widen(bound_rate(sum(counts), sum(hours)), drawn[:, 0] / drawn[:, 1])


def bound_missed(people: Sequence[ErrorCount]) -> tuple[float, float]:
    """Return the 95 % interval of the share of gestures missed; NaN without gestures.

    It is the union of the exact one of a share (Clopper and Pearson 1934) and of a
    bootstrap over people, as in `bound_person_rate`.
    """
    missed = sum(person.missed for person in people)
    made = sum(person.made for person in people)
    if not made:
        return float("nan"), float("nan")
    low = float(betaincinv(missed, made - missed + 1, TAIL)) if missed else 0.0
    high = 1.0
    if missed < made:
        high = float(betaincinv(missed + 1, made - missed, 1 - TAIL))
    counts = np.array([(p.missed, p.made) for p in people], np.float64)
    drawn = resample_clusters(counts, 0)
    some = drawn[:, 1] > 0
    return widen((low, high), drawn[some, 0] / drawn[some, 1])


def widen(
    interval: tuple[float, float], values: Float[np.ndarray, "draw"]
) -> tuple[float, float]:
    """Return the union of an interval and the interval of bootstrap values."""
    low, high = np.quantile(values, (TAIL, 1 - TAIL)).tolist()
    return min(float(interval[0]), low), max(float(interval[1]), high)


def draw_curves(
    curves: Mapping[str, Sequence[CurvePoint]], path: Path, title: str
) -> None:
    """Draw missed gestures by accidents an hour, with intervals.

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
        x = np.array([p.accidents_per_hour for p in points])
        y = 100 * np.array([p.missed for p in points])
        (line,) = axes.plot(x, y, label=name or None)
        [n] = [n for n, point in enumerate(points) if point.is_shipped]
        errors = [
            np.abs(np.array([scale * np.array(interval)]).T - middle)
            for scale, interval, middle in (
                (100, points[n].missed_interval, y[n]),
                (1, points[n].accidents_interval, x[n]),
            )
        ]
        up, across = errors
        colour = line.get_color()
        axes.errorbar(x[n], y[n], up, across, fmt="o", color=colour, capsize=3)
    axes.set(xlabel="accidents an hour", ylabel="missed gestures [%]")
    axes.set(title=title, xlim=(0, None), ylim=(0, None))
    axes.grid(alpha=0.3)
    if any(curves):
        axes.legend(frameon=False)
    save_figure(figure, path)
