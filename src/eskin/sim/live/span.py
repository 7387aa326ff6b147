"""How the robot moves during one reading, and just before."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.sim.robot.lag import at_steps

Poses = Float[np.ndarray, "step joint"]


@dataclass(frozen=True, eq=False)
class Span:
    """The steps of one reading."""

    first: int
    """First of them since the beginning."""
    steps: int
    """How many there are."""
    past: Poses
    """Joint positions at them, and before them as far as is kept [rad]."""

    @property
    def q(self) -> Poses:
        """Joint positions at the steps [rad]."""
        return self.past[-self.steps :]

    @property
    def is_still(self) -> bool:
        """Whether the robot has stood still as far as is kept."""
        return bool(np.all(self.past == self.past[-1]))

    def at(self, steps: Float[np.ndarray, "step"]) -> Poses:
        """Joint positions at and between steps since the beginning [rad]."""
        oldest = self.first + self.steps - len(self.past)
        return at_steps(self.past, np.maximum(steps - oldest, 0.0))


@final
class Track:
    """The robot's way so far, as far as a hand that follows late needs it."""

    def __init__(self, steps: int, kept: int) -> None:
        """Begin before the first reading.

        Args:
            steps: of a reading.
            kept: steps before a reading that are kept.
        """
        self.steps, self.kept = steps, kept
        self.past: Poses | None = None
        self.next = 0

    def push(self, q: Float[np.ndarray, "joint"]) -> Span:
        """Move evenly to joint positions at the end of the next reading [rad]."""
        last = q if self.past is None else self.past[-1]
        share = np.arange(1, self.steps + 1)[:, None] / self.steps
        # At rest the very same numbers: nothing is computed anew then.
        way = (
            last + share * (q - last)
            if np.any(q != last)
            else np.tile(q, (len(share), 1))
        )
        before = way[:0] if self.past is None else self.past
        self.past = np.concatenate([before, way])[-self.kept - self.steps :]
        span = Span(self.next, self.steps, self.past)
        self.next += self.steps
        return span
