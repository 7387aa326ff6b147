"""Where the robot's joints are while its skin streams."""

from abc import ABC, abstractmethod
from typing import final

import numpy as np
from jaxtyping import Float


class Joints(ABC):
    """Tells the joint positions of a robot at a time."""

    @abstractmethod
    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Joint positions [rad] at a time [ns since the epoch]; the last known."""


@final
class FixedJoints(Joints):
    """A robot that does not move."""

    def __init__(self, q: Float[np.ndarray, "joint"]) -> None:
        """Stay at `q` [rad]."""
        self.q = np.array(q, np.float64)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """The same at all times."""
        return self.q
