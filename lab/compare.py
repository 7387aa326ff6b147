"""Train every method on the same examples, and test all of them on the same others.

    python -m lab.compare --train SETS/train --test SETS/test --seeds 3
    python -m lab.compare --recordings FOLDER --hold-out subject

The first compares on clips of generated sets, the second on labelled recordings of any
skin: each person, or session, is held out in turn, and all others are trained on.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from eskin.cli.checks import check_folder, check_writable
from eskin.errors import EskinError
from eskin.live import check_limits
from eskin.units import format_count
from lab.comparison.examples import Examples, find_examples
from lab.comparison.methods import METHODS, METHODS_ON_RECORDINGS, Method
from lab.comparison.results import (
    AnsweredClips,
    MethodResult,
    TrainingTask,
    find_stale,
    run_tasks,
)
from lab.comparison.segments import Group, find_segments
from lab.comparison.table import (
    ComparisonRow,
    RunKey,
    Words,
    build_rows,
    format_gesture_tables,
    format_group_table,
    format_tables,
)
from lab.program import run_program

HELD_OUT = "held out"
"""Name of the test on recordings: each is of a group that was held out."""


@dataclass(frozen=True)
class CompareCommand:
    """Train every method on the same examples and test all on the same others."""

    train: tuple[Path, ...] = ()
    """Training sets of clips; each is a draw of its own."""

    test: tuple[Path, ...] = ()
    """Test set of each training set, or several test sets of a single one."""

    recordings: tuple[Path, ...] = ()
    """Labelled recordings of one skin, or folders of them, in place of sets."""

    hold_out: Group = "subject"
    """Part of the recordings that is held out at a time."""

    shear: bool = True
    """Whether methods use the shear of recordings whose skin measures it."""

    rename: dict[str, str] = field(default_factory=dict)
    """Gestures of recordings, each followed by another name; several may share one."""

    seeds: int = 1
    """Number of trainings of each method on each draw, each with its own seed."""

    methods: tuple[str, ...] = ()
    """Methods to compare, all unless given; the others are compared with the first."""

    results: Path = Path("results.jsonl")
    """File that keeps each result, so that an interrupted comparison can go on."""

    pack: Path = Path("pack")
    """Folder that keeps prepared recordings."""

    workers: int = 1
    """Number of processes that train at once."""

    minutes: float = math.inf
    """Time after which no further training is started [min]."""

    def __post_init__(self) -> None:
        """Raise if an option is out of range or does not fit the others."""
        check_limits(self, {"seeds": (1, np.inf), "workers": (1, np.inf)}, "--")
        known = METHODS_ON_RECORDINGS if self.recordings else METHODS
        unknown = [name for name in self.methods if name not in known]
        if unknown:
            raise ValueError(
                f"--methods names {', '.join(unknown)}; allowed are {', '.join(known)}"
            )
        if bool(self.recordings) == bool(self.train or self.test):
            raise ValueError(
                f"--recordings names {len(self.recordings)}, --train {len(self.train)} "
                f"and --test {len(self.test)}; allowed are recordings, or sets to "
                "train and to test on; name one or the other"
            )
        if len(self.train) not in (1, len(self.test)):
            raise ValueError(
                f"--train names {len(self.train)} and --test {len(self.test)}; allowed "
                "are as many of either, or a single --train; name one test a draw"
            )
        names = [place.name for place in self.test]
        several = len(self.train) == 1
        if several and (len(set(names)) < len(names) or "val" in names):
            raise ValueError(
                f"--test names folders {', '.join(names)}; allowed is each name once, "
                "and none called val"
            )


def run_compare(
    command: CompareCommand, methods: Mapping[str, Method] | None = None
) -> dict[str, object]:
    """Train and test methods, print the tables, and return their rows.

    Args:
        command: the command.
        methods: all methods by name, where they are not the usual ones.
    """
    check_writable(command.results)
    check_folder(command.pack)
    if command.recordings:
        rows = compare_on_recordings(command, methods or METHODS_ON_RECORDINGS)
    else:
        rows = compare_on_clips(command, methods or METHODS)
    return {"rows": [asdict(row) for row in rows]}


def compare_on_clips(
    command: CompareCommand, methods: Mapping[str, Method]
) -> list[ComparisonRow]:
    """Train and test methods on sets of clips, print tables, and return their rows."""
    draws = load_draws(command)
    for train, tests in draws:
        check_test_is_held_out(train, tests)
    names = command.methods or tuple(methods)
    runs = list(product(range(len(draws)), range(command.seeds)))
    wanted = [(name, run) for run in runs for name in names]
    tasks = [
        TrainingTask(name, methods[name], *draws[draw], draw * command.seeds + seed)
        for name, (draw, seed) in wanted
    ]
    results = train_all(tasks, command.results, command.workers, command.minutes)
    found = group_results(names, wanted, results)
    rows = build_rows(found) if found else []
    if rows:
        print(f"{format_tables(rows)}\n\n{format_gesture_tables(rows)}")
    return rows


def compare_on_recordings(
    command: CompareCommand, methods: Mapping[str, Method]
) -> list[ComparisonRow]:
    """Cross-validate methods on recordings, print tables, and return their rows."""
    examples = find_segments(
        command.recordings,
        command.pack,
        command.hold_out,
        command.shear,
        command.rename,
        command.workers,
    )
    folds = list(examples.split_folds().values())
    names = command.methods or tuple(methods)
    wanted = [(name, (0, seed)) for seed in range(command.seeds) for name in names]
    tasks = [
        TrainingTask(name, methods[name], train, {HELD_OUT: test}, seed, share=0.0)
        for name, (_, seed) in wanted
        for train, test in folds
    ]
    results = train_all(tasks, command.results, command.workers, command.minutes)
    firsts = range(0, len(results), len(folds))
    joined = [join_folds(results[first : first + len(folds)]) for first in firsts]
    found = group_results(names, wanted, joined)
    rows = build_rows(found) if found else []
    if rows:
        groups = "people" if command.hold_out == "subject" else "sessions"
        words = Words("segments", groups)
        tables = (
            format_tables(rows, words),
            format_group_table(rows, words),
            format_gesture_tables(rows, words),
        )
        print("\n\n".join(tables))
    return rows


def join_folds(results: Sequence[MethodResult | None]) -> MethodResult | None:
    """Join the results of all folds of one method and seed; None if one is missing."""
    found = [result for result in results if result is not None]
    if len(found) < len(results):
        return None
    answered = [result.answered[HELD_OUT] for result in found]
    joined = AnsweredClips(
        truth=tuple(gesture for each in answered for gesture in each.truth),
        answer=tuple(gesture for each in answered for gesture in each.answer),
        people=tuple(group for each in answered for group in each.people),
    )
    seconds = sum(result.seconds for result in found)
    return replace(found[0], seconds=seconds, answered={HELD_OUT: joined})


def train_all(
    tasks: Sequence[TrainingTask],
    path: Path,
    workers: int = 1,
    minutes: float = math.inf,
) -> list[MethodResult | None]:
    """Run tasks; print which of their results were stale, and how many are left.

    Args:
        tasks: tasks to run.
        path: file that keeps results.
        workers: number of processes.
        minutes: time after which no further task is begun [min].
    """
    stale = find_stale(tasks, path)
    if stale:
        print(
            f"{len(stale)} of {len(tasks)} results in {path} are stale, of other code, "
            "settings or data, and are made again:"
        )
        print("\n".join(f"  {label}" for label in stale), flush=True)
    results = run_tasks(tasks, path, workers, 60 * minutes)
    left = sum(result is None for result in results)
    if left:
        print(f"{left} of {len(results)} trainings are left; the same command goes on")
    return results


def load_draws(
    command: CompareCommand,
) -> list[tuple[Examples, Mapping[str, Examples]]]:
    """Find the training clips and the test clips of each draw."""
    workers = command.workers
    trains, tests = (
        [find_examples([place], command.pack, workers) for place in places]
        for places in (command.train, command.test)
    )
    if len(trains) == 1:
        names = [place.name for place in command.test]
        return [(trains[0], dict(zip(names, tests, strict=True)))]
    both = zip(trains, tests, strict=True)
    return [(train, {"test": test}) for train, test in both]


def check_test_is_held_out(train: Examples, tests: Mapping[str, Examples]) -> None:
    """Raise if a recording of a test set is in the training set too."""
    training_paths = {path.resolve() for path in train.paths}
    for name, test in tests.items():
        both = [path for path in test.paths if path.resolve() in training_paths]
        if both:
            raise EskinError(
                f"--test {name} has {format_count(len(both), 'recording')} of --train, "
                f"such as {both[0]}; allowed are none; name folders apart, as the "
                "parts SET/train and SET/test of eskin generate SET --set paper"
            )


def group_results(
    methods: Sequence[str],
    wanted: Sequence[tuple[str, RunKey]],
    results: Sequence[MethodResult | None],
) -> dict[str, dict[RunKey, MethodResult]]:
    """Group results by method; keep the runs that the first method has as well."""
    found: dict[str, dict[RunKey, MethodResult]] = {name: {} for name in methods}
    for (name, run), result in zip(wanted, results, strict=True):
        if result is not None:
            found[name][run] = result
    first = found[methods[0]]
    kept = (
        (name, {run: result for run, result in by_run.items() if run in first})
        for name, by_run in found.items()
    )
    return {name: by_run for name, by_run in kept if by_run}


if __name__ == "__main__":
    sys.exit(run_program(run_compare))
