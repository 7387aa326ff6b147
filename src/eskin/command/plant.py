"""What carries out where a routine says that the joints are to be."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.routine import Routine
from eskin.robot import Wrench

STOP = "protective stop"


class Plant(ABC):
    """The joints of a simulated arm.

    Attributes:
        q: where they are [rad].
        period: time always passes in steps of this length [ns]; in one where None.
        stopped: whether it is in protective stop.
        moving: whether a joint moves, whatever the routine says.
    """

    q: Float[np.ndarray, "joint"]
    period: int | None = None
    stopped: bool = False
    moving: bool = False

    @abstractmethod
    def advance(self, routine: Routine, seconds: float) -> None:
        """Let time pass, for the routine and the joints."""

    @abstractmethod
    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Be pushed so, and not otherwise, until told anew."""

    @abstractmethod
    def unlock(self) -> None:
        """End a protective stop."""


@final
class KinematicPlant(Plant):
    """Joints that are where they are to be, whatever pushes."""

    def __init__(self, q: Float[np.ndarray, "joint"]) -> None:
        """Stand at joint positions [rad]."""
        self.q = q

    def advance(self, routine: Routine, seconds: float) -> None:
        """Let time pass, for the routine and the joints."""
        routine.advance(seconds)
        self.q = routine.trajectory.q

    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Nothing moves them."""

    def unlock(self) -> None:
        """They are never in protective stop."""
