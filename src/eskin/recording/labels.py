"""Labels: which gesture was made, from when until when, and who says so."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Int

from eskin.errors import RecordingError

NONE = "none"


@dataclass(frozen=True, order=True)
class Label:
    """One gesture from `start` until just before `end`."""

    start: int
    """First instant [ns since the epoch]."""
    end: int
    """First instant after it [ns since the epoch]."""
    gesture: str
    """Name of the gesture, lower case; `none` says that nobody touched."""
    source: Literal["true", "range", "auto"] = "true"
    """`true`: known; `range`: roughly marked; `auto`: found by automatic labelling."""

    def __post_init__(self) -> None:
        """Refuse a label that ends before it starts or names nothing."""
        if self.end <= self.start:
            raise RecordingError(
                f"label '{self.gesture}' ends at {self.end} ns, not after its start "
                f"{self.start} ns; the end is the first instant after the gesture"
            )
        if not self.gesture:
            raise RecordingError("label has no gesture; name one, or 'none'")


def sort_labels(
    labels: Iterable[Label], source: str | None = None
) -> tuple[Label, ...]:
    """Labels by start, of one source or of all."""
    return tuple(sorted(x for x in labels if source in (None, x.source)))


def best_labels(labels: Iterable[Label]) -> tuple[Label, ...]:
    """The true ones; where there are none the automatic ones, else the rough ones."""
    known = tuple(labels)
    each = (sort_labels(known, source) for source in ("true", "auto", "range"))
    return next((found for found in each if found), ())


def check_no_overlap(labels: Iterable[Label]) -> None:
    """Raise when two labels of one source share an instant.

    Raises:
        RecordingError: naming the first two that do.
    """
    last: dict[str, Label] = {}
    for label in sort_labels(labels):
        before = last.get(label.source)
        if before is not None and label.start < before.end:
            raise RecordingError(
                f"labels '{before.gesture}' until {before.end} ns and "
                f"'{label.gesture}' from {label.start} ns overlap; labels of one "
                "source follow each other; shorten one"
            )
        last[label.source] = label


def label_instants(
    labels: Iterable[Label],
    stamps: Int[np.ndarray, "reading"],
    gestures: Sequence[str],
) -> Int[np.ndarray, "reading"]:
    """Index into `gestures` of the gesture made at each stamp.

    Where there is no label, or one whose gesture is not in `gestures`, it is the index
    of `none`, or -1 where that is not in `gestures`. Where labels overlap the one that
    started last wins.
    """
    known = {gesture: index for index, gesture in enumerate(gestures)}
    none = known.get(NONE, -1)
    instants = np.full(len(stamps), none, dtype=np.int64)
    for label in sort_labels(labels):
        inside = (stamps >= label.start) & (stamps < label.end)
        instants[inside] = known.get(label.gesture, none)
    return instants


def labels_from_instants(
    stamps: Int[np.ndarray, "reading"],
    gestures: Sequence[str],
    period: int,
    source: Literal["true", "range", "auto"] = "true",
) -> tuple[Label, ...]:
    """One label for each run of equal gestures other than `none`.

    Args:
        stamps: of the readings, increasing [ns since the epoch].
        gestures: one name a reading.
        period: time that the last reading stands for [ns].
        source: who says so.
    """
    names = np.asarray(gestures)
    breaks = np.flatnonzero(names[1:] != names[:-1]) + 1
    firsts = [0, *breaks.tolist()]
    ends = [int(stamps[i]) for i in breaks] + [int(stamps[-1]) + period]
    return tuple(
        Label(int(stamps[first]), end, str(names[first]), source)
        for first, end in zip(firsts, ends, strict=True)
        if names[first] != NONE
    )
