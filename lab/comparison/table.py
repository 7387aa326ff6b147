"""This module formats tables of methods: accuracies, spread, and the lead of ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eskin.learn.metrics import bootstrap_difference, compute_group_accuracies
from lab.comparison.results import AnsweredClips, MethodResult
from lab.tables import format_head, format_row

RunKey = tuple[int, int]
"""Number of the draw of the data, and the seed."""

ENOUGH_GROUPS = 5
"""Number of people, or of sessions, from which intervals are over them: of fewer, drawn
anew, there are too few different draws."""

LEGEND = (
    "Accuracy, with the standard deviation over runs; ahead in percentage points, with "
    "the paired 95 % bootstrap interval."
)


@dataclass(frozen=True)
class Words:
    """These words name counted things in captions."""

    examples: str = "clips"
    """Examples."""
    groups: str = "people"
    """Groups that intervals are over."""


CLIPS = Words()
"""Words for clips of simulated people."""


@dataclass(frozen=True)
class Lead:
    """A lead is the difference in accuracy of the first method and another."""

    mean: float
    """Difference on the same examples."""
    low: float
    """Lower end of its paired 95 % bootstrap interval, over people or sessions where
    there are at least `ENOUGH_GROUPS`, else over examples."""
    high: float
    """Upper end of the interval."""


@dataclass(frozen=True)
class ComparisonRow:
    """A comparison row sums up one method on one test."""

    name: str
    """Name of the method."""
    test: str
    """Name of the test."""
    runs: int
    """Number of times that it was trained."""
    val_accuracy: float | None
    """Mean accuracy on validation; None where nothing could be held out."""
    val_people: int
    """Number of people, or sessions, to validate on."""
    val_clips: int
    """Number of examples to validate on, in all draws of the data."""
    test_people: int
    """Number of people, or sessions, in the test."""
    test_clips: int
    """Number of examples in the test, in all draws of the data."""
    test_accuracy: float
    """Mean accuracy on the test."""
    std: float
    """Standard deviation of the accuracy on the test; 0 of a single run."""
    val_std: float
    """Standard deviation of the accuracy on validation; 0 of one run or none."""
    val_ahead: Lead | None
    """Lead of the first method on validation; None for the first itself, and where
    nothing could be held out."""
    test_ahead: Lead | None
    """Lead of the first method on the test; None for the first itself."""
    seconds: float
    """Mean time of training and prediction [s]."""
    by_gesture: Mapping[str, float]
    """Accuracy on the test among the examples of each gesture."""
    by_group: Mapping[str, float]
    """Accuracy on the test among the examples of each person, or session."""


def build_rows(
    found: Mapping[str, Mapping[RunKey, MethodResult]],
) -> list[ComparisonRow]:
    """Return one row for each method and test, the methods in the order given.

    Args:
        found: results by method and by run; others are compared with the first method.
    """
    first = next(iter(found.values()))
    tests = [n for n in next(iter(first.values())).answered if n != "val"]
    return [
        build_row(name, test, results, first)
        for test in tests
        for name, results in found.items()
    ]


def build_row(
    name: str,
    test: str,
    results: Mapping[RunKey, MethodResult],
    first: Mapping[RunKey, MethodResult],
) -> ComparisonRow:
    """Return the row of one method on one test."""
    other = None if results is first else first
    val_accuracy, val_std, val_ahead = summarise_test(results, other, "val")
    test_accuracy, std, test_ahead = summarise_test(results, other, test)
    val_people, val_clips = count_people_and_clips(results, "val")
    test_people, test_clips = count_people_and_clips(results, test)
    assert test_accuracy is not None
    answered = [results[key].answered[test] for key in sorted(results)]
    return ComparisonRow(
        name=name,
        test=test,
        runs=len(results),
        val_accuracy=val_accuracy,
        val_people=val_people,
        val_clips=val_clips,
        test_people=test_people,
        test_clips=test_clips,
        test_accuracy=test_accuracy,
        std=std,
        val_std=val_std,
        val_ahead=val_ahead,
        test_ahead=test_ahead,
        seconds=float(np.mean([result.seconds for result in results.values()])),
        by_gesture=compute_accuracies(answered, [each.truth for each in answered]),
        by_group=compute_accuracies(answered, [each.people for each in answered]),
    )


def summarise_test(
    results: Mapping[RunKey, MethodResult],
    first: Mapping[RunKey, MethodResult] | None,
    test: str,
) -> tuple[float | None, float, Lead | None]:
    """Return mean accuracy, its standard deviation over runs, and the lead of another.

    Without predictions on the test they are None, 0 and None; the deviation is 0 of a
    single run, the lead None without another.
    """
    answered = [
        results[key].answered[test]
        for key in sorted(results)
        if test in results[key].answered
    ]
    if not answered:
        return None, 0.0, None
    shares = [each.correct.mean() for each in answered]
    std = float(np.std(shares, ddof=1)) if len(shares) > 1 else 0.0
    lead = compute_lead(results, first, test) if first else None
    return float(np.mean(shares)), std, lead


def count_people_and_clips(
    results: Mapping[RunKey, MethodResult], test: str
) -> tuple[int, int]:
    """Return the numbers of people and examples of a test, each draw counted once."""
    runs = [(draw, r) for (draw, _), r in results.items() if test in r.answered]
    draws = {draw: r.answered[test] for draw, r in runs}
    people = {(draw, person) for draw, each in draws.items() for person in each.people}
    return len(people), sum(len(each.people) for each in draws.values())


def compute_lead(
    results: Mapping[RunKey, MethodResult],
    first: Mapping[RunKey, MethodResult],
    test: str,
) -> Lead:
    """Return the lead of the first method over another on the examples of a test."""
    theirs = []
    ours = []
    people = []
    for draw, seed in sorted(results):
        answered = results[draw, seed].answered[test]
        theirs.append(answered.correct)
        ours.append(first[draw, seed].answered[test].correct)
        people += [f"{draw} {person}" for person in answered.people]
    both = np.concatenate(ours), np.concatenate(theirs)
    mean = float(both[0].mean() - both[1].mean())
    cluster = people if len(set(people)) >= ENOUGH_GROUPS else None
    return Lead(mean, *bootstrap_difference(*both, cluster=cluster))


def compute_accuracies(
    answered: Sequence[AnsweredClips], names: Sequence[Sequence[str]]
) -> dict[str, float]:
    """Return the accuracy among all examples of each name.

    Args:
        answered: predictions of each run.
        names: name of each example of each run, such as its gesture or person.
    """
    correct = np.concatenate([each.correct for each in answered])
    return compute_group_accuracies(correct, [name for some in names for name in some])


def format_lead(ahead: Lead | None) -> str:
    """Format a lead in points for a table; empty for the first method."""
    if ahead is None:
        return ""
    ends = f"[{100 * ahead.low:+.1f}, {100 * ahead.high:+.1f}]"
    return f"{100 * ahead.mean:+.1f} {ends}"


def format_tables(rows: Sequence[ComparisonRow], words: Words = CLIPS) -> str:
    """Format the rows as Markdown tables, one for each test, with captions."""
    tables = []
    lead = f"{rows[0].name} ahead"
    for test in dict.fromkeys(row.test for row in rows):
        heads = ("method", "runs", "validation (SD)", lead, f"{test} (SD)", lead)
        lines = [format_head(heads)]
        of_test = [row for row in rows if row.test == test]
        lines += [format_method(row) for row in of_test]
        tables.append("\n".join([*lines, "", format_caption(of_test[0], words)]))
    return "\n\n".join([*tables, LEGEND])


def format_caption(first: ComparisonRow, words: Words) -> str:
    """Describe the examples and people of a table, and intervals, by its first row."""
    tested = format_counts(first.test_clips, first.test_people, words)
    if not first.val_clips:
        return f"Tested on {tested}."
    validated = format_counts(first.val_clips, first.val_people, words)
    return f"Tested on {tested}; validated on {validated}."


def format_counts(examples: int, groups: int, words: Words) -> str:
    """Format how many examples of how many groups, and what intervals are over."""
    over = words.groups if groups >= ENOUGH_GROUPS else words.examples
    return (
        f"{examples} {words.examples} of {groups} {words.groups}, intervals over {over}"
    )


def format_gesture_tables(rows: Sequence[ComparisonRow], words: Words = CLIPS) -> str:
    """Format accuracies by gesture as Markdown tables, one for each test."""
    tests = dict.fromkeys(row.test for row in rows)
    return "\n\n".join(
        format_accuracies(
            f"{test}, {words.examples} of",
            {row.name: row.by_gesture for row in rows if row.test == test},
        )
        for test in tests
    )


def format_group_table(rows: Sequence[ComparisonRow], words: Words) -> str:
    """Format accuracies by person, or session, as a Markdown table of one test."""
    return format_accuracies(words.groups, {row.name: row.by_group for row in rows})


def format_accuracies(head: str, found: Mapping[str, Mapping[str, float]]) -> str:
    """Format accuracies of methods, each by name of a column, as a Markdown table."""
    columns = sorted({column for shares in found.values() for column in shares})
    lines = [format_head([head, *columns])]
    for name, shares in found.items():
        cells = (format_share(shares.get(column), 0.0) for column in columns)
        lines.append(format_row([name, *cells]))
    return "\n".join(lines)


def format_method(row: ComparisonRow) -> str:
    """Format a row of a table."""
    cells = (
        row.name,
        str(row.runs),
        format_share(row.val_accuracy, row.val_std),
        format_lead(row.val_ahead),
        format_share(row.test_accuracy, row.std),
        format_lead(row.test_ahead),
    )
    return format_row(cells)


def format_share(mean: float | None, std: float) -> str:
    """Format a mean with its standard deviation, if there is one, for a table."""
    if mean is None:
        return ""
    return f"{mean:.1%} ({std:.1%})" if std > 0 else f"{mean:.1%}"
