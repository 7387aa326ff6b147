"""Pictures of scores."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Int
from matplotlib.figure import Figure


def draw_confusion(
    confusion: Int[np.ndarray, "true predicted"],
    vocabulary: Sequence[str],
    path: Path,
    title: str,
) -> None:
    """Draw the confusions, each row as shares of the true class with its counts."""
    size = 1.8 + 0.5 * len(vocabulary)
    figure = Figure(figsize=(size, size), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    shares = confusion / np.maximum(confusion.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="cividis", vmin=0, vmax=1)
    for (true, said), count in np.ndenumerate(confusion):
        if count:
            colour = "black" if shares[true, said] > 0.6 else "white"
            axes.text(said, true, str(count), ha="center", va="center", color=colour)
    ticks = range(len(vocabulary))
    axes.set_xticks(ticks, vocabulary, rotation=60, ha="right")
    axes.set_yticks(ticks, vocabulary)
    axes.set(xlabel="recognised", ylabel="made", title=title)
    picture = BytesIO()
    figure.savefig(picture, format=path.suffix.removeprefix(".") or "png")
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(picture.getvalue())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
