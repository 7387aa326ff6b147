"""This module defines the abstract arm, which runs a task and takes commands."""

import logging
from abc import abstractmethod
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.command.reasons import Problem
from eskin.drivers import JointSource
from eskin.errors import ArmError, JointsError
from eskin.progress import Closing
from eskin.reasons import Reason
from eskin.robot import Robot

logger = logging.getLogger(__name__)
Grip = Literal["open", "closed"]


@dataclass(frozen=True, eq=False)
class ArmState:
    """The state of an arm describes what it does at one instant."""

    stamp: int
    """Time of the state [ns since the epoch]."""

    q: Float[np.ndarray, "joint"]
    """Joint positions [rad]."""

    moving: bool
    """Whether a joint moves."""

    paused: bool
    """Whether a person asked it to pause."""

    hold_reason: Reason | None
    """Why it was stopped without being asked; None where it was not."""

    speed: float
    """Commanded share of full speed, above 0, at most 1."""

    gripper: Grip
    """State of the gripper; while it moves, the state before."""

    target: str
    """Name of the waypoint that it goes to."""

    protective_stop: bool
    """Whether the robot's own safety functions have stopped it."""

    connected: bool
    """Whether the robot answers."""

    running: bool = True
    """Whether the robot's own program, which executes commands, runs."""

    carrying: bool = False
    """Whether it has a part in its gripper, as far as it knows."""

    delivered: int = 0
    """Number of parts that it has delivered."""

    jogging: bool = False
    """Whether it makes a step while it is paused."""

    speed_limit: float = 1.0
    """Share of full speed that the arm does not exceed for now, 0 to 1."""

    gripping: Grip | None = None
    """State that the gripper moves to; None where it does not move."""

    pause_count: int = 0
    """How often it was asked to pause so far, paused already or not."""

    @property
    def stopped(self) -> bool:
        """Return whether it is paused, held or in protective stop."""
        return self.paused or self.hold_reason is not None or self.protective_stop

    @property
    def problem(self) -> Reason | None:
        """Why it obeys no touch, not even to stop; None where it obeys."""
        if not self.connected:
            return Problem.NOT_CONNECTED.reason()
        if self.protective_stop:
            return Problem.PROTECTIVE_STOP.reason()
        return None if self.running else Problem.PROGRAM_ENDED.reason()


class Arm(JointSource, Closing):
    """An arm goes from waypoint to waypoint of its task until it is told otherwise.

    All methods may be called from any thread. A pause and a hold stop the arm alike;
    both must be over for it to go on. Only `resume` ends a pause, and only `release`
    ends a hold.

    Attributes:
        name: name of the robot, a preset or URDF.
        joint_names: names of the joints, in the order of `q`.
    """

    name: str
    joint_names: tuple[str, ...]

    @abstractmethod
    def state(self) -> ArmState:
        """Return the present state."""

    @abstractmethod
    def pause(self) -> None:
        """Stop, because a person asked for it."""

    @abstractmethod
    def resume(self) -> None:
        """End a pause: speed up from the present position."""

    @abstractmethod
    def hold(self, reason: Reason) -> None:
        """Stop, though nobody asked for it; the first reason is kept.

        A program that has a reason of its own gives `Problem.TOLD.reason(text="...")`.
        """

    @abstractmethod
    def release(self) -> None:
        """End a hold.

        Raises:
            ArmError: the reason for it is still there.
        """

    @abstractmethod
    def next_waypoint(self) -> None:
        """Go to the next waypoint from the present position."""

    @abstractmethod
    def previous_waypoint(self) -> None:
        """Go back to the waypoint before, then on as the task says."""

    @abstractmethod
    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Move the tool by a step [m] while paused, keep its rotation, stay paused.

        Whatever stops the arm, and another pause, ends the step.

        Raises:
            JogError: it is not paused, or held, or moves, or does not reach so far.
        """

    @abstractmethod
    def open_gripper(self) -> None:
        """Open the gripper; the arm is suspended meanwhile."""

    @abstractmethod
    def close_gripper(self) -> None:
        """Close the gripper; the arm is suspended meanwhile."""

    @abstractmethod
    def set_speed(self, share: float) -> None:
        """Go at a share of full speed from now on.

        Raises:
            ValueError: the share is not above 0 and at most 1.
        """

    @abstractmethod
    def limit_speed(self, share: float) -> None:
        """Go at no more than a share of full speed until told otherwise.

        The commanded speed stays as it is: a limit of 1 gives it back. With 0 the arm
        is suspended, without being paused or held.

        Raises:
            ValueError: the share is not between 0 and 1.
        """

    def show_question(self, shown: bool) -> None:
        """Show whether a question of the policy is open, as by a light.

        It returns at once. An arm that has nothing to show it by does nothing.

        Args:
            shown: whether a question is open.
        """


@final
class ArmJoints(JointSource):
    """Provides the joint positions of a robot that holds an arm, matched by name.

    The names in the robot may all have one prefix. Its other joints, such as those of a
    gripper, stand at 0 or at the limit that is nearest, of which a warning tells.
    """

    def __init__(self, arm: Arm, robot: Robot) -> None:
        """Match the joints of an arm with the joints of a robot.

        Raises:
            ArmError: The names do not tell which joints are the arm's.
        """
        self.arm = arm
        names = robot.joint_names
        own = arm.joint_names
        prefixes = [n.removesuffix(own[0]) for n in names if n.endswith(own[0])]
        found = [p for p in prefixes if {p + name for name in own} <= set(names)]
        prefix = found[0] if len(found) == 1 else ""
        others = [n for n in names if n.removeprefix(prefix) not in own]
        if others and prefix not in found:
            raise ArmError(
                f"robot '{robot.name}' has joints {', '.join(names)}, and its arm has "
                f"{', '.join(own)}; allowed are all of these names, once, with or "
                "without one prefix, and others beside; rename them in the URDF"
            )
        if others:
            logger.warning(
                "joints of '%s' that the arm does not know stand at 0 or their limit: "
                "%s",
                robot.name,
                ", ".join(others),
            )
        self.rest = np.clip(np.zeros(len(names)), robot.lower, robot.upper)
        matched = [name for name in names if name not in others]
        self.places = [names.index(name) for name in matched]
        self.sources = [own.index(name.removeprefix(prefix)) for name in matched]

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions of the robot at a time [rad].

        Raises:
            JointsError: the arm's positions are not known at that time.
        """
        try:
            return self.place(self.arm.q_at(stamp))
        except JointsError as error:
            raise JointsError(str(error), self.place(error.q)) from error

    def place(self, q: Float[np.ndarray, "own"]) -> Float[np.ndarray, "joint"]:
        """Return the positions of the robot's joints by the arm's positions [rad]."""
        placed = self.rest.copy()
        placed[self.places] = q[self.sources]
        return placed
