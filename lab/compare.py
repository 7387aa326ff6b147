"""Train every method on the same clips, and test all of them on the same others.

python -m lab.compare --train SETS/train --test SETS/test --seeds 3
"""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np

from eskin.cli.checks import check_folder, check_writable
from eskin.errors import EskinError
from eskin.live import check_limits
from eskin.units import format_count
from lab.comparison.examples import Examples, find_examples
from lab.comparison.methods import METHODS, Method
from lab.comparison.results import MethodResult, TrainingTask, find_stale, run_tasks
from lab.comparison.table import (
    RunKey,
    build_rows,
    format_gesture_tables,
    format_tables,
)
from lab.program import run_program


@dataclass(frozen=True)
class CompareCommand:
    """Train every method on the same clips and test all of them on the same others."""

    train: tuple[Path, ...]
    """Training sets of clips; each is a draw of its own."""

    test: tuple[Path, ...]
    """Test set of each training set, or several test sets of a single one."""

    seeds: int = 1
    """Number of trainings of each method on each draw, each with its own seed."""

    methods: tuple[str, ...] = tuple(METHODS)
    """Methods to compare; the others are compared with the first."""

    results: Path = Path("results.jsonl")
    """File that keeps each result, so that an interrupted comparison can go on."""

    pack: Path = Path("pack")
    """Folder that keeps prepared clips."""

    workers: int = 1
    """Number of processes that train at once."""

    minutes: float = math.inf
    """Time after which no further training is started [min]."""

    def __post_init__(self) -> None:
        """Raise if an option is out of range or does not fit the others."""
        check_limits(self, {"seeds": (1, np.inf), "workers": (1, np.inf)}, "--")
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown or not self.methods:
            raise ValueError(
                f"--methods names {', '.join(unknown) or 'none'}; allowed are "
                f"{', '.join(METHODS)}; correct the name"
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
                "and none called val; rename one"
            )


def run_compare(
    command: CompareCommand, methods: Mapping[str, Method] = METHODS
) -> dict[str, object]:
    """Train and test all methods, print the tables, and return their rows.

    Args:
        command: the command.
        methods: methods by name.
    """
    check_writable(command.results)
    check_folder(command.pack)
    draws = load_draws(command)
    for train, tests in draws:
        check_test_is_held_out(train, tests)
    runs = list(product(range(len(draws)), range(command.seeds)))
    wanted = [(name, run) for run in runs for name in command.methods]
    tasks = [
        TrainingTask(name, methods[name], *draws[draw], draw * command.seeds + seed)
        for name, (draw, seed) in wanted
    ]
    results = train_all(tasks, command.results, command.workers, command.minutes)
    found = group_results(command.methods, wanted, results)
    rows = build_rows(found) if found else []
    if rows:
        print(f"{format_tables(rows)}\n\n{format_gesture_tables(rows)}")
    return {"rows": [asdict(row) for row in rows]}


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
            "settings or clips, and are made again:"
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
