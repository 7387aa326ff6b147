"""Train networks with more and fewer neighbours, and with other pooling (Fig. 32).

python -m lab.study SETS/paper --k 4 8 16 32 --pool max mean
"""

import math
import sys
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np
import tyro

from eskin.cli.checks import check_folder, check_picture, check_writable
from eskin.live import check_limits
from lab.baselines import Pooling
from lab.compare import train_all
from lab.comparison import MethodResult, RunKey, TrainingTask, find_examples
from lab.comparison.study import (
    StudyNetwork,
    Variant,
    build_study_rows,
    draw_study,
    format_study,
)
from lab.program import run_program


@dataclass(frozen=True)
class StudyCommand:
    """Train networks with more and fewer neighbours, and with other pooling.

    Where a set of clips has the parts `train` and `test`, the second is the test set;
    otherwise the clips held out of it for validation are.
    """

    data: tyro.conf.Positional[tuple[Path, ...]]
    """A set of clips as `eskin generate --set paper` makes it, or several."""

    k: tuple[int, ...] = (4, 8, 16, 32)
    """Numbers of neighbours of a taxel inside its patch."""

    pool: tuple[Pooling, ...] = ("max", "mean")
    """Poolings of the nodes of a reading."""

    networks: tuple[StudyNetwork, ...] = ("eskin", "paper")
    """Networks to train: that of eskin and that of the paper."""

    seeds: int = 3
    """Number of trainings of each network on each set, each with its own seed."""

    epochs: int = 10
    """Number of epochs of the paper's network."""

    picture: Path | None = None
    """Path of a plot of the accuracies (.png)."""

    results: Path = Path("results.jsonl")
    """File that keeps each result, so that an interrupted study can go on."""

    pack: Path = Path("pack")
    """Folder that keeps prepared clips."""

    workers: int = 1
    """Number of processes that train at once."""

    minutes: float = math.inf
    """Time after which no further training is started [min]."""

    def __post_init__(self) -> None:
        """Raise if an option is out of range or names nothing."""
        limits = {"seeds": (1, np.inf), "epochs": (1, np.inf), "workers": (1, np.inf)}
        check_limits(self, limits, "--")
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
    """Train all variants, print the table, and draw it if asked to."""
    check_writable(command.results)
    check_folder(command.pack)
    if command.picture is not None:
        check_picture(command.picture)
    variants = [
        Variant(*each) for each in product(command.networks, command.k, command.pool)
    ]
    wanted = [
        (variant, (number, seed))
        for seed in range(command.seeds)
        for number in range(len(command.data))
        for variant in variants
    ]
    tasks = [build_study_task(command, variant, *run) for variant, run in wanted]
    found: dict[Variant, dict[RunKey, MethodResult]] = {each: {} for each in variants}
    results = train_all(tasks, command.results, command.workers, command.minutes)
    for (variant, run), result in zip(wanted, results, strict=True):
        if result is not None:
            found[variant][run] = result
    rows = build_study_rows(found)
    if rows:
        print(format_study(rows))
        if command.picture is not None:
            draw_study(rows, command.picture)
    return {"rows": [asdict(row) for row in rows]}


def build_study_task(
    command: StudyCommand, variant: Variant, number: int, seed: int
) -> TrainingTask:
    """Build the training of a variant on one of the sets of clips."""
    folder = command.data[number]
    train, test = folder / "train", folder / "test"
    has_parts = train.is_dir() and test.is_dir()
    examples = find_examples([train if has_parts else folder], command.pack)
    tests = {"test": find_examples([test], command.pack)} if has_parts else {}
    name = f"{variant.network}-k{variant.k}-{variant.pool}"
    return TrainingTask(
        name, variant.build_method(command.epochs), examples, tests, seed
    )


if __name__ == "__main__":
    sys.exit(run_program(run_study))
