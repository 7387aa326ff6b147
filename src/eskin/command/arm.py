"""The abstract arm, which works on a task and takes commands."""

from abc import abstractmethod
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.closing import Closing
from eskin.drivers.joints import Joints

Grip = Literal["open", "closed"]


@dataclass(frozen=True, eq=False)
class ArmState:
    """What an arm does at one instant."""

    stamp: int
    """When [ns since the epoch]."""

    q: Float[np.ndarray, "joint"]
    """Joint positions [rad]."""

    moving: bool
    """Whether a joint moves."""

    paused: bool
    """Whether a person asked it to pause."""

    holding: str | None
    """Why it was stopped without being asked; None where it was not."""

    speed: float
    """Share of full speed that it goes at when it goes, above 0, at most 1."""

    gripper: Grip
    """What the gripper is, or was before it began to move."""

    target: str
    """Name of the waypoint that it goes to."""

    protective_stop: bool
    """Whether the robot's own safety functions have stopped it."""

    connected: bool
    """Whether the robot is heard."""

    carrying: bool = False
    """Whether it has a part in its gripper, as far as it knows."""

    delivered: int = 0
    """Parts that it has brought to where they belong."""

    jogging: bool = False
    """Whether it makes a step while it is paused."""

    pauses: int = 0
    """How often it was asked to pause so far, paused already or not."""

    @property
    def stopped(self) -> bool:
        """Whether it is paused, held or in protective stop."""
        return self.paused or self.holding is not None or self.protective_stop


class Arm(Joints, Closing):
    """Goes from waypoint to waypoint of its task until it is told otherwise.

    All of it may be called from any thread. A pause and a hold stop it alike; both must
    be over for it to go on. What is over is only ended by `resume` and `release`.

    Attributes:
        name: of the robot, a preset or URDF.
        joint_names: in the order of `q`.
    """

    name: str
    joint_names: tuple[str, ...]

    @abstractmethod
    def state(self) -> ArmState:
        """What it does now."""

    @abstractmethod
    def pause(self) -> None:
        """Stop, because a person wants it."""

    @abstractmethod
    def resume(self) -> None:
        """End a pause: speed up from where it stands."""

    @abstractmethod
    def hold(self, why: str) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""

    @abstractmethod
    def release(self) -> None:
        """End a hold.

        Raises:
            ArmError: the reason for it is still there.
        """

    @abstractmethod
    def next_waypoint(self) -> None:
        """Go to the next waypoint from where it is."""

    @abstractmethod
    def previous_waypoint(self) -> None:
        """Go back to the waypoint before, then on as the task says."""

    @abstractmethod
    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Move the tool a step [m] while paused, turned as it is, and stay paused.

        Whatever stops the arm, and another pause, ends the step.

        Raises:
            JogError: it is not paused, or held, or moves, or does not reach so far.
        """

    @abstractmethod
    def open_gripper(self) -> None:
        """Open the gripper; the arm stands meanwhile."""

    @abstractmethod
    def close_gripper(self) -> None:
        """Close the gripper; the arm stands meanwhile."""

    @abstractmethod
    def set_speed(self, share: float) -> None:
        """Go at a share of full speed from now on.

        Raises:
            ValueError: the share is not above 0 and at most 1.
        """


@final
class JointHistory:
    """Keeps the latest joint positions; between two, a line."""

    def __init__(
        self, stamp: int, q: Float[np.ndarray, "joint"], size: int = 250
    ) -> None:
        """Begin with positions [rad] at a time; keep `size` of them."""
        self.stamps = deque([stamp], size)
        self.positions = deque([np.array(q, np.float64)], size)

    def add(self, stamp: int, q: Float[np.ndarray, "joint"]) -> None:
        """Positions at a time later than the last [ns since the epoch]."""
        if stamp > self.stamps[-1]:
            self.stamps.append(stamp)
            self.positions.append(np.array(q, np.float64))

    def at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Positions at a time [rad]; outside of what is kept, the nearest."""
        if stamp >= self.stamps[-1]:
            return self.positions[-1]
        place = bisect_right(self.stamps, stamp)
        if place == 0:
            return self.positions[0]
        before, after = self.stamps[place - 1], self.stamps[place]
        q, q_after = self.positions[place - 1], self.positions[place]
        return q + (q_after - q) * ((stamp - before) / (after - before))
