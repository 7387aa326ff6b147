"""A stream with its events and detections compared."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from eskin.learn.events.matching import (
    MatchConfig,
    Matching,
    are_in_time,
    closeness,
    match,
)
from eskin.learn.events.take import NO_GESTURE, Take


@dataclass(frozen=True, eq=False)
class Marked:
    """A stream, and which of its detections are of which of its events."""

    take: Take
    """The stream."""

    matching: Matching
    """Of its events and detections."""

    config: MatchConfig
    """How they were matched."""

    def word(self, event: int) -> int | None:
        """Index of the detection that stands for an event; None where there is none.

        It is its match, or else the nearest that was about it, a gesture if possible.
        """
        if event in self.matching.matched:
            return self.matching.matched[event]
        truth, said = self.take.events[event], self.take.detections
        about = [d for d, blamed in self.matching.blamed.items() if blamed == event]
        return max(
            about,
            key=lambda d: (
                said[d].gesture not in NO_GESTURE,
                closeness(truth, said[d]),
            ),
            default=None,
        )

    def is_mistaken(self, event: int) -> bool:
        """Whether an event that is no gesture was said to be one."""
        word = self.word(event)
        return word is not None and self.take.detections[word].gesture not in NO_GESTURE

    @property
    def gestures(self) -> tuple[int, ...]:
        """Indices of the detections of a gesture."""
        every = enumerate(self.take.detections)
        return tuple(index for index, d in every if d.gesture not in NO_GESTURE)

    @property
    def false(self) -> tuple[int, ...]:
        """Indices of the detections of a gesture that match no event."""
        matched = set(self.matching.matched.values())
        return tuple(index for index in self.gestures if index not in matched)

    @property
    def overlapping(self) -> Bool[np.ndarray, "event"]:
        """Which events overlap another one in time."""
        onsets = np.array([e.onset for e in self.take.events], dtype=np.int64)
        ends = np.array([e.end for e in self.take.events], dtype=np.int64)
        together = (onsets[:, None] <= ends) & (onsets <= ends[:, None])
        return together.sum(axis=1) > 1

    @property
    def said_meanwhile(self) -> Bool[np.ndarray, "detection"]:
        """Which detections were said when one of an overlapping event might be."""
        events, detections = self.take.events, self.take.detections
        timely = are_in_time(events, detections, self.config)
        return np.any(timely[self.overlapping], axis=0, keepdims=True)[0]


def mark(take: Take, config: MatchConfig) -> Marked:
    """Compare what was done with what was said."""
    return Marked(take, match(take.events, take.detections, config), config)
