"""`eskin compare` and `eskin study`: these commands train many models on the same clips."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np
import tyro

from eskin.cli.checks import check_folder, check_picture
from eskin.errors import EskinError
from eskin.learn.baselines import Pooling
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
from eskin.learn.comparison.study import (
    StudyNetwork,
    Variant,
    build_study_rows,
    draw_study,
    format_study,
)
from eskin.model import check_limits


@dataclass(frozen=True)
class CompareCommand:
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


def run_compare(command: CompareCommand) -> dict[str, object]:
    """Train, answer, print the tables, and return their rows."""
    check_folder(command.results)
    check_folder(command.pack)
    draws = load_draws(command)
    for train, tests in draws:
        check_no_overlap_with_training(train, tests)
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
    found = group_results(command.methods, asked, done)
    rows = build_rows(found) if found else []
    if rows:
        print(f"{format_tables(rows)}\n\n{format_gesture_tables(rows)}")
    return {"rows": [asdict(row) for row in rows]}


def load_draws(
    command: CompareCommand,
) -> list[tuple[Examples, Mapping[str, Examples]]]:
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


def check_no_overlap_with_training(
    train: Examples, tests: Mapping[str, Examples]
) -> None:
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


def group_results(
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


@dataclass(frozen=True)
class StudyCommand:
    """Train networks with more and fewer neighbours, and other pooling.

    The data is one set of clips; where it has the parts `train` and `test`, the second
    is the test, else what is held out of it for validation is.
    """

    data: tyro.conf.Positional[tuple[Path, ...]]
    """A set of clips as `eskin generate --set paper` makes it, or several."""

    k: tuple[int, ...] = (4, 8, 16, 32)
    """Neighbours of a taxel inside its patch."""

    pool: tuple[Pooling, ...] = ("max", "mean")
    """How the nodes of a reading are pooled."""

    networks: tuple[StudyNetwork, ...] = ("eskin", "paper")
    """Whose networks."""

    seeds: int = 3
    """How often each is trained on each set."""

    epochs: int = 10
    """How often the paper's network sees each clip."""

    picture: Path | None = None
    """Where to draw the accuracies (.png)."""

    results: Path = Path("results")
    """Folder that keeps each result, so that a study that was cut goes on."""

    pack: Path = Path("pack")
    """Folder that keeps prepared clips."""

    workers: int = 1
    """How many processes train at once."""

    minutes: float = math.inf
    """After how long no further training is begun."""

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        limits = {"seeds": (1, np.inf), "epochs": (1, np.inf), "workers": (1, np.inf)}
        check_limits(self, limits)
        if not self.data:
            raise ValueError(
                "no set of clips is named; allowed is one or more, as eskin generate "
                "--set paper makes it; name one"
            )
        if not (self.k and min(self.k) > 0 and self.pool and self.networks):
            raise ValueError(
                "--k, --pool and --networks name nothing, or no neighbours; allowed "
                "is one word or more of each, and a --k of 1 and above; name some"
            )


def run_study(command: StudyCommand) -> dict[str, object]:
    """Train, print the table, and draw it where asked."""
    check_folder(command.results)
    check_folder(command.pack)
    if command.picture is not None:
        check_picture(command.picture)
    variants = [
        Variant(*each) for each in product(command.networks, command.k, command.pool)
    ]
    asked = [
        (variant, (place, seed))
        for seed in range(command.seeds)
        for place in range(len(command.data))
        for variant in variants
    ]
    tasks = [build_study_task(command, variant, *at) for variant, at in asked]
    done = run_tasks(tasks, command.results, command.workers, 60 * command.minutes)
    found: dict[Variant, dict[RunKey, MethodResult]] = {
        variant: {} for variant in variants
    }
    for (variant, at), result in zip(asked, done, strict=True):
        if result is not None:
            found[variant][at] = result
    left = done.count(None)
    if left:
        print(f"{left} of {len(done)} trainings are left; the same command goes on")
    rows = build_study_rows(found)
    if rows:
        print(format_study(rows))
        if command.picture is not None:
            draw_study(rows, command.picture)
    return {"rows": [asdict(row) for row in rows]}


def build_study_task(
    command: StudyCommand, variant: Variant, number: int, seed: int
) -> TrainingTask:
    """One training of a variant on one of the sets of clips."""
    place = command.data[number]
    train, test = place / "train", place / "test"
    parts = train.is_dir() and test.is_dir()
    learned = find_examples([train if parts else place], command.pack)
    tests = {"test": find_examples([test], command.pack)} if parts else {}
    name = f"{variant.network}-k{variant.k}-{variant.pool}"
    return TrainingTask(name, variant.method(command.epochs), learned, tests, seed)
