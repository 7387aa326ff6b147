"""Repeat the paper's experiments on simulated sets, and print its tables.

    python -m lab.paper PART --sets FOLDER [--form short] [--minutes M]

PART is one of table2, table3, fig11, distances, forms, variants or all. Sets that are
missing in FOLDER are generated there. Answers are kept in FOLDER/kept/paper.jsonl, so
that no trial is run twice and an interrupted run goes on. `--form short` shows in a
minute that all of it runs.
"""

import math
import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.baselines import NETWORKS
from lab.compare import train_all
from lab.latency import Command as LatencyCommand
from lab.latency import measure_on_one_core
from lab.paper.pictures import draw_neighbours
from lab.paper.printed import ACCURACIES, TIMES_MS
from lab.paper.trials import (
    DISTANCES,
    FORMS,
    NEIGHBOURS,
    POOLINGS,
    Answers,
    Place,
    Trial,
    build_task,
    compute_accuracy,
    format_lead,
    name_cell,
    name_distance,
)
from lab.program import run_program
from lab.tables import format_head, format_row

FLATTENED = ("svm-max", "knn-max", "mlp-max")
"""The paper's methods on flattened values, each taxel's maximum over the window."""
SIGNAL = "signal-svm"
"""An SVM on the total force over time alone, which knows no place."""

Part = Literal["table2", "table3", "fig11", "distances", "forms", "variants", "all"]


@dataclass(frozen=True)
class PaperCommand:
    """Repeat the paper's experiments on simulated sets, and print its tables."""

    part: tyro.conf.Positional[Part] = "all"
    """Table or figure to make."""

    form: Literal["short", "long"] = "long"
    """Whether all is computed, or little of it, to show that it runs."""

    sets: Path = Path("sets")
    """Folder of the sets."""

    draws: int = 3
    """Number of draws of each set; each also has a seed of its own."""

    workers: int = os.cpu_count() or 1
    """Number of processes that train."""

    minutes: float = math.inf
    """Time after which a part begins no further training [min]."""

    picture: Path | None = None
    """File for the picture of Fig. 11."""

    @property
    def is_short(self) -> bool:
        """Return whether little is computed."""
        return self.form == "short"

    @property
    def place(self) -> Place:
        """Return where the sets are."""
        if self.is_short:
            return Place(self.sets, 33, 3, self.workers, epochs=1)
        return Place(self.sets, None, None, self.workers)


def run(command: PaperCommand) -> dict[str, object]:
    """Print the tables of a part, or of all parts."""
    names = PARTS if command.part == "all" else {command.part: PARTS[command.part]}
    for name, part in names.items():
        print(f"\n## {name}\n", flush=True)
        part(command)
    return {"parts": list(names)}


def run_trials(
    command: PaperCommand, forms: Iterable[str], methods: Iterable[str]
) -> Answers:
    """Run the trials of methods on forms that have not been run yet."""
    methods = list(dict.fromkeys(methods))
    draws = 1 if command.is_short else command.draws
    trials = [
        Trial(form, method, draw)
        for draw in range(draws)
        for form in forms
        for method in methods
    ]
    place = command.place
    tasks = [build_task(trial, place) for trial in trials]
    results = train_all(tasks, place.results, command.workers, command.minutes)
    pairs = zip(trials, results, strict=True)
    return {trial: result for trial, result in pairs if result is not None}


def format_accuracy(answers: Answers, form: str, method: str, test: str) -> str:
    """Return an accuracy with its interval as a cell of a table."""
    found = compute_accuracy(answers, form, method, test)
    return "" if found is None else str(found)


def print_table2(command: PaperCommand) -> None:
    """Compare accuracies (Table II)."""
    methods = ["eskin", "boosting-on-touch", "paper", "paper-ten-epochs"]
    methods += ["paper-every-reading", *NETWORKS, *FLATTENED, SIGNAL]
    if command.is_short:
        methods = ["paper", *FLATTENED]
    methods = list(dict.fromkeys(methods))
    answers = run_trials(command, ["paper"], methods)
    heads = ("method", "paper: validation", "test", "here: validation", "test", "ahead")
    print(format_head(heads))
    for method in methods:
        printed = [f"{share:.1f}" for share in ACCURACIES.get(method, ())]
        cells = [
            method,
            *(printed or ["", ""]),
            format_accuracy(answers, "paper", method, "val"),
            format_accuracy(answers, "paper", method, "test"),
            format_lead(answers, "paper", methods[0], method),
        ]
        print(format_row(cells))


def print_table3(command: PaperCommand) -> None:
    """Compare times of one step (Table III)."""
    baselines = ("paper", "cnn-lstm", *FLATTENED)
    settings = LatencyCommand(baselines=baselines)
    if command.is_short:
        settings = LatencyCommand(baselines=("knn-max",), clips=20)
    rows = measure_on_one_core(settings)
    ours = rows[0].p50_ms
    print(format_head(("method", "paper [ms]", "here, p50 [ms]", "steps of eskin")))
    for row in rows:
        printed = TIMES_MS.get(row.name.split(",")[0])
        if printed is None and row is not rows[0]:
            continue
        cells = [
            row.name,
            "" if printed is None else f"{printed}",
            f"{row.p50_ms:.3f}",
            f"{row.p50_ms / ours:.1f}",
        ]
        print(format_row(cells))


def print_fig11(command: PaperCommand) -> None:
    """Compare numbers of neighbours and poolings (Fig. 11)."""
    neighbours = NEIGHBOURS[:1] if command.is_short else NEIGHBOURS
    cells = [(k, pooling) for k in neighbours for pooling in POOLINGS]
    answers = run_trials(command, ["paper"], [name_cell(*cell) for cell in cells])
    columns = [(pooling, test) for pooling in POOLINGS for test in ("val", "test")]
    print(format_head(("K", *(f"{pooling}, {test}" for pooling, test in columns))))
    for k in neighbours:
        row = [
            format_accuracy(answers, "paper", name_cell(k, pooling), test)
            for pooling, test in columns
        ]
        print(format_row([str(k), *row]))
    if command.picture is not None:
        draw_neighbours(answers, neighbours, command.picture)


def print_distances(command: PaperCommand) -> None:
    """Compare distances between taxels (section IV-A5)."""
    forms = ["paper-folded"] if command.is_short else ["paper", "paper-folded"]
    methods = [name_distance(distance) for distance in DISTANCES]
    answers = run_trials(command, forms, methods)
    columns = [(form, test) for form in forms for test in ("val", "test")]
    print(format_head(("distance", *(f"{FORMS[f]}, {t}" for f, t in columns))))
    for distance, words in DISTANCES.items():
        cells = (
            format_accuracy(answers, form, name_distance(distance), test)
            for form, test in columns
        )
        print(format_row([words, *cells]))


def print_forms(command: PaperCommand) -> None:
    """Compare methods on all forms of the data set."""
    methods = ["eskin", "paper", "cnn-lstm", *FLATTENED, SIGNAL]
    if command.is_short:
        methods = ["knn-max", "svm-max"]
    answers = run_trials(command, FORMS, methods)
    columns = [(form, test) for form in FORMS for test in ("val", "test")]
    heads = ("method", "paper", *(f"{FORMS[form]}, {test}" for form, test in columns))
    print(format_head(heads))
    for method in methods:
        printed = " ".join(f"{share:.1f}" for share in ACCURACIES.get(method, ()))
        cells = (format_accuracy(answers, form, method, t) for form, t in columns)
        print(format_row([method, printed, *cells]))
    print(f"\n{format_head((f'{methods[0]} ahead, test', *FORMS.values()))}")
    for method in methods[1:]:
        cells = (format_lead(answers, form, methods[0], method) for form in FORMS)
        print(format_row([method, *cells]))


def print_variants(command: PaperCommand) -> None:
    """Compare the paper's network with what ours has, one thing at a time."""
    methods = ["paper", "paper-augmented", "paper-on-touch"]
    if command.is_short:
        methods = ["paper-on-touch"]
    answers = run_trials(command, ["paper"], methods)
    print(format_head(("method", "validation", "test")))
    for method in methods:
        cells = (format_accuracy(answers, "paper", method, t) for t in ("val", "test"))
        print(format_row([method, *cells]))


PARTS: dict[str, Callable[[PaperCommand], None]] = {
    "table2": print_table2,
    "table3": print_table3,
    "fig11": print_fig11,
    "distances": print_distances,
    "forms": print_forms,
    "variants": print_variants,
}
"""Functions that print each part."""


if __name__ == "__main__":
    sys.exit(run_program(run))
