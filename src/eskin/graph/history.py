"""What a touch has been so far, beyond what its contact graph shows."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.touch import Touch, TouchState

HISTORY = (
    "age",
    "pause",
    "contacts",
    "travel",
    "farthest",
    "impulse",
    "peak force",
)
"""Columns of a history: time since onset [s], since the last contact [s], how often it
made contact, distance from where it began, now and at most [cm], force integrated over
time [N s], greatest force [N]. On a skin that is not calibrated all are zero."""

LIFTED_NS = 60_000_000
"""Shortest time without contact after which contact is made anew [ns]; there must be
a reading that tells of it."""

CM_PER_M = 100.0
NOTHING = np.zeros(len(HISTORY))


@dataclass
class Course:
    """What is remembered of one open touch."""

    last: int
    contacts: int = 1
    farthest: float = 0.0


@final
class Histories:
    """The histories of all open touches; stateful."""

    def __init__(self) -> None:
        """Start without touches."""
        self.courses: dict[int, Course] = {}
        self.before = 0

    def push(self, state: TouchState) -> dict[int, Float[np.ndarray, "column"]]:
        """The history of each open touch at the next reading, by its id."""
        self.courses = {
            touch.id: self.courses.get(touch.id) or Course(touch.last)
            for touch in state.touches
        }
        stamp, before = state.reading.stamp, self.before
        self.before = stamp
        return {
            touch.id: history_of(touch, self.courses[touch.id], stamp, before)
            for touch in state.touches
        }


def history_of(
    touch: Touch, course: Course, stamp: int, before: int
) -> Float[np.ndarray, "column"]:
    """The history of one touch, whose course is brought up to date.

    Args:
        touch: as it is at this reading.
        course: what is remembered of it.
        stamp: of this reading [ns since the epoch].
        before: of the reading before.
    """
    if touch.last - course.last > LIFTED_NS and course.last < before:
        course.contacts += 1
    course.last = touch.last
    travel = float(np.linalg.norm(touch.travel)) * CM_PER_M
    course.farthest = max(course.farthest, travel)
    return np.array(
        [
            (stamp - touch.onset) * 1e-9,
            (stamp - touch.last) * 1e-9,
            course.contacts,
            travel,
            course.farthest,
            touch.impulse,
            touch.peak_force,
        ]
    )
