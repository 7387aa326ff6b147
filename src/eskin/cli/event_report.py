"""What `eskin evaluate` says of continuous streams."""

import math

import numpy as np
from rich.console import Console
from rich.table import Table

from eskin.learn.events import EventScore, NonGestureTally, Tally
from eskin.learn.events.event_scoring import Delays


def by_person(people: dict[str, float]) -> dict[str, float]:
    """Each person's score, their mean, spread and least.

    A person who is called like one of these three is `person mean`, say.
    """
    if not people:
        return {}
    values = list(people.values())
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    three = {"mean": float(np.mean(values)), "sd": spread, "worst": min(values)}
    named = {f"person {n}" if n in three else n: v for n, v in people.items()}
    return {name: round(value, 4) for name, value in (named | three).items()}


def event_rows(score: EventScore) -> dict[str, object]:
    """The score of streams as plain values; None where there is nothing to tell."""
    total = score.total
    people = {name: tally.f1 for name, tally in score.per_subject.items()}
    return {
        **tally_row(total),
        "f1_interval": [known(value) for value in score.f1_interval],
        "false_per_hour": known(score.false_per_hour, 2),
        **delay_row(score.all_delays),
        "per_gesture": {
            name: tally_row(tally) | delay_row(score.delays[name])
            for name, tally in score.per_gesture.items()
        },
        "per_subject": by_person(
            {name: f1 for name, f1 in people.items() if not math.isnan(f1)}
        ),
        "simultaneous_f1": known(score.simultaneous.f1),
        "simultaneous": tally_row(score.simultaneous),
        "unknown_abstained": known(1 - score.unknown_total.share),
        "unknown": left_rows(score.unknown),
        "accidents_detected": known(score.accidents.share),
        "accidents": score.accidents.count,
        "none": left_rows(score.none),
        "ece": known(score.reliability.error),
        "confusion": {"names": score.names, "counts": score.confusion.tolist()},
        "events": int(score.confusion[:-1].sum()),
        "hours": round(score.hours, 4),
    }


def tally_row(tally: Tally) -> dict[str, object]:
    """A tally as plain values."""
    return {
        "precision": known(tally.precision),
        "recall": known(tally.recall),
        "f1": known(tally.f1),
        "count": tally.matched + tally.missed,
        "false": tally.false,
    }


def delay_row(delays: Delays) -> dict[str, object]:
    """Delays as plain values [ms]."""
    return {
        "latency_ms_p50": known(1000 * delays.latency(50), 1),
        "latency_ms_p95": known(1000 * delays.latency(95), 1),
        "from_onset_ms_p50": known(1000 * delays.from_onset(50), 1),
        "from_onset_ms_p95": known(1000 * delays.from_onset(95), 1),
    }


def left_rows(left: dict[str, NonGestureTally]) -> dict[str, dict[str, int]]:
    """Events of which no gesture should be said, as plain values."""
    return {
        name: {"count": one.count, "mistaken": one.mistaken}
        for name, one in left.items()
    }


def known(value: float, digits: int = 4) -> float | None:
    """A number that JSON has; None where it is not known."""
    return None if math.isnan(value) else round(value, digits)


def show_events(score: EventScore, console: Console) -> None:
    """Print the score of streams."""
    table = Table("events", "precision", "recall", "F1", "count", "false", "p50", "p95")
    rows = score.per_gesture | {"all": score.total}
    for name, tally in rows.items():
        delays = score.delays.get(name, score.all_delays)
        table.add_row(
            name,
            *(f"{v:.2f}" for v in (tally.precision, tally.recall, tally.f1)),
            *(str(n) for n in (tally.matched + tally.missed, tally.false)),
            *(f"{1000 * delays.latency(p):.0f} ms" for p in (50, 95)),
        )
    console.print(table)
    low, high = score.f1_interval
    accidents, unknown = score.accidents, score.unknown_total
    print(
        f"events: F1 {score.total.f1:.3f} ({low:.3f} to {high:.3f}), "
        f"{score.false_per_hour:.1f} false an hour in {score.hours:.2f} h"
    )
    print(
        f"at once: F1 {score.simultaneous.f1:.3f}; mistaken for a gesture: "
        f"{accidents.mistaken} of {accidents.count} accidental contacts, "
        f"{unknown.mistaken} of {unknown.count} unknown gestures"
    )
