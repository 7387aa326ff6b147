"""`eskin compare`: every method on the same clips (the paper's Table III)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from eskin.cli.checks import check_folder
from eskin.errors import EskinError
from eskin.learn.comparison import (
    METHODS,
    Examples,
    MethodResult,
    RunKey,
    TrainingTask,
    build_rows,
    find_examples,
    format_gesture_tables,
    format_tables,
    run_tasks,
)
from eskin.model import check_limits


@dataclass(frozen=True)
class Command:
    """Train every method on the same clips, and ask all of them the same others."""

    train: tuple[Path, ...]
    """Sets of clips to learn from; each is a draw of its own."""

    test: tuple[Path, ...]
    """The test of each of them; or several tests of a single one."""

    seeds: int = 1
    """How often each method is trained on each draw, always with a seed of its own."""

    methods: tuple[str, ...] = tuple(METHODS)
    """Which of them; the first is the one that others are held against."""

    results: Path = Path("results")
    """Folder that keeps each result, so that a comparison that was cut goes on."""

    pack: Path = Path("pack")
    """Folder that keeps prepared clips."""

    workers: int = 1
    """How many processes train at once."""

    minutes: float = math.inf
    """After how long no further training is begun."""

    def __post_init__(self) -> None:
        """Refuse what cannot be compared."""
        check_limits(self, {"seeds": (1, np.inf), "workers": (1, np.inf)})
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


def run(command: Command) -> dict[str, object]:
    """Train, answer, print the tables, and return their rows."""
    check_folder(command.results)
    check_folder(command.pack)
    draws = draws_of(command)
    for train, tests in draws:
        check_apart(train, tests)
    places = [
        (draw, seed) for draw in range(len(draws)) for seed in range(command.seeds)
    ]
    asked = [(name, place) for place in places for name in command.methods]
    tasks = [
        TrainingTask(name, METHODS[name], *draws[draw], draw * command.seeds + seed)
        for name, (draw, seed) in asked
    ]
    seconds = 60 * command.minutes
    done = run_tasks(tasks, command.results, command.workers, seconds)
    left = sum(result is None for result in done)
    if left:
        print(f"{left} of {len(done)} trainings are left; the same command goes on")
    found = sorted_out(command.methods, asked, done)
    rows = build_rows(found) if found else []
    if rows:
        print(f"{format_tables(rows)}\n\n{format_gesture_tables(rows)}")
    return {"rows": [asdict(row) for row in rows]}


def draws_of(command: Command) -> list[tuple[Examples, Mapping[str, Examples]]]:
    """What is learned from and what is asked then, draw by draw."""
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


def check_apart(train: Examples, tests: Mapping[str, Examples]) -> None:
    """Refuse to ask what has been learned.

    Raises:
        EskinError: if a recording of a test is among those to learn from.
    """
    learned = {path.resolve() for path in train.paths}
    for name, test in tests.items():
        both = [path for path in test.paths if path.resolve() in learned]
        if both:
            raise EskinError(
                f"{len(both)} recordings of --test {name}, such as {both[0]}, are in "
                "--train as well; allowed are none; name folders apart, as the parts "
                "SET/train and SET/test of eskin generate SET --set paper"
            )


def sorted_out(
    methods: Sequence[str],
    asked: Sequence[tuple[str, RunKey]],
    done: Sequence[MethodResult | None],
) -> dict[str, dict[RunKey, MethodResult]]:
    """What is there of each method, where the first has answered as well."""
    found: dict[str, dict[RunKey, MethodResult]] = {name: {} for name in methods}
    for (name, place), result in zip(asked, done, strict=True):
        if result is not None:
            found[name][place] = result
    first = found[methods[0]]
    kept = (
        (name, {place: each for place, each in results.items() if place in first})
        for name, results in found.items()
    )
    return {name: results for name, results in kept if results}
