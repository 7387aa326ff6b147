"""Detections beside labels."""

from collections.abc import Sequence
from dataclasses import dataclass

from eskin.recording import NONE, DetectionRecord, Label

LATE = 1_000_000_000
"""How long after its end a touch may still be spoken of [ns]."""


@dataclass(frozen=True)
class Pair:
    """A label and what was said of it; one of them may lack the other."""

    label: Label | None
    """What was done; None where something was said of nothing."""

    detection: DetectionRecord | None
    """What was said; None where nothing was."""

    @property
    def is_right(self) -> bool:
        """Whether the gesture that was made was said."""
        if self.label is None or self.detection is None:
            return False
        return self.label.gesture == self.detection.gesture


def compare(
    labels: Sequence[Label], detections: Sequence[DetectionRecord]
) -> tuple[Pair, ...]:
    """Pair labels with detections one to one, by time.

    A detection belongs to a label if it was said between the label's start and one
    second after its end; one of the same gesture is preferred. `none` counts on
    neither side.

    Args:
        labels: what was done.
        detections: what was said.
    """
    left = [found for found in detections if found.gesture != NONE]
    pairs = []
    for label in sorted(labels):
        if label.gesture == NONE:
            continue
        heard = [x for x in left if label.start <= x.stamp < label.end + LATE]
        best = min(
            heard, key=lambda x: (x.gesture != label.gesture, x.stamp), default=None
        )
        if best is not None:
            left.remove(best)
        pairs.append(Pair(label, best))
    pairs += [Pair(None, found) for found in left]
    return tuple(sorted(pairs, key=time_of))


def time_of(pair: Pair) -> int:
    """When it happened [ns since the epoch]."""
    if pair.label is not None:
        return pair.label.start
    return 0 if pair.detection is None else pair.detection.onset
