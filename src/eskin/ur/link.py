"""What passes between an arm and its robot's controller: the abstract link."""

from abc import ABC, abstractmethod
from dataclasses import dataclass


@dataclass(frozen=True)
class UrOrder:
    """What a controller is to do until it hears more."""

    q: tuple[float, ...] | None
    """Joint positions to be at [rad]; None moves nothing."""

    closed: bool | None
    """Whether the gripper is to be closed; None leaves it as it is."""


@dataclass(frozen=True)
class UrStatus:
    """What a controller says."""

    q: tuple[float, ...]
    """Joint positions [rad]."""

    running: bool
    """Whether the program runs that obeys orders."""

    protective_stop: bool
    """Whether the robot's safety functions have stopped it."""

    emergency_stop: bool
    """Whether somebody has."""

    scaling: float
    """Share of speed that slider and controller allow, 0 to 1."""

    closed: bool
    """Whether the output of the gripper is on."""


class Link(ABC):
    """Reaches one controller; lost, it tries again by itself.

    Attributes:
        why: what was wrong when it was last lost; empty before.
    """

    why: str

    @abstractmethod
    def exchange(self, order: UrOrder) -> UrStatus | None:
        """Give an order; what the robot says, or None where it is not heard.

        Takes no more than a few hundredths of a second, whatever happens.
        """

    @abstractmethod
    def close(self) -> None:
        """Let the robot go; its program ends."""
