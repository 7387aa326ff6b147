"""Measure accuracy when skin, wiring, robot or rate differ from the training data.

python -m lab.robustness --train DIR ... --test DIR ... [--methods ...] [--kinds
...] [--picture FILE]: each method is trained once on the original clips of each
--train, and tested on those of its --test, both original and with every kind and amount
of corruption (`lab.corruption`). Results are kept, so the same command resumes
an interrupted run. It prints a table of the accuracy on all clips and the difference of
the first method, and draws them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eskin.learn.plots import save_figure
from lab.compare import train_all
from lab.comparison import (
    METHODS,
    Method,
    MethodResult,
    RunKey,
    TrainingTask,
    find_examples,
)
from lab.comparison.study import COLOURS
from lab.comparison.table import compute_lead, format_lead
from lab.corruption import KINDS, Corruption, Kind
from lab.tables import format_head, format_row

AMOUNTS: Mapping[Kind, tuple[float, ...]] = {
    "dead": (0.05, 0.1, 0.2),
    "patches": (1.0, 2.0),
    "noise": (0.002, 0.005, 0.01),
    "drift": (0.5, 1.0, 2.0),
    "lost": (0.05, 0.1, 0.2),
    "rate": (25.0, 100.0, 200.0),
    "pose-mm": (5.0, 10.0, 20.0),
    "pose-deg": (2.0, 5.0, 10.0),
}
"""Amounts of each kind."""
LABELS: Mapping[Kind, str] = {
    "dead": "share of taxels dead",
    "patches": "patches missing",
    "noise": "noise, share of full scale",
    "drift": "drift [kPa/s]",
    "lost": "share of scans lost",
    "rate": "rate of scans [Hz]",
    "pose-mm": "links displaced [mm]",
    "pose-deg": "links turned [degrees]",
}
"""Labels of the axes."""
UNHARMED = "as recorded"
RECORDED_HZ = 50.0
MARKERS = "osD^vPX*"
COLUMNS = 4


@dataclass(frozen=True)
class Command:
    """Train methods on original clips, and test them on corrupted ones."""

    train: tuple[Path, ...]
    """Training sets, each used on its own."""

    test: tuple[Path, ...]
    """Test set of each training set."""

    methods: tuple[str, ...] = (
        "eskin",
        "boosting-on-touch",
        "gradient-boosting",
        "random-forest",
    )
    """Methods of `eskin compare`."""

    kinds: tuple[Kind, ...] = KINDS
    """Kinds of corruption; other kinds require another training."""

    seed: int = 0
    """Seed of training and corruption; it increases by one with each set."""

    results: Path = Path("results.jsonl")
    """File of kept results."""

    pack: Path = Path("pack")
    """Folder of prepared clips; each corruption of a set is as large as the set."""

    workers: int = 1
    """Number of processes that train."""

    minutes: float = math.inf
    """Time after which no further training begins [min]."""

    picture: Path | None = None
    """Path of a picture of the curves."""

    def __post_init__(self) -> None:
        """Raise if methods are unknown or sets do not match."""
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown or not self.methods:
            raise ValueError(
                f"--methods names {', '.join(unknown) or 'none'}; allowed are "
                f"{', '.join(METHODS)}; correct the name"
            )
        if len(self.train) != len(self.test):
            raise ValueError(
                f"--train names {len(self.train)} and --test {len(self.test)}; allowed "
                "are as many of either; name one test for each"
            )


def main(command: Command, methods: Mapping[str, Method] = METHODS) -> None:
    """Train and test the methods, then print and draw the results.

    Args:
        command: options of the command.
        methods: methods by name.
    """
    tasks = [
        task for name in command.methods for task in build_tasks(command, name, methods)
    ]
    done = train_all(tasks, command.results, command.workers, command.minutes)
    found: dict[str, dict[RunKey, MethodResult]] = {}
    for result in done:
        if result is not None:
            place = result.seed - command.seed, result.seed
            found.setdefault(result.method, {})[place] = result
    # Methods are compared on the same sets only.
    whole = {name: rs for name, rs in found.items() if len(rs) == len(command.train)}
    if whole:
        print(table(whole))
        if command.picture is not None:
            draw(whole, command.kinds, command.picture)


def build_tasks(
    command: Command, name: str, methods: Mapping[str, Method]
) -> list[TrainingTask]:
    """Build the trainings of a method, each with every version of its test set."""
    tasks = []
    for n, places in enumerate(zip(command.train, command.test, strict=True)):
        # Sets begin at the same stamp, so only the seed has others harmed in each.
        seed = command.seed + n
        train, test = (find_examples([place], command.pack) for place in places)
        harms = [
            Corruption(kind, a, seed) for kind in command.kinds for a in AMOUNTS[kind]
        ]
        tests = {UNHARMED: test, **{h.name: replace(test, transform=h) for h in harms}}
        tasks.append(TrainingTask(name, methods[name], train, tests, seed))
    return tasks


def accuracy(results: Mapping[RunKey, MethodResult], asked: str) -> float:
    """Return the accuracy on all clips of a test [%]."""
    rights = [result.answered[asked].correct for result in results.values()]
    return 100 * float(np.concatenate(rights).mean())


def table(found: Mapping[str, Mapping[RunKey, MethodResult]]) -> str:
    """Format a table with a row per version of the test and a column per method."""
    answered = next(iter(next(iter(found.values())).values())).answered
    rows = [(asked, asked, found) for asked in answered if asked != "val"]
    return ahead_table("accuracy [%]", rows)


def ahead_table(
    head: str,
    rows: Sequence[tuple[str, str, Mapping[str, Mapping[RunKey, MethodResult]]]],
) -> str:
    """Format accuracies by method, and the difference of the first.

    Args:
        head: head of the first column.
        rows: label, name of the test, and results of each method.
    """
    name, *others = rows[0][2]
    heads = head, name, *(f"{each} ({name} ahead)" for each in others)
    lines = [format_head(heads)]
    for label, asked, found in rows:
        cells = (cell(results, found[name], asked) for results in found.values())
        lines.append(format_row([label, *cells]))
    return "\n".join(lines)


def cell(
    results: Mapping[RunKey, MethodResult],
    first: Mapping[RunKey, MethodResult],
    asked: str,
) -> str:
    """Format the accuracy of a method [%], and the lead of the first [points]."""
    share = f"{accuracy(results, asked):.1f}"
    if results is first:
        return share
    return f"{share} ({format_lead(compute_lead(results, first, asked))})"


def draw(
    found: Mapping[str, Mapping[RunKey, MethodResult]],
    kinds: Sequence[Kind],
    path: Path,
) -> None:
    """Draw a panel per kind, with a line per method."""
    columns = min(COLUMNS, len(kinds))
    rows = -(-len(kinds) // columns)
    size = (2.5 * columns + 0.6, 2.3 * rows + 0.5)
    figure = Figure(figsize=size, dpi=120, layout="constrained")
    every = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    for axes, kind in zip(every, kinds, strict=False):
        draw_kind(axes, found, kind)
    for axes in every[len(kinds) :]:
        axes.set_visible(False)
    for axes in figure.axes[::columns]:
        axes.set_ylabel("accuracy [%]")
    lines, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        lines, names, loc="outside upper center", ncols=len(names), frameon=False
    )
    save_figure(figure, path)


def draw_kind(
    axes: Axes, found: Mapping[str, Mapping[RunKey, MethodResult]], kind: Kind
) -> None:
    """Draw the accuracy of each method against the amount of one kind."""
    unharmed = RECORDED_HZ if kind == "rate" else 0.0
    points = {unharmed: UNHARMED}
    points |= {amount: Corruption(kind, amount).name for amount in AMOUNTS[kind]}
    amounts = sorted(points)
    for n, (name, results) in enumerate(found.items()):
        axes.plot(
            amounts,
            [accuracy(results, points[amount]) for amount in amounts],
            color=COLOURS[n % len(COLOURS)],
            marker=MARKERS[n % len(MARKERS)],
            ms=4,
            label=name,
        )
    if kind == "rate":
        axes.set_xscale("log")
    axes.set_xticks(amounts, [f"{amount:g}" for amount in amounts])
    axes.minorticks_off()
    axes.tick_params(labelsize=7)
    axes.set_xlabel(LABELS[kind], fontsize=8)
    axes.grid(alpha=0.3)


if __name__ == "__main__":
    main(tyro.cli(Command))
