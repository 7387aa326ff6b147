"""`eskin study`: neighbours and pooling of the contact graph (the paper's Fig. 32)."""

import math
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np
import tyro

from eskin.cli.checks import check_folder, check_picture
from eskin.learn.baselines import Pooling
from eskin.learn.comparison import (
    MethodResult,
    RunKey,
    TrainingTask,
    find_examples,
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
class Command:
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


def run(command: Command) -> dict[str, object]:
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
    tasks = [task_of(command, variant, *at) for variant, at in asked]
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


def task_of(command: Command, variant: Variant, number: int, seed: int) -> TrainingTask:
    """One training of a variant on one of the sets of clips."""
    place = command.data[number]
    train, test = place / "train", place / "test"
    parts = train.is_dir() and test.is_dir()
    learned = find_examples([train if parts else place], command.pack)
    tests = {"test": find_examples([test], command.pack)} if parts else {}
    name = f"{variant.network}-k{variant.k}-{variant.pool}"
    return TrainingTask(name, variant.method(command.epochs), learned, tests, seed)
