"""Pictures of comparisons."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eskin.learn.comparison.study import VariantRow
from eskin.learn.comparison.table import mean_of, spread_of
from eskin.learn.pictures import write

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
"""Readable by colour-blind people (Okabe and Ito 2008)."""


def draw_study(rows: Sequence[VariantRow], path: Path) -> None:
    """Draw accuracy against neighbours, validation left and test right."""
    figure = Figure(figsize=(7.5, 3.7), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for n, (network, pool) in enumerate(
        dict.fromkeys((r.network, r.pool) for r in rows)
    ):
        chosen = [r for r in rows if (r.network, r.pool) == (network, pool)]
        colour, label = COLOURS[n % 5], f"{network}, {pool}"
        # Beside each other, so that the spreads can be told apart.
        k = [r.k * 1.05**n for r in chosen]
        points = ((r.val_accuracy, r.val_std) for r in chosen)
        draw_line(left, k, points, colour, label)
        points = ((r.test_accuracy, r.test_std) for r in chosen)
        draw_line(right, k, points, colour, label)
    for axes, title in ((left, "validation"), (right, "test")):
        axes.set(xscale="log", xlabel="neighbours K", title=title)
        ticks = sorted({r.k for r in rows})
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    left.set_ylabel("clips right [%]")
    lines = right.get_legend_handles_labels()
    figure.legend(*lines, loc="outside upper center", ncols=4, frameon=False)
    write(figure, path)


def draw_line(
    axes: Axes,
    x: Sequence[int | float],
    points: Iterable[tuple[float | None, float]],
    colour: str,
    label: str,
) -> None:
    """Draw mean shares with their spreads, in percent; none where there is none."""
    y, spreads = 100 * np.array(list(points), float).T
    line = axes.errorbar(x, y, spreads, color=colour, marker="o", ms=4, capsize=3)
    line.set_label(label)


def draw_clips_curve(
    found: Mapping[str, Mapping[int, Sequence[float]]], path: Path
) -> None:
    """Draw accuracy against the number of clips learned.

    Args:
        found: accuracies by method and by number of clips.
        path: where to.
    """
    figure = Figure(figsize=(5.2, 3.6), dpi=120, layout="constrained")
    axes = figure.subplots()
    for colour, (name, by_size) in zip(COLOURS, found.items(), strict=False):
        points = [(mean_of(shares), spread_of(shares)) for shares in by_size.values()]
        draw_line(axes, list(by_size), points, colour, name)
    sizes = sorted({size for by_size in found.values() for size in by_size})
    axes.set(xscale="log", xlabel="clips learned", ylabel="clips right [%]")
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8)
    write(figure, path)
