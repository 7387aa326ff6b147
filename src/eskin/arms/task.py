"""This module defines tasks of waypoints, and the arms that execute them."""

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import RLock
from typing import Literal, NoReturn, final

import numpy as np
from jaxtyping import Float

from eskin.arms.trajectory import MotionConfig, Trajectory
from eskin.command.arm import Arm, ArmState, Grip
from eskin.errors import ArmError, JogError
from eskin.reasons import Reason
from eskin.robot import DampedLeastSquaresIK, load_robot

Purpose = Literal["take", "bring"]

GRIP_SECONDS = 0.6
"""Time in which a gripper opens or closes [s]."""
MAX_STEP = 0.008
"""Longest time by which a task advances at once [s]."""
JOG_SPEED = 0.3
"""Largest share of full speed of a jog."""


@dataclass(frozen=True)
class Waypoint:
    """A waypoint is a place at which the arm stops on its way."""

    name: str
    """Name, which no other waypoint of the task has."""

    q: tuple[float, ...]
    """Joint positions [rad]."""

    purpose: Purpose | None = None
    """`take`: the gripper closes on a part here; `bring`: it opens and leaves it."""


@dataclass(frozen=True)
class Task:
    """A task is a cycle of waypoints that an arm goes through again and again.

    Raises:
        ValueError: there is no waypoint, two have one name, or positions do not fit.
    """

    name: str
    """Name of the task."""

    robot_name: str
    """Preset or URDF of the robot that it is made for."""

    joint_names: tuple[str, ...]
    """Names of the joints, in the order of `Waypoint.q`."""

    waypoints: tuple[Waypoint, ...]
    """Waypoints in the order in which they are visited; the arm starts at the first."""

    part: str = "part"
    """The thing that is carried."""

    tool: str = "tool0"
    """Link that a jog moves."""

    min_height: float = 0.1
    """Least height of that link over the robot's base to which a jog goes [m]."""

    def __post_init__(self) -> None:
        """Refuse waypoints that do not make a cycle of this robot."""
        names = [waypoint.name for waypoint in self.waypoints]
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(
                f"task '{self.name}' has waypoints {', '.join(names) or 'none'}; "
                "allowed are two or more, each name once"
            )
        for waypoint in self.waypoints:
            if len(waypoint.q) != len(self.joint_names):
                raise ValueError(
                    f"waypoint '{waypoint.name}' has {len(waypoint.q)} positions; "
                    f"allowed are {len(self.joint_names)}, one a joint"
                )


UR5_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
OVER_RACK = (-1.529, -1.560, 1.693, -1.703, -1.571, 0.0)
OVER_FRAME = (0.487, -1.517, 1.597, -1.651, -1.571, 0.0)
FRAME_TASK = Task(
    name="frame assembly",
    robot_name="ur5",
    joint_names=UR5_JOINTS,
    waypoints=(
        Waypoint("over the rack", OVER_RACK),
        Waypoint("rack", (-1.529, -1.399, 2.012, -2.184, -1.571, 0.0), "take"),
        Waypoint("lift", OVER_RACK),
        Waypoint("over the frame", OVER_FRAME),
        Waypoint("frame", (0.487, -1.384, 1.932, -2.119, -1.571, 0.0), "bring"),
        Waypoint("up from the frame", OVER_FRAME),
    ),
    part="frame part",
)
"""Task with a rack to the right of the arm, and a frame and its worker in front and to
the left; the tool points down all the way [rad]."""


@final
class TaskExecutor:
    """A task executor runs a task on a trajectory; it has neither clock nor thread.

    Attributes:
        task: the task that it runs.
        trajectory: the motion of the joints.
        index: index of the waypoint that it goes to.
        paused: whether a person asked it to pause.
        pause_count: how often it was asked to pause.
        hold_reason: why it was stopped without being asked; None where it was not.
        speed: commanded share of full speed.
        speed_limit: share of full speed that it does not exceed for now.
        gripper: state of the gripper; while it moves, the state before.
        gripping: state that the gripper moves to; None where it does not move.
        carrying: whether a part is in the gripper.
        delivered: number of delivered parts.
        jogging: whether it makes a step while it is paused.
    """

    def __init__(
        self,
        task: Task,
        q: Float[np.ndarray, "joint"] | None = None,
        motion: MotionConfig | None = None,
    ) -> None:
        """Stand at `q` [rad], or at the first waypoint; go to that waypoint first."""
        start = np.array(task.waypoints[0].q, np.float64)
        self.task = task
        self.trajectory = Trajectory(start if q is None else q, motion)
        self.index = 0
        self.paused = False
        self.pause_count = 0
        self.hold_reason: Reason | None = None
        self.speed = self.speed_limit = 1.0
        self.gripper: Grip = "open"
        self.gripping: Grip | None = None
        self.grip_left = 0.0
        self.carrying = False
        self.delivered = 0
        self.jogging = False
        self.ik = DampedLeastSquaresIK(load_robot(task.robot_name), task.tool)
        self.trajectory.go_to(start)

    @property
    def waypoint(self) -> Waypoint:
        """Return the waypoint that it goes to."""
        return self.task.waypoints[self.index]

    @property
    def stopped(self) -> bool:
        """Return whether it is paused or held."""
        return self.paused or self.hold_reason is not None

    def pause(self) -> None:
        """Stop, because a person asked for it."""
        self.paused = True
        self.pause_count = self.pause_count + 1
        self.end_jog()

    def resume(self) -> None:
        """End a pause."""
        self.paused = False
        self.end_jog()

    def hold(self, reason: Reason) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""
        self.hold_reason = self.hold_reason or reason
        self.end_jog()

    def release(self) -> None:
        """End a hold."""
        self.hold_reason = None

    def skip(self, count: int) -> None:
        """Go to the waypoint that comes a number after this one, or before."""
        self.index = (self.index + count) % len(self.task.waypoints)
        self.jogging = False
        self.trajectory.go_to(np.array(self.waypoint.q, np.float64))

    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Move the tool by a step [m] while paused, and stay paused.

        Raises:
            JogError: it is not paused, or held, or moves, or does not reach so far.
        """
        refusal = self.find_jog_refusal()
        if refusal is not None:
            raise JogError(
                f"no jog: {refusal}; allowed is one on an arm that is paused and "
                "stands; pause it, or wait"
            )
        q = self.ik.solve_step(self.trajectory.q, step_world)
        if q is None or self.ik.poses(q[None])[0, 2, 3] < self.task.min_height:
            raise JogError(
                f"no jog: {np.round(step_world, 3).tolist()} m further is out of reach "
                f"or below {self.task.min_height:g} m; allowed is where the arm gets "
                "to without a large turn; jog another way"
            )
        self.trajectory.go_to(q)
        self.jogging = True

    def find_jog_refusal(self) -> str | None:
        """Return why it must not jog now, or None where it may."""
        if self.hold_reason is not None:
            return f"the arm is held: {self.hold_reason.what}"
        if not self.paused:
            return "the arm is not paused"
        at_rest = self.trajectory.stopped and not self.jogging
        if not at_rest or self.gripping is not None:
            return "the arm or its gripper moves"
        return None

    def end_jog(self) -> None:
        """End a jog, if there is one; the task goes on from where the arm is."""
        if self.jogging:
            self.jogging = False
            self.trajectory.go_to(np.array(self.waypoint.q, np.float64))

    def move_gripper(self, grip: Grip) -> None:
        """Start to open or close the gripper."""
        if self.gripping != grip and (self.gripping or self.gripper) != grip:
            self.gripping = grip
            self.grip_left = GRIP_SECONDS

    def set_speed(self, share: float) -> None:
        """Go at a share of full speed.

        Raises:
            ValueError: the share is not above 0 and at most 1.
        """
        if not 0 < share <= 1:
            raise ValueError(
                f"speed is {share}; allowed is above 0 and at most 1, a share of full "
                "speed; correct it, or pause to stop"
            )
        self.speed = float(share)

    def limit_speed(self, share: float) -> None:
        """Go at no more than a share of full speed until told otherwise.

        Raises:
            ValueError: the share is not between 0 and 1.
        """
        if not 0 <= share <= 1:
            raise ValueError(
                f"speed limit is {share}; allowed is 0 to 1, a share of full speed"
            )
        self.speed_limit = float(share)

    def advance(self, seconds: float, scaling: float = 1.0) -> None:
        """Advance by a time.

        Args:
            seconds: the time that passes [s].
            scaling: share of its speed that the robot allows, 0 to 1: the clock of the
                trajectory runs no faster.
        """
        while seconds > 0:
            passed = min(seconds, MAX_STEP)
            seconds -= passed
            self.step(passed, scaling)

    def step(self, seconds: float, scaling: float) -> None:
        """Advance by a short time [s]."""
        if self.gripping is not None and self.hold_reason is None:
            self.grip_left -= seconds
            if self.grip_left <= 0:
                self.finish_grip(self.gripping)
        suspended = self.speed_limit <= 0 or (self.stopped and not self.jogging)
        suspended |= self.gripping is not None
        speed = min(self.speed, self.speed_limit, JOG_SPEED if self.jogging else 1.0)
        share = 0.0 if suspended else speed * scaling
        limited = self.speed_limit < 1 and share < self.trajectory.scale
        self.trajectory.advance(seconds, share, urgent=scaling < 1 or limited)
        if self.trajectory.arrived and self.jogging:
            self.end_jog()
        elif self.trajectory.arrived and not suspended:
            self.handle_arrival()

    def finish_grip(self, grip: Grip) -> None:
        """Set the gripper to open or closed, and update the part in it."""
        arrived = self.trajectory.arrived
        if grip == "open":
            delivering = arrived and self.waypoint.purpose == "bring"
            self.delivered += self.carrying and delivering
            self.carrying = False
        else:
            self.carrying = arrived and self.waypoint.purpose == "take"
        self.gripper = grip
        self.gripping = None

    def handle_arrival(self) -> None:
        """Do the action of this waypoint, then go on."""
        purpose = self.waypoint.purpose
        closed = self.gripper == "closed"
        if purpose == "take" and not self.carrying:
            self.move_gripper("open" if closed else "closed")
        elif purpose == "bring" and closed:
            self.move_gripper("open")
        else:
            self.skip(1)

    def state(
        self, stamp: int, protective_stop: bool = False, connected: bool = True
    ) -> ArmState:
        """Return the state at a time [ns since the epoch]."""
        return ArmState(
            stamp=stamp,
            q=self.trajectory.q,
            moving=not self.trajectory.stopped,
            paused=self.paused,
            hold_reason=self.hold_reason,
            speed=self.speed,
            gripper=self.gripper,
            gripping=self.gripping,
            target=self.waypoint.name,
            protective_stop=protective_stop,
            connected=connected,
            carrying=self.carrying,
            delivered=self.delivered,
            jogging=self.jogging,
            speed_limit=self.speed_limit,
            pause_count=self.pause_count,
        )


def refuse_release(problem: Reason) -> NoReturn:
    """Refuse to end a hold while there is still a reason for it.

    Raises:
        ArmError: always.
    """
    raise ArmError(
        f"the arm stays held: {problem.what}; allowed is to go on once that is over; "
        f"{problem.remedy}, then release the arm again"
    )


class TaskArm(Arm):
    """A task arm passes its commands on to a task executor, one at a time.

    Attributes:
        executor: runs the task.
        lock: held whenever the executor is used.
    """

    executor: TaskExecutor
    lock: RLock

    @abstractmethod
    def catch_up(self) -> None:
        """Advance the task to the present, where nothing else does."""

    @contextmanager
    def present_executor(self) -> Iterator[TaskExecutor]:
        """Lock the executor, advanced to the present."""
        with self.lock:
            self.catch_up()
            yield self.executor

    def pause(self) -> None:
        """Stop, because a person asked for it."""
        with self.present_executor() as executor:
            executor.pause()

    def resume(self) -> None:
        """End a pause: speed up from the present position."""
        with self.present_executor() as executor:
            executor.resume()

    def hold(self, reason: Reason) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""
        with self.present_executor() as executor:
            executor.hold(reason)

    def next_waypoint(self) -> None:
        """Go to the next waypoint from the present position."""
        with self.present_executor() as executor:
            executor.skip(1)

    def previous_waypoint(self) -> None:
        """Go back to the waypoint before, then on as the task says."""
        with self.present_executor() as executor:
            executor.skip(-1)

    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Move the tool by a step [m] while paused, keep its rotation, stay paused."""
        with self.present_executor() as executor:
            executor.jog(step_world)

    def open_gripper(self) -> None:
        """Open the gripper; the arm is suspended meanwhile."""
        with self.present_executor() as executor:
            executor.move_gripper("open")

    def close_gripper(self) -> None:
        """Close the gripper; the arm is suspended meanwhile."""
        with self.present_executor() as executor:
            executor.move_gripper("closed")

    def set_speed(self, share: float) -> None:
        """Go at a share of full speed from now on."""
        with self.present_executor() as executor:
            executor.set_speed(share)

    def limit_speed(self, share: float) -> None:
        """Go at no more than a share of full speed until told otherwise."""
        with self.present_executor() as executor:
            executor.limit_speed(share)
