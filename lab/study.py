"""Train networks with more and fewer neighbours, and with other pooling (Fig. 32).

python -m lab.study SETS/paper --k 4 8 16 32 --pool max mean
"""

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eskin.cli.checks import check_folder, check_picture, check_writable
from eskin.learn.plots import save_figure
from eskin.live import GraphConfig, check_limits
from lab.baselines import Pooling
from lab.compare import train_all
from lab.comparison.examples import find_examples
from lab.comparison.methods import (
    FIT_CONFIGS,
    FOR_SMALL_SETS,
    Method,
    RecogniserMethod,
    build_paper_method,
)
from lab.comparison.results import MethodResult, TrainingTask
from lab.comparison.table import (
    LEGEND,
    Lead,
    RunKey,
    format_lead,
    format_share,
    summarise_test,
)
from lab.program import run_program
from lab.tables import format_head, format_row

StudyNetwork = Literal["eskin", "paper"]


@dataclass(frozen=True)
class Variant:
    """A variant is a network with a number of neighbours and a way of pooling."""

    network: StudyNetwork
    """Network that is varied."""
    k: int
    """Number of neighbours of a taxel inside its patch."""
    pool: Pooling
    """Pooling over the nodes of a reading."""

    def build_method(self, epochs: int) -> Method:
        """Return the method that trains the variant."""
        if self.network == "paper":
            fit = replace(FIT_CONFIGS["paper"], epochs=epochs)
            return build_paper_method(fit, self.k, self.pool)
        config = replace(FOR_SMALL_SETS, graph=GraphConfig(fixed=self.k))
        return RecogniserMethod(config, self.pool)


@dataclass(frozen=True)
class VariantRow(Variant):
    """A variant row summarises the results of one variant."""

    runs: int
    """Number of times that it was trained."""
    val_accuracy: float | None
    """Mean accuracy on validation; None where nothing could be held out."""
    val_std: float
    """Standard deviation; 0 of a single run."""
    val_ahead: Lead | None
    """Lead of the first variant of this network; None for the first itself, and where
    nothing could be held out."""
    test_accuracy: float | None
    """Mean accuracy on the test; None where there is no test."""
    test_std: float
    """Standard deviation; 0 of a single run."""
    test_ahead: Lead | None
    """Lead of the first variant of this network on the test."""


def build_study_rows(
    found: Mapping[Variant, Mapping[RunKey, MethodResult]],
) -> list[VariantRow]:
    """Return one row for each variant, from its runs that its network's first has too.

    Args:
        found: results by variant and by run.
    """
    firsts: dict[StudyNetwork, Variant] = {}
    rows = []
    for variant, results in found.items():
        first = firsts.setdefault(variant.network, variant)
        shared = {key: r for key, r in results.items() if key in found[first]}
        if shared:
            other = None if variant == first else found[first]
            rows.append(build_study_row(variant, shared, other))
    return rows


def build_study_row(
    variant: Variant,
    results: Mapping[RunKey, MethodResult],
    first: Mapping[RunKey, MethodResult] | None,
) -> VariantRow:
    """Return the row of a variant, compared with the first of its network."""
    val, val_std, val_ahead = summarise_test(results, first, "val")
    test, test_std, test_ahead = summarise_test(results, first, "test")
    facts = asdict(variant) | {"runs": len(results)}
    return VariantRow(
        **facts,
        val_accuracy=val,
        val_std=val_std,
        val_ahead=val_ahead,
        test_accuracy=test,
        test_std=test_std,
        test_ahead=test_ahead,
    )


def format_study(rows: Sequence[VariantRow]) -> str:
    """Format the rows as a Markdown table."""
    lead = f"K {rows[0].k}, {rows[0].pool} ahead"
    heads = ["network", "K", "pooling", "runs", "validation (SD)", lead]
    heads += ["test (SD)", lead]
    lines = [format_head(heads)]
    for row in rows:
        cells = (
            row.network,
            str(row.k),
            row.pool,
            str(row.runs),
            format_share(row.val_accuracy, row.val_std),
            format_lead(row.val_ahead),
            format_share(row.test_accuracy, row.test_std),
            format_lead(row.test_ahead),
        )
        lines.append(format_row(cells))
    return "\n".join([*lines, "", LEGEND])


COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
"""Colour-blind safe palette (Okabe and Ito 2008)."""


def draw_study(rows: Sequence[VariantRow], path: Path) -> None:
    """Draw accuracy against neighbours, on validation and on the test."""
    figure = Figure(figsize=(7.5, 3.7), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    curves = dict.fromkeys((r.network, r.pool) for r in rows)
    for n, (network, pool) in enumerate(curves):
        chosen = [r for r in rows if (r.network, r.pool) == (network, pool)]
        colour, label = COLOURS[n % 5], f"{network}, {pool}"
        # Points are shifted, so that their error bars do not overlap.
        k = [r.k * 1.05**n for r in chosen]
        points = ((r.val_accuracy, r.val_std) for r in chosen)
        plot_shares(left, k, points, colour, label)
        points = ((r.test_accuracy, r.test_std) for r in chosen)
        plot_shares(right, k, points, colour, label)
    for axes, title in ((left, "validation"), (right, "test")):
        axes.set(xscale="log", xlabel="neighbours K", title=title)
        ticks = sorted({r.k for r in rows})
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    left.set_ylabel("accuracy [%]")
    lines = right.get_legend_handles_labels()
    figure.legend(*lines, loc="outside upper center", ncols=4, frameon=False)
    save_figure(figure, path)


def plot_shares(
    axes: Axes,
    x: Sequence[int | float],
    points: Iterable[tuple[float | None, float]],
    colour: str,
    label: str,
) -> None:
    """Plot mean shares with their standard deviations, in percent."""
    y, spreads = 100 * np.array(list(points), float).T
    line = axes.errorbar(x, y, spreads, color=colour, marker="o", ms=4, capsize=3)
    line.set_label(label)


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
