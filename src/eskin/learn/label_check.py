"""This module checks the labels of recordings before they are learned or scored.

A wrong label is taken for the truth: a model learns it, and a score counts it. So what
contradicts the recording, the other labels or the touches is refused, or told where it
may be right.
"""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from eskin.errors import RecordingError
from eskin.learn.ground_truth import LabelMatch
from eskin.recording import (
    NONE,
    Label,
    Recording,
    check_gesture_names,
    check_no_overlap,
    select_labels,
)
from eskin.recording.records import describe_label
from eskin.units import NS_PER_S, format_count, format_duration

logger = logging.getLogger(__name__)

MAX_WRONG = 0.5
"""Share of the labels of a recording that may lie beside it, or beside its touches."""
FEWEST = 3
"""Number of labels without a touch from which on they are refused. Fewer may be of
touches that are too faint to be felt."""
LONGEST_SHIFT = 60.0
"""Longest shift that is looked for between labels and touches [s]."""
SPREAD = 0.5
"""Largest difference of the distances of labels from their touches if they are shifted
together [s]."""
MOST_COMPARED = 500
"""Number of labels and of touches that a shift is looked for with."""


def check_labels(recordings: Iterable[Recording]) -> None:
    """Refuse labels that contradict each other or their recordings.

    Raises:
        RecordingError: naming the recording, the label and its time, if a gesture
            has a name that no model can have, two labels overlap, or most lie outside
            of their recording.
    """
    names: dict[str, None] = {}
    for recording in recordings:
        labels = select_labels(recording.labels)
        for label in labels:
            if label.gesture not in names:
                names[label.gesture] = None
                check_name(recording, label, names)
        try:
            check_no_overlap(labels, recording.start)
        except RecordingError as error:
            raise RecordingError(f"{recording.path}: {error}") from None
        check_inside(recording)


def check_name(recording: Recording, label: Label, names: Iterable[str]) -> None:
    """Raise if the latest of some names, a label's, cannot stand with them."""
    try:
        check_gesture_names(names)
    except RecordingError as error:
        seconds = (label.start - recording.start) / NS_PER_S
        raise RecordingError(
            f"{recording.path}, label at {seconds:.2f} s: {error}"
        ) from None


def find_outside(recording: Recording) -> tuple[Label, ...]:
    """Return the labels of a recording that lie outside of it."""
    return tuple(
        label
        for label in select_labels(recording.labels)
        if not label.is_within(recording.start, recording.end)
    )


def check_inside(recording: Recording) -> None:
    """Raise if most labels lie outside of a recording."""
    outside = find_outside(recording)
    if len(outside) > MAX_WRONG * len(select_labels(recording.labels)):
        raise RecordingError(
            f"{describe_outside(recording, outside)}; allowed are labels during the "
            "recording; correct their clock or unit (nanoseconds, as the stamps of "
            "readings)"
        )


def describe_outside(recording: Recording, outside: Sequence[Label]) -> str:
    """Return how many labels lie outside of a recording, and where, for messages."""
    distances = [
        max(label.start - recording.end, recording.start - label.end)
        for label in outside
    ]
    near = format_duration(min(distances) / NS_PER_S)
    far = format_duration(max(distances) / NS_PER_S)
    distance = near if near == far else f"{near} to {far}"
    first = outside[0]
    side = "after its end" if first.start > recording.end else "before its start"
    count = len(select_labels(recording.labels))
    return (
        f"{recording.path}: {len(outside)} of {count} labels lie outside of the "
        f"recording, {distance} from it; the first is '{first.gesture}', {side}"
    )


def check_touches(matches: Sequence[LabelMatch]) -> None:
    """Refuse labels that lie beside the touches, of one recording or of all together.

    These are labels of which most hold no touch, while as many touches have no label.
    Where touches are missing as well, they may have been too faint.

    Raises:
        RecordingError: naming recording, label and time, and how far the touches are
            from their labels.
    """
    for match in matches:
        check_together([match])
    check_together(matches)


def warn_of_labels(matches: Sequence[LabelMatch]) -> None:
    """Tell which labels are left out, and how many gestures were not felt."""
    for match in matches:
        outside = find_outside(match.recording)
        if outside:
            text = describe_outside(match.recording, outside)
            logger.warning("%s; they are left out", text)
    missed = [(each.recording, label) for each in matches for label in each.missed]
    if missed:
        recording, first = missed[0]
        logger.warning(
            "%s; the first is '%s' at %.2f s of %s; what is not felt counts as missed",
            f"{format_count(len(missed), 'label')} without a touch",
            first.gesture,
            (first.start - recording.start) / NS_PER_S,
            recording.path,
        )


def check_together(matches: Sequence[LabelMatch]) -> None:
    """Raise if the labels of some recordings lie beside their touches."""
    gestures = [select_gestures(match) for match in matches]
    pairs = list(zip(matches, gestures, strict=True))
    empty = [
        (match.recording, label)
        for match, labels in pairs
        for label in labels
        if not find_touches(match, [label]).any()
    ]
    count = sum(map(len, gestures))
    if len(empty) < FEWEST or len(empty) <= MAX_WRONG * count:
        return
    unlabelled = sum(
        int((~find_touches(match, select_labels(match.recording.labels))).sum())
        for match in matches
    )
    if unlabelled < len(empty):
        return
    shift = find_shift(pairs)
    remedy = "correct their times"
    if shift is not None:
        side = "earlier" if shift < 0 else "later"
        remedy = (
            f"the touches are {format_duration(abs(shift))} {side}: shift the labels "
            f"by {shift:+.2f} s"
        )
    recording, first = empty[0]
    raise RecordingError(
        f"{recording.path}: {len(empty)} of {count} labels hold no touch, the first "
        f"is {describe_label(first, recording.start)}, while {unlabelled} touches have "
        f"no label; allowed are labels that hold their touches; {remedy}"
    )


def select_gestures(match: LabelMatch) -> list[Label]:
    """Return the labels of gestures in a recording of a calibrated skin.

    Others have a graph at every reading, so that every label holds one.
    """
    recording = match.recording
    if not recording.skin.calibrated:
        return []
    return [
        label
        for label in select_labels(recording.labels)
        if label.gesture != NONE and label.is_within(recording.start, recording.end)
    ]


def find_touches(
    match: LabelMatch, labels: Iterable[Label]
) -> Bool[np.ndarray, "touch"]:
    """Return which touches of a recording are open during some labels."""
    firsts, lasts = match.touches.T
    found = np.zeros(len(firsts), bool)
    for label in labels:
        found |= (firsts < label.end) & (lasts >= label.start)
    return found


def find_shift(
    pairs: Sequence[tuple[LabelMatch, list[Label]]],
) -> float | None:
    """Return the shift by which most labels without a touch begin as one does [s].

    It is the most common distance from the start of such a label to a touch's.
    None where none is common to most of these, or where a label that holds a touch
    would hold none any more.

    Args:
        pairs: labels of recordings with their touches.
    """
    distances = [np.zeros(0)]
    right: list[tuple[LabelMatch, Label]] = []
    count = 0
    for match, labels in pairs:
        empty = []
        for label in labels:
            if find_touches(match, [label]).any():
                right.append((match, label))
            else:
                empty.append(label)
        starts = np.array([label.start for label in empty[:MOST_COMPARED]], np.int64)
        touches = match.touches[:MOST_COMPARED, 0]
        each = (touches[None, :] - starts[:, None]).reshape(-1) / NS_PER_S
        distances.append(each[np.abs(each) <= LONGEST_SHIFT])
        count += len(starts)
    ordered = np.sort(np.concatenate(distances))
    ends = np.searchsorted(ordered, ordered + SPREAD, side="right")
    common = ends - np.arange(len(ordered))
    if common.max(initial=0) <= MAX_WRONG * count:
        return None
    # Of distances that are equally common, the shortest.
    best = np.lexsort((np.abs(ordered), -common))[0]
    shift = float(np.median(ordered[best : ends[best]]))
    moved = round(shift * NS_PER_S)
    for match, label in right:
        later = replace(label, start=label.start + moved, end=label.end + moved)
        if not find_touches(match, [later]).any():
            return None
    return shift
