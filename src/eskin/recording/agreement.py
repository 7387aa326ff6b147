"""How well labels that were found agree with those that are true."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Int

from eskin.recording.labels import NONE, Label
from eskin.units import NS_PER_S

SAME = 0.5


@dataclass
class Agreement:
    """Adds up over recordings; `summary` gives the figures."""

    hits: int = 0
    """Instants touched in both."""
    misses: int = 0
    """Instants touched in truth only."""
    extras: int = 0
    """Instants touched in what was found only."""
    rests: int = 0
    """Instants touched in neither."""
    overlaps: list[float] = field(default_factory=list)
    """Intersection over union of every true event and the one matched to it."""
    onset_errors: list[float] = field(default_factory=list)
    """Onset found minus true onset of every matched event [s]."""
    found_events: int = 0
    """Number of events found."""

    @property
    def instants(self) -> int:
        """Number of instants judged."""
        return self.hits + self.misses + self.extras + self.rests

    def add(
        self,
        truth: Sequence[Label],
        found: Sequence[Label],
        stamps: Int[np.ndarray, "reading"],
    ) -> None:
        """Add one recording."""
        is_true, is_found = touched(truth, stamps), touched(found, stamps)
        self.hits += int((is_true & is_found).sum())
        self.misses += int((is_true & ~is_found).sum())
        self.extras += int((~is_true & is_found).sum())
        self.rests += int((~is_true & ~is_found).sum())
        events = [label for label in truth if label.gesture != NONE]
        matches = match(events, found)
        for event, best in zip(events, matches, strict=True):
            self.overlaps.append(0.0 if best is None else overlap(event, best))
            if best is not None:
                self.onset_errors.append((best.start - event.start) / NS_PER_S)
        self.found_events += len(found)

    def summary(self) -> dict[str, float | int | None]:
        """Figures by name; None where there is nothing to judge.

        Instants are judged as touched or not, since the gesture comes from the range.
        """
        recall = ratio(self.hits, self.hits + self.misses)
        rest_recall = ratio(self.rests, self.rests + self.extras)
        same = sum(value >= SAME for value in self.overlaps)
        return {
            "instants": self.instants,
            "accuracy": ratio(self.hits + self.rests, self.instants),
            "balanced_accuracy": mean([recall, rest_recall]),
            "touched_recall": recall,
            "untouched_recall": rest_recall,
            "events": len(self.overlaps),
            "events_found": self.found_events,
            "event_iou": mean(self.overlaps),
            "event_recall": ratio(same, len(self.overlaps)),
            "event_precision": ratio(same, self.found_events),
            "onset_error_s": median(np.abs(self.onset_errors).tolist()),
            "onset_bias_s": median(self.onset_errors),
        }


def touched(
    labels: Sequence[Label], stamps: Int[np.ndarray, "reading"]
) -> Bool[np.ndarray, "reading"]:
    """Whether any gesture is made at each stamp."""
    inside = np.zeros(len(stamps), dtype=np.bool_)
    for label in labels:
        if label.gesture != NONE:
            inside |= (stamps >= label.start) & (stamps < label.end)
    return inside


def match(truth: Sequence[Label], found: Sequence[Label]) -> list[Label | None]:
    """For each true label the one found that is its, one to one, best overlap first."""
    pairs = [
        (overlap(event, other), i, j)
        for i, event in enumerate(truth)
        for j, other in enumerate(found)
        if event.gesture == other.gesture and overlap(event, other) > 0
    ]
    matches: list[Label | None] = [None] * len(truth)
    taken: set[int] = set()
    for _, i, j in sorted(pairs, key=lambda pair: (-pair[0], pair[1:])):
        if matches[i] is None and j not in taken:
            matches[i] = found[j]
            taken.add(j)
    return matches


def overlap(one: Label, other: Label) -> float:
    """Intersection over union in time."""
    shared = min(one.end, other.end) - max(one.start, other.start)
    if shared <= 0:
        return 0.0
    return shared / (max(one.end, other.end) - min(one.start, other.start))


def ratio(part: int, whole: int) -> float | None:
    """A share, None of nothing."""
    return part / whole if whole else None


def mean(values: Sequence[float | None]) -> float | None:
    """The mean of those that are known."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def median(values: Sequence[float]) -> float | None:
    """The median, None of nothing."""
    return float(np.median(values)) if len(values) else None
