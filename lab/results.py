"""Compare recognisers on simulated people, and print the tables.

python -m lab.results [PART] --sets FOLDER [--form short]: PART is one of table, large,
study or all. Sets that are missing in FOLDER are generated there. The answers of each
method are kept in FOLDER/kept, one file per table, so that nothing is trained twice
and an interrupted run can be resumed; pictures go to FOLDER/pictures. Answers of other
code, settings or clips are reported and computed again.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab import compare, study
from lab.baselines import NETWORKS
from lab.comparison.methods import METHODS
from lab.simulated_sets import made_set

Part = Literal["table", "large", "study", "all"]
TESTS = ("test-s", "test-p", "test-x", "test-m")


@dataclass(frozen=True)
class Form:
    """Sets the extent of the tables."""

    draws: int
    """Number of paper-size sets."""
    clips: int | None
    """Number of clips of each; that of the paper if None."""
    table: tuple[str, ...]
    """Methods trained on paper-size sets."""
    network_draws: int
    """Number of these sets for the networks of others."""
    train: int | None
    """Number of clips of the large training set; all if None."""
    test: int | None
    """Number of clips of each large test set; all if None."""
    tests: tuple[str, ...]
    """Large test sets."""
    large: tuple[str, ...]
    """Methods trained on the large training set."""
    studies: Mapping[str, tuple[int, tuple[str, ...]]]
    """Studies of neighbours and pooling, by name of the picture: number of paper-size
    sets, and further options."""


FORMS = {
    "short": Form(
        draws=1,
        clips=33,
        table=("boosting-on-touch", "svm-max", "gradient-boosting"),
        network_draws=0,
        train=40,
        test=16,
        tests=("test-m",),
        large=("boosting-on-touch", "gradient-boosting"),
        studies={
            "study": (
                1,
                ("--networks", "paper", "--k", "8", "--epochs", "1", "--seeds", "1"),
            )
        },
    ),
    "long": Form(
        draws=10,
        clips=None,
        table=tuple(name for name in METHODS if name not in NETWORKS),
        network_draws=3,
        train=3000,
        test=1000,
        tests=TESTS,
        large=tuple(name for name in METHODS if name not in ("paper", "3d-cnn")),
        studies={
            "study": (1, ("--epochs", "5", "--seeds", "1")),
            "study_ours": (3, ("--networks", "eskin", "--seeds", "1")),
        },
    ),
}


@dataclass(frozen=True)
class Command:
    """Compute and print the tables."""

    part: tyro.conf.Positional[Part] = "all"
    """Table to compute."""

    form: Literal["short", "long"] = "long"
    """Sets the extent of the tables."""

    sets: Path = Path("sets")
    """Folder of the sets."""

    workers: int = os.cpu_count() or 1
    """Number of processes that train."""

    minutes: float = math.inf
    """Time after which a part begins no further training [min]."""

    @property
    def results(self) -> Path:
        """Folder of the answers of methods."""
        return self.sets / "kept"

    @property
    def pictures(self) -> Path:
        """Folder of the pictures."""
        return self.sets / "pictures"

    def options(self, table: str) -> dict[str, object]:
        """Return the options of the comparison of a table."""
        return {
            "results": self.results / f"{table}.jsonl",
            "pack": self.sets / "pack",
            "workers": self.workers,
            "minutes": self.minutes,
        }


def main() -> None:
    """Compute and print the chosen tables."""
    command = tyro.cli(Command)
    for name, part in PARTS.items():
        if command.part in (name, "all"):
            print(f"\n## {name}\n", flush=True)
            part(command, FORMS[command.form])


def paper_sets(command: Command, count: int) -> list[Path]:
    """Generate paper-size sets, each with its own people, poses, build and seed."""
    return [paper_set(command, FORMS[command.form].clips, n) for n in range(count)]


def paper_set(command: Command, clips: int | None, seed: int) -> Path:
    """Generate a paper-size set; with `clips`, of six people and that many clips."""
    return made_set(
        *(command.sets, "paper"),
        clips=clips,
        people=None if clips is None else 6,
        seed=seed,
        workers=command.workers,
    )


def split_draws(draws: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return the training set and the test set of each draw."""
    return tuple(d / "train" for d in draws), tuple(d / "test" for d in draws)


def table(command: Command, form: Form) -> None:
    """Compare all methods on paper-size sets (Table III)."""
    draws = paper_sets(command, form.draws)
    show_compared(command, form, draws, form.table)
    if form.network_draws:
        print("\nNetworks of others on the first of these:\n")
        networks = ("eskin", *NETWORKS)
        show_compared(command, form, draws[: form.network_draws], networks)


def show_compared(
    command: Command, form: Form, draws: Sequence[Path], methods: tuple[str, ...]
) -> None:
    """Compare methods on some draws."""
    trains, tests = split_draws(draws)
    compare.run_compare(
        compare.CompareCommand(
            trains,
            tests,
            methods=methods,
            **command.options("table"),  # type: ignore
        )
    )


def large(command: Command, form: Form) -> None:
    """Compare methods trained on many people, on the large tests."""
    sets, workers = command.sets, command.workers
    train = made_set(sets, "train", clips=form.train, workers=workers)
    tests = tuple(
        made_set(sets, name, clips=form.test, workers=workers) for name in form.tests
    )
    compare.run_compare(
        compare.CompareCommand(
            (train,),
            tests,
            methods=form.large,
            **command.options("large"),  # type: ignore
        )
    )


def show_study(command: Command, form: Form) -> None:
    """Compare numbers of neighbours and kinds of pooling (Fig. 32)."""
    for name, (draws, words) in form.studies.items():
        data = [str(place) for place in paper_sets(command, draws)]
        picture = str(command.pictures / f"{name}.png")
        chosen = tyro.cli(
            study.StudyCommand, args=[*data, *words, "--picture", picture]
        )
        changed = {**vars(chosen), **command.options("study")}
        print(f"On {draws} of the sets:\n")
        study.run_study(study.StudyCommand(**changed))
        print()


PARTS: dict[str, Callable[[Command, Form], None]] = {
    "table": table,
    "large": large,
    "study": show_study,
}


if __name__ == "__main__":
    main()
