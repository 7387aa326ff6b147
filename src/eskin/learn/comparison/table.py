"""Methods beside each other: means, spreads, and how far ours is ahead."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eskin.learn.comparison.results import Result
from eskin.learn.metrics import paired_interval

Place = tuple[int, int]
"""The draw of the data, and the seed."""


@dataclass(frozen=True)
class Row:
    """One method on one test."""

    name: str
    """Of the method."""

    test: str
    """Of the test."""

    runs: int
    """How often it was trained."""

    val_accuracy: float | None
    """Mean over these; None where nothing could be held out."""

    test_accuracy: float
    """Mean over these."""

    std: float
    """Standard deviation of the accuracy on the test; 0 of a single run."""

    ahead: float
    """By how much the first method is ahead on the clips that both answered."""

    ahead_low: float
    """Lower end of its paired 95 % bootstrap interval; whole people are drawn."""

    ahead_high: float
    """Upper end."""

    seconds: float
    """Mean time to learn and to answer [s]."""


def rows_of(found: Mapping[str, Mapping[Place, Result]]) -> list[Row]:
    """One row a method and test, the methods in the order given.

    Args:
        found: results by method and by what they learned from; the first method is
            the one that others are held against.
    """
    first = next(iter(found.values()))
    tests = [n for n in next(iter(first.values())).answered if n != "val"]
    return [
        row_of(name, test, results, first)
        for test in tests
        for name, results in found.items()
    ]


def row_of(
    name: str,
    test: str,
    results: Mapping[Place, Result],
    first: Mapping[Place, Result],
) -> Row:
    """One method on one test."""
    places = sorted(results)
    accuracies = accuracies_of([results[place] for place in places], test)
    theirs, ours, people = [], [], []
    for draw, seed in places:
        theirs.append(results[draw, seed].answered[test].right)
        ours.append(first[draw, seed].answered[test].right)
        people += [f"{draw} {who}" for who in results[draw, seed].answered[test].people]
    both = np.concatenate(ours), np.concatenate(theirs)
    low, high = paired_interval(*both, cluster=people)
    return Row(
        name=name,
        test=test,
        runs=len(places),
        val_accuracy=mean_of(accuracies_of(list(results.values()), "val")),
        test_accuracy=float(np.mean(accuracies)),
        std=spread_of(accuracies),
        ahead=float(both[0].mean() - both[1].mean()),
        ahead_low=low,
        ahead_high=high,
        seconds=float(np.mean([result.seconds for result in results.values()])),
    )


def accuracies_of(results: Sequence[Result], asked: str) -> list[float]:
    """Share of right answers of each run."""
    answered = [r.answered[asked] for r in results if asked in r.answered]
    return [float(each.right.mean()) for each in answered]


def mean_of(shares: Sequence[float]) -> float | None:
    """Their mean; None of none."""
    return float(np.mean(shares)) if shares else None


def spread_of(shares: Sequence[float]) -> float:
    """Their standard deviation; 0 of fewer than two."""
    return float(np.std(shares, ddof=1)) if len(shares) > 1 else 0.0


def percent(share: float | None) -> str:
    """A share for a table."""
    return "" if share is None else f"{share:.1%}"


def markdown(rows: Sequence[Row]) -> str:
    """The rows as a table."""
    heads = "method", "test", "runs", "validation", "test accuracy", "SD", "ours ahead"
    lines = [" | ".join(("", *heads, "")).strip(), "|" + "---|" * len(heads)]
    for row in rows:
        low, high = 100 * row.ahead_low, 100 * row.ahead_high
        ahead = f"{100 * row.ahead:+.1f} [{low:+.1f}, {high:+.1f}]"
        cells = (
            row.name,
            row.test,
            str(row.runs),
            percent(row.val_accuracy),
            percent(row.test_accuracy),
            percent(row.std if row.runs > 1 else None),
            "" if row.ahead == row.ahead_low == row.ahead_high == 0 else ahead,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def spread(mean: float | None, std: float) -> str:
    """A mean with its standard deviation, for a table."""
    return "" if mean is None else f"{percent(mean)} ({percent(std)})"
