"""Ranges in which a gesture was roughly made: marked by hand, or made from truth."""

from collections.abc import Iterable
from pathlib import Path

import yaml

from eskin.errors import RecordingError
from eskin.recording.labels import NONE, Label, sort_labels
from eskin.units import NS_PER_S

# The paper leaves two seconds between gestures: a range reaches half way.
MARGIN = 1.0
ENTRY = "{start_s: 1.5, end_s: 4.0, gesture: poke}"


def load_ranges(path: Path | str, start: int) -> tuple[Label, ...]:
    """Ranges from a YAML list of `{start_s, end_s, gesture}`.

    Args:
        path: of the file.
        start: stamp that the seconds count from, the recording's first [ns].

    Raises:
        RecordingError: naming the entry that cannot be used.
    """
    try:
        entries = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise RecordingError(f"no ranges at {path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        words = " ".join(str(error).split())
        raise RecordingError(f"{path} is not YAML: {words}") from error
    if not isinstance(entries, list) or not entries:
        raise RecordingError(f"{path} holds no list; allowed are lines like - {ENTRY}")
    return sort_labels(
        range_of(entry, f"{path}, range {number}", start)
        for number, entry in enumerate(entries, 1)
    )


def range_of(entry: object, place: str, start: int) -> Label:
    """One range from its entry."""
    if not isinstance(entry, dict) or set(entry) != {"start_s", "end_s", "gesture"}:
        raise RecordingError(f"{place} is {entry}; allowed is such as {ENTRY}")
    first, last, gesture = entry["start_s"], entry["end_s"], entry["gesture"]
    if not isinstance(gesture, str) or not all(
        isinstance(value, int | float) and 0 <= value < 1e9 for value in (first, last)
    ):
        raise RecordingError(
            f"{place} is {entry}; allowed are seconds since the first reading and a "
            f"gesture's name, such as {ENTRY}"
        )
    if last <= first:
        raise RecordingError(f"{place} ends at {last} s, not after its start {first} s")
    begin, end = start + round(first * NS_PER_S), start + round(last * NS_PER_S)
    return Label(begin, end, gesture.strip().lower(), "range")


def rough_ranges(truth: Iterable[Label], margin: float = MARGIN) -> tuple[Label, ...]:
    """Ranges such as a person would mark: true labels widened and joined by gesture.

    Neighbours of one gesture become one range where they meet; those of different
    gestures share what lies between them half and half.

    Args:
        truth: labels, of which those of source `true` count.
        margin: how far a range reaches beyond its labels [s].
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
            ranges[-1] = spanning(before, before.start, max(before.end, wide.end))
        else:
            middle = (before.end - reach + label.start) // 2
            middle = min(max(middle, before.start + 1), wide.end - 1)
            ranges[-1] = spanning(before, before.start, middle)
            ranges.append(spanning(wide, middle, wide.end))
    return tuple(ranges)


def spanning(label: Label, start: int, end: int) -> Label:
    """The same label over another time."""
    return Label(start, end, label.gesture, label.source)
