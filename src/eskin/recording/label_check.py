"""This module checks the labels of recordings, which are their ground truth.

A wrong label is taken for the truth: a model learns it, and a score counts it. So
labels that contradict the recording, each other or the touches are refused, and those
that may be right are told. Labels are checked before they are learned or scored, and
before they are written by a person, by automatic labelling or by a conversion, where
no label may lie outside of its recording.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from eskin.errors import RecordingError, warn_once
from eskin.recording.records import (
    NONE,
    Label,
    check_gesture_names,
    describe_label,
    select_labels,
)
from eskin.units import NS_PER_S, format_duration

MAX_LABELS = 20_000
"""Largest number of labels of a recording, which are read into memory."""
MAX_WRONG = 0.5
"""Share of the labels of a recording that is read that may lie outside of it, or beside
its touches."""
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


@dataclass(frozen=True, eq=False)
class LabelSet:
    """A label set holds the labels of a recording, with what they must agree with."""

    path: Path
    """File that they come from, which messages name."""
    labels: tuple[Label, ...]
    """Labels of all sources."""
    start: int
    """Stamp of the first reading [ns since the epoch]."""
    end: int
    """Stamp of the last reading [ns since the epoch]."""
    simulated: bool = False
    """Whether the touches were simulated, so that their gestures are known anyway."""
    touches: Int[np.ndarray, "touch 2"] | None = None
    """Stamps of first and last reading of each touch [ns since the epoch]; None where
    they are not known, or the skin is not calibrated, so that every reading has one."""

    @property
    def known(self) -> bool:
        """Return whether it is known which gestures were made."""
        return self.simulated or bool(self.labels)

    @property
    def best(self) -> tuple[Label, ...]:
        """Return the labels of the best source, as `select_labels` does."""
        return select_labels(self.labels)

    @property
    def inside(self) -> tuple[Label, ...]:
        """Return those of the best source that lie in the recording, which count."""
        return tuple(x for x in self.best if x.is_within(self.start, self.end))

    @property
    def outside(self) -> tuple[Label, ...]:
        """Return those of the best source that lie outside of the recording."""
        return tuple(x for x in self.best if not x.is_within(self.start, self.end))

    @property
    def gestures(self) -> tuple[Label, ...]:
        """Return the labels of gestures, which need a touch; none of an unknown one."""
        if self.touches is None:
            return ()
        return tuple(label for label in self.inside if label.gesture != NONE)

    def find_touches(self, labels: Iterable[Label]) -> Bool[np.ndarray, "touch"]:
        """Return which touches are open during some labels."""
        assert self.touches is not None
        firsts, lasts = self.touches.T
        found = np.zeros(len(firsts), bool)
        for label in labels:
            found |= (firsts < label.end) & (lasts >= label.start)
        return found


def check_labels(
    sets: Sequence[LabelSet], needed: bool = False, written: bool = False
) -> None:
    """Refuse labels that contradict each other, their recordings or their touches.

    Args:
        sets: labels of recordings that are learned, scored or written together.
        needed: whether at least one of them must say which gestures were made.
        written: whether the labels are to be written, so that none may lie outside of
            its recording. In a recording that exists, a few that do are left out, which
            is told.

    Raises:
        RecordingError: naming the recording, and the label with its time, if there are
            no labels where they are needed, or too many, a gesture has a name that no
            model can have, two labels overlap, labels lie outside of a recording, or
            most hold no touch while as many touches have no label.
    """
    if needed:
        check_known(sets)
    names: dict[str, None] = {}
    for each in sets:
        check_count(each)
        check_names(each, names)
        check_overlap(each)
        check_inside(each, written)
    for each in sets:
        check_touches([each])
    check_touches(sets)


def check_known(sets: Sequence[LabelSet]) -> None:
    """Raise if it is known of no recording which gestures were made."""
    if any(each.known for each in sets):
        return
    path = sets[0].path
    who = f"{path} has no labels"
    if len(sets) > 1:
        who = f"none of {len(sets)} recordings, such as {path}, has labels"
    raise RecordingError(
        f"{who}; allowed are recordings with labels; make some with: eskin label {path}"
    )


def check_count(labels: LabelSet) -> None:
    """Raise if there are more labels than a recording may have."""
    count = len(labels.labels)
    if count > MAX_LABELS:
        raise RecordingError(
            f"{labels.path} has {count:,} labels; allowed are {MAX_LABELS:,}; divide "
            "it into sessions"
        )


def check_names(labels: LabelSet, names: dict[str, None]) -> None:
    """Raise if a name cannot stand with those so far, to which it is added."""
    for label in labels.best:
        if label.gesture in names:
            continue
        names[label.gesture] = None
        try:
            check_gesture_names(names)
        except RecordingError as error:
            seconds = (label.start - labels.start) / NS_PER_S
            raise RecordingError(
                f"{labels.path}, label at {seconds:.2f} s: {error}"
            ) from None


def check_overlap(labels: LabelSet) -> None:
    """Raise if two labels overlap."""
    best = labels.best
    for previous, label in zip(best, best[1:], strict=False):
        if label.start < previous.end:
            raise RecordingError(
                f"{labels.path}: labels {describe_label(previous, labels.start)} and "
                f"{describe_label(label, labels.start)} overlap; labels of one source "
                "follow each other; shorten or remove one"
            )


def check_inside(labels: LabelSet, written: bool) -> None:
    """Raise if labels lie outside of the recording; tell a few that are only read."""
    if not labels.outside:
        return
    text = describe_outside(labels)
    if written or len(labels.outside) > MAX_WRONG * len(labels.best):
        raise RecordingError(
            f"{text}; allowed are labels during the recording; correct their clock or "
            "unit (nanoseconds, as the stamps of readings), or remove them"
        )
    warn_once(f"{text}; they are left out")


def describe_outside(labels: LabelSet) -> str:
    """Return how many labels lie outside of a recording, and where, for messages."""
    outside = labels.outside
    distances = [
        max(label.start - labels.end, labels.start - label.end) for label in outside
    ]
    near = format_duration(min(distances) / NS_PER_S)
    far = format_duration(max(distances) / NS_PER_S)
    distance = near if near == far else f"{near} to {far}"
    first = outside[0]
    side = "after its end" if first.start > labels.end else "before its start"
    return (
        f"{labels.path}: {len(outside)} of {len(labels.best)} labels lie outside of "
        f"the recording, {distance} from it; the first is "
        f"{describe_label(first, labels.start)} (stamp {first.start} ns), {side}"
    )


def check_touches(sets: Sequence[LabelSet]) -> None:
    """Raise if labels lie beside the touches, of one recording or of all together.

    These are labels of which most hold no touch, while as many touches have no label.
    Where touches are missing as well, they may have been too faint.
    """
    felt = [each for each in sets if each.touches is not None]
    empty = [
        (each, label)
        for each in felt
        for label in each.gestures
        if not each.find_touches([label]).any()
    ]
    count = sum(len(each.gestures) for each in felt)
    if len(empty) < FEWEST or len(empty) <= MAX_WRONG * count:
        return
    unlabelled = sum(int((~each.find_touches(each.best)).sum()) for each in felt)
    if unlabelled < len(empty):
        return
    shift = find_shift(felt)
    remedy = "correct their times"
    if shift is not None:
        side = "earlier" if shift < 0 else "later"
        remedy = (
            f"the touches are {format_duration(abs(shift))} {side}: shift the labels "
            f"by {shift:+.2f} s"
        )
    labels, first = empty[0]
    raise RecordingError(
        f"{labels.path}: {len(empty)} of {count} labels hold no touch, the first is "
        f"{describe_label(first, labels.start)}, while {unlabelled} touches have no "
        f"label; allowed are labels that hold their touches; {remedy}"
    )


def find_shift(sets: Sequence[LabelSet]) -> float | None:
    """Return the shift by which most labels without a touch begin as one does [s].

    It is the most common distance from the start of such a label to a touch's.
    None where none is common to most of these, or where a label that holds a touch
    would hold none any more.

    Args:
        sets: labels of recordings whose touches are known.
    """
    distances = [np.zeros(0)]
    right: list[tuple[LabelSet, Label]] = []
    count = 0
    for each in sets:
        assert each.touches is not None
        empty = []
        for label in each.gestures:
            if each.find_touches([label]).any():
                right.append((each, label))
            else:
                empty.append(label)
        starts = np.array([label.start for label in empty[:MOST_COMPARED]], np.int64)
        touches = each.touches[:MOST_COMPARED, 0]
        between = (touches[None, :] - starts[:, None]).reshape(-1) / NS_PER_S
        distances.append(between[np.abs(between) <= LONGEST_SHIFT])
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
    for each, label in right:
        later = replace(label, start=label.start + moved, end=label.end + moved)
        if not each.find_touches([later]).any():
            return None
    return shift
