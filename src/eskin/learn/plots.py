"""This module draws scores as figures in files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int
from matplotlib.figure import Figure

from eskin.files import atomic_path
from eskin.learn.metrics import Reliability


def draw_confusion(
    confusion: Int[np.ndarray, "true predicted"],
    vocabulary: Sequence[str],
    path: Path,
    title: str,
) -> None:
    """Draw a confusion matrix, each row as shares of its class, with its counts."""
    size = 1.8 + 0.5 * len(vocabulary)
    figure = Figure(figsize=(size, size), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    shares = confusion / np.maximum(confusion.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="cividis", vmin=0, vmax=1)
    for (true, predicted), count in np.ndenumerate(confusion):
        if count:
            color = "black" if shares[true, predicted] > 0.6 else "white"
            axes.text(
                predicted, true, str(count), ha="center", va="center", color=color
            )
    ticks = range(len(vocabulary))
    axes.set_xticks(ticks, vocabulary, rotation=60, ha="right")
    axes.set_yticks(ticks, vocabulary)
    axes.set(xlabel="predicted", ylabel="true", title=title)
    save_figure(figure, path)


def draw_reliability(found: Reliability, path: Path, title: str) -> None:
    """Draw accuracy and number of predictions by their confidence."""
    figure = Figure(figsize=(4.2, 4.8), dpi=120, layout="constrained")
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(3, 1))
    edges = np.linspace(0, 1, len(found.count) + 1)
    width = edges[1]
    some = found.count > 0
    upper.bar(
        edges[:-1][some],
        found.accuracy[some],
        width,
        align="edge",
        color="tab:blue",
        edgecolor="white",
        label="accuracy",
    )
    upper.plot(found.confidence[some], found.accuracy[some], "o", color="black", ms=3)
    upper.plot([0, 1], [0, 1], "--", color="gray", label="perfect calibration")
    upper.set(xlim=(0, 1), ylim=(0, 1), ylabel="accuracy")
    upper.set_title(f"{title}, ECE {found.error:.3f}")
    upper.legend(loc="upper left", frameon=False)
    lower.bar(edges[:-1], found.count, width, align="edge", color="gray")
    for edge, count in zip(edges, found.count.tolist(), strict=False):
        if count:
            place = edge + width / 2, count
            lower.annotate(str(count), place, ha="center", va="bottom", fontsize=6)
    lower.set(xlabel="confidence", ylabel="predictions")
    lower.margins(y=0.25)
    save_figure(figure, path)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure to a file, whole or not at all."""
    with atomic_path(path) as part:
        figure.savefig(part)
