"""This module describes the touches of examples by rows of features and by series."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from eskin.learn.dataset import Dataset
from eskin.live import PRESSURE_SUMMARY, SLOT_NS, compute_summary
from lab.baselines.hand import compute_features, compute_statistics
from lab.baselines.series import COLUMNS, align_series

Arrays = dict[str, np.ndarray]
"""Arrays of the examples of one recording, by name."""

Form = Literal["features", "summary", "series"]
"""Hand-made features of a touch; statistics of its summary, and the summary at its end;
series in each of its windows."""


@dataclass(frozen=True)
class TouchSpan:
    """A touch span names the rows of a data set that hold the touch of an example."""

    first: int
    """First row of the touch."""
    ends: tuple[int, ...]
    """Last row of each window in which it is classified; the last ends the touch."""


def select_rows(touch: TouchSpan) -> Int[np.ndarray, "reading"]:
    """Return the rows of a touch."""
    return np.arange(touch.first, touch.ends[-1] + 1)


def describe_by_features(
    dataset: Dataset, touch: TouchSpan, shear: bool
) -> Float[np.ndarray, "1 feature"]:
    """Return the hand-made features of a touch."""
    return compute_features(dataset, select_rows(touch), shear)[None]


def describe_by_summary(
    dataset: Dataset, touch: TouchSpan, shear: bool
) -> Float[np.ndarray, "1 feature"]:
    """Return statistics of a touch's summary, and the summary at its end."""
    summary = compute_summary(dataset.graphs.select(select_rows(touch)), shear)
    return np.concatenate([compute_statistics(summary.T), summary[-1]])[None]


def describe_by_series(
    dataset: Dataset, touch: TouchSpan, shear: bool
) -> Float[np.ndarray, "window channel 100"]:
    """Return the series of a touch in each of its windows, those of shear last."""
    rows = select_rows(touch)
    summary = compute_summary(dataset.graphs.select(rows), shear)
    columns = [*COLUMNS, *range(len(PRESSURE_SUMMARY), summary.shape[1])]
    slots = dataset.stamps[rows] // SLOT_NS
    lengths = np.array(touch.ends) - touch.first + 1
    return np.stack([align_series(summary[:n, columns], slots[:n]) for n in lengths])


DESCRIPTIONS: dict[Form, Callable[[Dataset, TouchSpan, bool], np.ndarray]] = {
    "features": describe_by_features,
    "summary": describe_by_summary,
    "series": describe_by_series,
}
"""Functions that describe a touch, by form."""


def describe_touches(
    dataset: Dataset, touches: Sequence[TouchSpan | None], shear: bool
) -> Arrays:
    """Return every form of the touches of examples.

    Args:
        dataset: data set of the touches.
        touches: touch of each example; None for one without.
        shear: whether shear is described.

    Returns:
        `count`, the number of examples, and of each form its rows and the index of the
        example of each, `FORM_example`.
    """
    touched = [(n, touch) for n, touch in enumerate(touches) if touch is not None]
    arrays: Arrays = {"count": np.array(len(touches))}
    for form, describe in DESCRIPTIONS.items():
        rows = [describe(dataset, touch, shear) for _, touch in touched]
        numbers = [np.full(len(r), n) for (n, _), r in zip(touched, rows, strict=True)]
        arrays[form] = np.concatenate(rows) if rows else np.zeros(0)
        arrays[f"{form}_example"] = (
            np.concatenate(numbers) if rows else np.zeros(0, int)
        )
    return arrays


@dataclass(frozen=True, eq=False)
class TouchRows:
    """Touch rows describe the touches of all examples in one form."""

    rows: Float[np.ndarray, "row *feature"]
    """Features or series; zeros for an example without a touch."""
    example: Int[np.ndarray, "row"]
    """Index of the example of each row, ascending; every example has at least one."""


def join_touch_rows(parts: Sequence[Arrays], form: Form) -> TouchRows:
    """Join one form of the touches of several recordings.

    Args:
        parts: arrays of each recording (see `describe_touches`).
        form: form to join.
    """
    rows = [part[form] for part in parts if len(part[form])]
    example = number_examples(parts, f"{form}_example")
    missing = np.setdiff1d(np.arange(sum(int(p["count"]) for p in parts)), example)
    if len(missing):
        shape = rows[0].shape[1:] if rows else (1,)
        rows.append(np.zeros((len(missing), *shape)))
        example = np.concatenate([example, missing])
    order = np.argsort(example, kind="stable")
    return TouchRows(np.concatenate(rows)[order], example[order])


def number_examples(parts: Sequence[Arrays], name: str) -> Int[np.ndarray, "row"]:
    """Return the array of a name, the examples of all recordings counted through."""
    counts = np.array([int(part["count"]) for part in parts])
    firsts = np.cumsum(counts) - counts
    pairs = zip(parts, firsts, strict=True)
    return np.concatenate([part[name] + first for part, first in pairs])


def average_rows(
    values: Float[np.ndarray, "row class"], example: Int[np.ndarray, "row"]
) -> Float[np.ndarray, "example class"]:
    """Return the mean of the rows of each example.

    Args:
        values: values of each row.
        example: index of the example of each row, as in `TouchRows`.
    """
    starts = np.unique(example, return_index=True)[1]
    counts = np.bincount(example)
    return np.add.reduceat(values, starts, axis=0) / counts[:, None]
