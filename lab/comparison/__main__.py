"""Compare recognisers on simulated people, and print the tables.

python -m lab.comparison [PART] --sets FOLDER [--form short]: PART is one of table,
large or all. Sets that are missing in FOLDER are generated there. The answers of each
method are kept in FOLDER/kept, one file per table, so that nothing is trained twice and
an interrupted run can be resumed. Answers of other code, settings or clips are reported
and computed again.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab import compare
from lab.baselines import NETWORKS
from lab.comparison.methods import METHODS
from lab.simulated_sets import made_set

TESTS = ("test-s", "test-p", "test-x", "test-m")


@dataclass(frozen=True)
class Form:
    """Sets the extent of the tables."""

    draws: int
    """Number of paper-size sets."""
    clips: int | None
    """Number of clips of each; the paper's number if None."""
    table: tuple[str, ...]
    """Methods trained on paper-size sets."""
    train: int | None
    """Number of clips of the large training set; all if None."""
    test: int | None
    """Number of clips of each large test set; all if None."""
    tests: tuple[str, ...]
    """Large test sets."""
    large: tuple[str, ...]
    """Methods trained on the large training set."""


FORMS = {
    "short": Form(
        draws=1,
        clips=33,
        table=("boosting-on-touch", "svm-max", "gradient-boosting"),
        train=40,
        test=16,
        tests=("test-m",),
        large=("boosting-on-touch", "gradient-boosting"),
    ),
    "long": Form(
        draws=10,
        clips=None,
        table=tuple(name for name in METHODS if name not in NETWORKS),
        train=3000,
        test=1000,
        tests=TESTS,
        large=tuple(name for name in METHODS if name not in ("paper", "3d-cnn")),
    ),
}


@dataclass(frozen=True)
class Command:
    """Compute and print the tables."""

    part: tyro.conf.Positional[Literal["table", "large", "all"]] = "all"
    """Table to compute."""

    form: Literal["short", "long"] = "long"
    """Sets the extent of the tables."""

    sets: Path = Path("sets")
    """Folder of the sets."""

    workers: int = os.cpu_count() or 1
    """Number of processes that train."""

    minutes: float = math.inf
    """Time after which a part begins no further training [min]."""


def main() -> None:
    """Compute and print the chosen tables."""
    command = tyro.cli(Command)
    for name, part in {"table": table, "large": large}.items():
        if command.part in (name, "all"):
            print(f"\n## {name}\n", flush=True)
            part(command, FORMS[command.form])


def table(command: Command, form: Form) -> None:
    """Compare all methods on paper-size sets, as the paper's Table II does.

    Each has its own people, poses, build and seed; a short one has six people.
    """
    draws = [
        made_set(
            command.sets,
            "paper",
            clips=form.clips,
            people=None if form.clips is None else 6,
            seed=seed,
            workers=command.workers,
        )
        for seed in range(form.draws)
    ]
    trains, tests = ([draw / part for draw in draws] for part in ("train", "test"))
    show_compared(command, "table", trains, tests, form.table)


def large(command: Command, form: Form) -> None:
    """Compare methods trained on many people, on the large tests."""
    sets = command.sets
    workers = command.workers
    train = made_set(sets, "train", clips=form.train, workers=workers)
    tests = [
        made_set(sets, name, clips=form.test, workers=workers) for name in form.tests
    ]
    show_compared(command, "large", [train], tests, form.large)


def show_compared(
    command: Command,
    name: str,
    trains: Sequence[Path],
    tests: Sequence[Path],
    methods: tuple[str, ...],
) -> None:
    """Compare methods on sets; keep their answers by the name of the table."""
    compare.run_compare(
        compare.CompareCommand(
            tuple(trains),
            tuple(tests),
            methods=methods,
            results=command.sets / "kept" / f"{name}.jsonl",
            pack=command.sets / "pack",
            workers=command.workers,
            minutes=command.minutes,
        )
    )


if __name__ == "__main__":
    main()
