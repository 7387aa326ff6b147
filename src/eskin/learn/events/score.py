"""What a recogniser is worth on continuous streams."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.learn.events.counting import Delays, LeftAlone, Tally, f1_interval
from eskin.learn.metrics import Reliability, reliability

ACCIDENTS = (
    "bump",
    "lean",
    "resting_hand",
    "brush",
    "cable",
    "self_contact",
    "electrical",
)
"""Kinds of touches that nobody means."""

HOUR = 3600.0
"""[s]"""


@dataclass(frozen=True, eq=False)
class EventScore:
    """What a recogniser is worth on continuous streams."""

    hours: float
    """How long the streams are [h]."""

    per_gesture: dict[str, Tally]
    """Of each gesture of the vocabulary but `none`."""

    per_subject: dict[str, Tally]
    """Of all gestures, of each person's streams."""

    simultaneous: Tally
    """Of events that overlap another one in time, of any gesture, and of what was
    falsely said meanwhile."""

    delays: dict[str, Delays]
    """Of the matched detections of each gesture."""

    unknown: dict[str, LeftAlone]
    """Gestures that are not in the vocabulary, by their name."""

    none: dict[str, LeftAlone]
    """Touches that are no gesture, by their kind."""

    names: tuple[str, ...]
    """Rows and columns of `confusion`: gestures, `none`, `unknown`, `nothing`."""

    confusion: Int[np.ndarray, "true said"]
    """One count an event, and in the last row what else was said."""

    confidence: Float[np.ndarray, "detection"]
    """Of every detection of a gesture."""

    right: Bool[np.ndarray, "detection"]
    """Which of these match an event."""

    @property
    def total(self) -> Tally:
        """Of all gestures."""
        return sum(self.per_gesture.values(), Tally())

    @property
    def f1_interval(self) -> tuple[float, float]:
        """95 % interval of the F1 of all gestures, from drawing people anew."""
        return f1_interval(list(self.per_subject.values()))

    @property
    def false_per_hour(self) -> float:
        """False detections an hour; NaN where there is no time."""
        return self.total.false / self.hours if self.hours else float("nan")

    @property
    def all_delays(self) -> Delays:
        """Of all matched detections."""
        every = self.delays.values()
        return Delays(
            np.concatenate([d.after_end for d in every] or [np.empty(0)]),
            np.concatenate([d.after_onset for d in every] or [np.empty(0)]),
        )

    @property
    def reliability(self) -> Reliability:
        """How sure detections of gestures were, and how often right."""
        return reliability(self.confidence, self.right)

    @property
    def unknown_total(self) -> LeftAlone:
        """Gestures that are not in the vocabulary, all together."""
        return sum(self.unknown.values(), LeftAlone())

    @property
    def accidents(self) -> LeftAlone:
        """Touches that nobody means, all together."""
        kinds = (left for kind, left in self.none.items() if kind in ACCIDENTS)
        return sum(kinds, LeftAlone())
