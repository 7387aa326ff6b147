"""Tables of the comparison: means, spreads, leads with intervals, by gesture."""

import numpy as np
import pytest

from lab.compare import group_results
from lab.comparison.results import AnsweredClips, MethodResult
from lab.comparison.table import (
    Lead,
    Words,
    build_rows,
    format_gesture_tables,
    format_group_table,
    format_tables,
)


def answered(right):
    truth = tuple("poke" for _ in right)
    answer = tuple("poke" if each else "grab" for each in right)
    return AnsweredClips(truth, answer, tuple(f"p{n % 5}" for n in range(len(right))))


def result(name, seed, right):
    return MethodResult(
        name, seed, 1.0, {"val": answered([True]), "test": answered(right)}
    )


def test_the_lead_is_over_runs_that_both_methods_have():
    good = [True] * 40
    bad = [True, False] * 20
    found = {
        "ours": {(0, 0): result("ours", 0, good), (1, 0): result("ours", 0, bad)},
        "other": {(1, 0): result("other", 0, [False] * 40)},
    }
    ours, other = build_rows(found)
    assert ours.test_accuracy == pytest.approx(0.75) and ours.runs == 2
    assert ours.std == pytest.approx(np.std([1.0, 0.5], ddof=1))
    assert ours.val_std == 0.0
    table = format_tables([ours, other])
    assert "| ours | 2 | 100.0% |  | 75.0% (35.4%) |  |" in table
    assert "| ours ahead | test (SD) | ours ahead |" in table
    assert ours.val_ahead is None and ours.test_ahead is None
    assert other.test_ahead.mean == pytest.approx(0.5)
    assert 0 < other.test_ahead.low <= other.test_ahead.mean <= other.test_ahead.high


def test_tables_count_people_of_different_draws_as_different():
    answers = {"val": answered([True]), "test": answered([True] * 40)}
    places = ((0, 0), (0, 1), (1, 2))
    (row,) = build_rows(
        {"ours": {at: MethodResult("ours", at[1], 1.0, answers) for at in places}}
    )
    people = 2 * len(set(answers["test"].people))
    assert (row.val_people, row.val_clips) == (2, 2)
    assert (row.test_people, row.test_clips) == (people, 80)
    tested = f"Tested on 80 clips of {people} people, intervals over people"
    validated = "validated on 2 clips of 2 people, intervals over clips"
    assert f"\n\n{tested}; {validated}.\n\n" in format_tables([row])


def test_runs_that_the_first_method_lacks_are_not_compared():
    runs = [(name, (n, n)) for n in (0, 1) for name in ("ours", "other")]
    first, second, left = (result(name, 0, [True]) for name in ("ours", "other", "-"))
    found = group_results(("ours", "other"), runs, [first, second, None, left])
    assert found == {"ours": {(0, 0): first}, "other": {(0, 0): second}}


def test_intervals_resample_people_not_clips():
    """Clips of one person are right or wrong together."""
    ours = [True] * 40
    theirs = [n % 5 < 3 for n in range(40)]
    found = {
        name: {(0, 0): result(name, 0, right)}
        for name, right in (("ours", ours), ("other", theirs))
    }
    by_person = build_rows(found)[1].test_ahead
    assert by_person.mean == pytest.approx(0.4)
    assert by_person.low == 0.0 and by_person.high == pytest.approx(0.8)


def test_people_of_different_draws_are_resampled_apart():
    def one(name, draw, right):
        return MethodResult(
            name, draw, 1.0, {"test": AnsweredClips(("a",), (right,), ("p0",))}
        )

    found = {
        name: {(0, 0): one(name, 0, "a"), (1, 1): one(name, 1, second)}
        for name, second in (("ours", "a"), ("other", "b"))
    }
    assert build_rows(found)[1].test_ahead == Lead(0.5, 0.0, 1.0)


def test_accuracy_by_gesture_pools_the_clips_of_all_draws():
    def one(name, draw, truth, answer):
        people = ("p0",) * len(truth)
        test = AnsweredClips(tuple(truth), tuple(answer), people)
        return MethodResult(name, draw, 1.0, {"a": test, "b": test})

    found = {
        "ours": {
            (0, 0): one("ours", 0, "xxy", "xxx"),
            (1, 1): one("ours", 1, "x", "x"),
        },
        "other": {
            (0, 0): one("other", 0, "xxy", "xyy"),
            (1, 1): one("other", 1, "x", "y"),
        },
    }
    rows = build_rows(found)
    assert [row.by_gesture for row in rows[:2]] == [
        {"x": 1.0, "y": 0.0},
        {"x": pytest.approx(1 / 3), "y": 1.0},
    ]
    table, _ = format_gesture_tables(rows).split("\n\n")
    assert table.splitlines() == [
        "| a, clips of | x | y |",
        "|---|---|---|",
        "| ours | 100.0% | 0.0% |",
        "| other | 33.3% | 100.0% |",
    ]


@pytest.mark.parametrize(("people", "over"), [(4, "segments"), (5, "sessions")])
def test_intervals_are_over_groups_where_there_are_enough_of_them(people, over):
    """Examples of one group are right or wrong together, so theirs are wider."""

    def one(name, right):
        groups = tuple(f"p{n % people}" for n in range(40))
        given = ("a",) * 40
        answers = AnsweredClips(given, tuple("a" if r else "b" for r in right), groups)
        return {(0, 0): MethodResult(name, 0, 1.0, {"test": answers})}

    ours = one("ours", [True] * 40)
    rows = build_rows(
        {"ours": ours, "other": one("other", [n % people < 2 for n in range(40)])}
    )
    lead = rows[1].test_ahead
    width = lead.high - lead.low
    assert width > 0.5 if over == "sessions" else width < 0.4
    words = Words("segments", "sessions")
    line = f"Tested on 40 segments of {people} sessions, intervals over {over}."
    assert line in format_tables(rows, words)


def test_accuracy_by_group_pools_all_runs():
    runs = {
        (0, seed): MethodResult("ours", seed, 1.0, {"test": answered(right)})
        for seed, right in enumerate(([True] * 5, [True, False, False, True, True]))
    }
    table = format_group_table(build_rows({"ours": runs}), Words(groups="sessions"))
    assert table.splitlines() == [
        "| sessions | p0 | p1 | p2 | p3 | p4 |",
        "|---|---|---|---|---|---|",
        "| ours | 100.0% | 50.0% | 50.0% | 100.0% | 100.0% |",
    ]


def test_a_tie_is_shown():
    good = [True] * 40
    bad = [True, False] * 20
    found = {
        name: {(0, 0): result(name, 0, right)}
        for name, right in (("ours", good), ("tie", good), ("other", bad))
    }
    lines = format_tables(build_rows(found)).splitlines()[2:5]
    ends = [line.split(" | ")[5].strip(" |") for line in lines]
    assert ends[:2] == ["", "+0.0 [+0.0, +0.0]"] and ends[2].startswith("+50.0 [")
