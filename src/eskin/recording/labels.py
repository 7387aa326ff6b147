"""This module defines gesture labels, and rough ranges that a person marks."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Int

from eskin.errors import RecordingError
from eskin.files import MAX_YAML_BYTES, load_plain_yaml, read_file
from eskin.units import NS_PER_S

NONE = "none"
RANGE_MARGIN_S = 1.0
"""Margin of a rough range: half of the two seconds that the paper leaves between
gestures."""
MAX_ENTRY = 100
"""Number of characters of a range that messages show."""
EXAMPLE_RANGE = "{start_s: 1.5, end_s: 4.0, gesture: poke}"


@dataclass(frozen=True, order=True)
class Label:
    """A label names the gesture made from `start` until just before `end`."""

    start: int
    """First instant [ns since the epoch]."""
    end: int
    """First instant after the gesture [ns since the epoch]."""
    gesture: str
    """Name of the gesture, lower case; `none` means that nothing touched the skin."""
    source: Literal["true", "range", "auto"] = "true"
    """`true`: known; `range`: roughly marked; `auto`: found by automatic labelling."""

    def __post_init__(self) -> None:
        """Raise if the label ends before it starts or has no gesture."""
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
    """Return the labels of one source, or of all, sorted by start."""
    return tuple(sorted(x for x in labels if source in (None, x.source)))


def select_labels(labels: Iterable[Label]) -> tuple[Label, ...]:
    """Return the true labels; without any the automatic ones, else the rough ranges."""
    labels = tuple(labels)
    by_source = (sort_labels(labels, source) for source in ("true", "auto", "range"))
    return next((found for found in by_source if found), ())


def check_no_overlap(labels: Iterable[Label]) -> None:
    """Raise a RecordingError if two labels of one source overlap."""
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
    """Return the index into `gestures` of the gesture made at each stamp.

    Without a label, or with a gesture that is not in `gestures`, it is the index of
    `none`, or -1 if that is not in `gestures`. Of overlapping labels, the one that
    starts last counts.
    """
    known = {gesture: index for index, gesture in enumerate(gestures)}
    none = known.get(NONE, -1)
    instants = np.full(len(stamps), none, dtype=np.int64)
    for label in sort_labels(labels):
        inside = (stamps >= label.start) & (stamps < label.end)
        instants[inside] = known.get(label.gesture, none)
    return instants


def build_labels(
    stamps: Int[np.ndarray, "reading"],
    gestures: Sequence[str],
    period: int,
    source: Literal["true", "range", "auto"] = "true",
) -> tuple[Label, ...]:
    """Build one label for each run of equal gestures other than `none`.

    Args:
        stamps: stamps of the readings, increasing [ns since the epoch].
        gestures: name of the gesture at each reading.
        period: duration of the last reading [ns].
        source: source of the labels.
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


def load_ranges(path: Path | str, start: int) -> tuple[Label, ...]:
    """Load ranges from a YAML list of `{start_s, end_s, gesture}`.

    Args:
        path: path of the file.
        start: stamp from which the seconds count, the recording's first [ns].

    Raises:
        RecordingError: the file or an entry cannot be used.
    """
    try:
        text = read_file(Path(path), MAX_YAML_BYTES).decode("utf-8")
    except OSError as error:
        raise RecordingError(f"no ranges at {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path}: byte {error.start} is no UTF-8; save it as UTF-8"
        ) from None
    try:
        entries = load_plain_yaml(text)
    except ValueError as error:
        raise RecordingError(f"{path}{error}") from None
    if not isinstance(entries, list) or not entries:
        raise RecordingError(
            f"{path} holds no list; allowed are lines like - {EXAMPLE_RANGE}"
        )
    return sort_labels(
        parse_range(entry, f"{path}, range {number}", start)
        for number, entry in enumerate(entries, 1)
    )


def parse_range(entry: object, place: str, start: int) -> Label:
    """Convert one entry of a list of ranges; `place` names it in errors."""
    text = " ".join(f"{entry}"[:MAX_ENTRY].split())
    if not isinstance(entry, dict) or set(entry) != {"start_s", "end_s", "gesture"}:
        raise RecordingError(f"{place} is {text}; allowed is such as {EXAMPLE_RANGE}")
    first, last, gesture = entry["start_s"], entry["end_s"], entry["gesture"]
    if not isinstance(gesture, str) or not all(
        isinstance(value, int | float) and 0 <= value < 1e9 for value in (first, last)
    ):
        raise RecordingError(
            f"{place} is {text}; allowed are seconds since the first reading "
            f"and a gesture's name, such as {EXAMPLE_RANGE}"
        )
    if last <= first:
        raise RecordingError(f"{place} ends at {last} s, not after its start {first} s")
    begin, end = start + round(first * NS_PER_S), start + round(last * NS_PER_S)
    return Label(begin, end, gesture.strip().lower(), "range")


def build_rough_ranges(
    truth: Iterable[Label], margin: float = RANGE_MARGIN_S
) -> tuple[Label, ...]:
    """Widen and join true labels into ranges such as a person would mark.

    Widened labels of one gesture that meet become one range; those of different
    gestures are cut in the middle between the labels.

    Args:
        truth: labels, of which those of source `true` are used.
        margin: how far a range extends beyond its labels [s].
    """
    reach = round(margin * NS_PER_S)
    ranges: list[Label] = []
    for label in sort_labels(truth, "true"):
        if label.gesture == NONE:
            continue
        wide = Label(label.start - reach, label.end + reach, label.gesture, "range")
        before = ranges[-1] if ranges else None
        if before is None or wide.start >= before.end:
            ranges.append(wide)
        elif before.gesture == wide.gesture:
            ranges[-1] = replace(before, end=max(before.end, wide.end))
        else:
            middle = (before.end - reach + label.start) // 2
            middle = min(max(middle, before.start + 1), wide.end - 1)
            ranges[-1] = replace(before, end=middle)
            ranges.append(replace(wide, start=middle))
    return tuple(ranges)
