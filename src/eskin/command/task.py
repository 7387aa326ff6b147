"""Tasks of waypoints, and the executor that runs one without clock or thread."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.command.arm import ArmState, Grip
from eskin.command.trajectory import MotionConfig, Trajectory
from eskin.errors import JogError
from eskin.robot import Reach, load_robot

Purpose = Literal["take", "bring"]


@dataclass(frozen=True)
class Waypoint:
    """Where the arm stops on its way."""

    name: str
    """Tells it from the others."""

    q: tuple[float, ...]
    """Joint positions [rad]."""

    purpose: Purpose | None = None
    """`take`: the gripper closes on a part here; `bring`: it opens and leaves it."""


@dataclass(frozen=True)
class Task:
    """Waypoints that an arm goes through again and again.

    Raises:
        ValueError: there is no waypoint, two have one name, or positions do not fit.
    """

    name: str
    """What is done."""

    robot_name: str
    """Preset or URDF that it is for."""

    joint_names: tuple[str, ...]
    """In the order of `Waypoint.q`."""

    waypoints: tuple[Waypoint, ...]
    """In the order in which they are gone to; the arm begins at the first."""

    part: str = "part"
    """What is carried."""

    tool: str = "tool0"
    """Link that a jog moves."""

    lowest: float = 0.1
    """Least height of that link over the robot's base to which a jog goes [m]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be gone through."""
        names = [waypoint.name for waypoint in self.waypoints]
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(
                f"task '{self.name}' has waypoints {', '.join(names) or 'none'}; "
                "allowed are two or more, each name once; name them apart"
            )
        for waypoint in self.waypoints:
            if len(waypoint.q) != len(self.joint_names):
                raise ValueError(
                    f"waypoint '{waypoint.name}' has {len(waypoint.q)} positions; "
                    f"allowed are {len(self.joint_names)}, one a joint; correct it"
                )

    def after(self, place: int, steps: int = 1) -> int:
        """The place of the waypoint some steps on, in a circle."""
        return (place + steps) % len(self.waypoints)


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
        Waypoint("back off", OVER_FRAME),
    ),
    part="frame part",
)
"""A rack to the right of the arm, a frame and its worker in front and to the left; the
tool points down all the way [rad]."""

GRIP_SECONDS = 0.6
"""How long a gripper takes to open or close [s]."""
MAX_STEP = 0.008
"""Longest time let pass at once [s]."""
JOG_SPEED = 0.3
"""Largest share of full speed at which it jogs."""


@final
class TaskExecutor:
    """Runs a task on a trajectory; says where the arm is to be after any time.

    Attributes:
        task: what is done.
        trajectory: the motion.
        place: of the waypoint that it goes to.
        paused: whether a person asked it to pause.
        pause_count: how often one has.
        hold_reason: why it was stopped without being asked; None where it was not.
        speed: share of full speed.
        gripper: what it is, or was before it began to move.
        carrying: whether there is a part in it.
        delivered: parts that were brought.
        jogging: whether it makes a step while it is paused.
    """

    def __init__(
        self,
        task: Task,
        q: Float[np.ndarray, "joint"] | None = None,
        motion: MotionConfig | None = None,
    ) -> None:
        """Stand at `q` [rad], or where the task begins; go there first."""
        begin = np.array(task.waypoints[0].q, np.float64)
        self.task = task
        self.trajectory = Trajectory(begin if q is None else q, motion)
        self.place = 0
        self.paused, self.pause_count = False, 0
        self.hold_reason: str | None = None
        self.speed = 1.0
        self.gripper: Grip = "open"
        self.gripping: Grip | None = None
        self.grip_left = 0.0
        self.carrying = False
        self.delivered = 0
        self.jogging = False
        self.reach = Reach(load_robot(task.robot_name), task.tool)
        self.trajectory.go_to(begin)

    @property
    def waypoint(self) -> Waypoint:
        """Where it goes."""
        return self.task.waypoints[self.place]

    def pause(self) -> None:
        """Stop, because a person wants it."""
        self.paused, self.pause_count = True, self.pause_count + 1
        self.end_jog()

    def resume(self) -> None:
        """End a pause."""
        self.paused = False
        self.end_jog()

    def hold(self, why: str) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""
        self.hold_reason = self.hold_reason or why
        self.end_jog()

    def release(self) -> None:
        """End a hold."""
        self.hold_reason = None

    def next_waypoint(self) -> None:
        """Go to the next waypoint from where it is."""
        self.go(1)

    def previous_waypoint(self) -> None:
        """Go back to the waypoint before."""
        self.go(-1)

    def go(self, steps: int) -> None:
        """Go to the waypoint some steps on."""
        self.place = self.task.after(self.place, steps)
        self.jogging = False
        self.trajectory.go_to(np.array(self.waypoint.q, np.float64))

    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Make a step with the tool while paused [m], and stay paused.

        Raises:
            JogError: it is not paused, or held, or moves, or does not reach so far.
        """
        why = self.find_jog_refusal()
        if why is not None:
            raise JogError(
                f"no jog: {why}; allowed is one on an arm that is paused and stands; "
                "pause it, or wait"
            )
        q = self.reach.stepped(self.trajectory.q, step_world)
        if q is None or self.reach.poses(q[None])[0, 2, 3] < self.task.lowest:
            raise JogError(
                f"no jog: {np.round(step_world, 3).tolist()} m further is out of reach "
                f"or below {self.task.lowest:g} m; allowed is where the arm gets to "
                "without a large turn; jog another way"
            )
        self.trajectory.go_to(q)
        self.jogging = True

    def find_jog_refusal(self) -> str | None:
        """Why it must not jog now; None where it may."""
        if self.hold_reason is not None:
            return f"the arm is held: {self.hold_reason}"
        if not self.paused:
            return "the arm is not paused"
        if not self.trajectory.stands or self.jogging or self.gripping is not None:
            return "the arm or its gripper moves"
        return None

    def end_jog(self) -> None:
        """Go on with the task from where it is, once it may."""
        if self.jogging:
            self.jogging = False
            self.trajectory.go_to(np.array(self.waypoint.q, np.float64))

    def grip(self, grip: Grip) -> None:
        """Open or close the gripper."""
        if self.gripping != grip and (self.gripping or self.gripper) != grip:
            self.gripping, self.grip_left = grip, GRIP_SECONDS

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

    @property
    def stopped(self) -> bool:
        """Whether it is paused or held."""
        return self.paused or self.hold_reason is not None

    def advance(self, seconds: float, scaling: float = 1.0) -> None:
        """Let time pass.

        Args:
            seconds: how much.
            scaling: share of its speed that the robot allows, 0 to 1: the clock of the
                trajectory runs no faster.
        """
        while seconds > 0:
            passed = min(seconds, MAX_STEP)
            seconds -= passed
            self.step(passed, scaling)

    def step(self, seconds: float, scaling: float) -> None:
        """Let a short time pass."""
        if self.gripping is not None and self.hold_reason is None:
            self.grip_left -= seconds
            if self.grip_left <= 0:
                self.gripped(self.gripping)
        still = self.gripping is not None or (self.stopped and not self.jogging)
        speed = min(self.speed, JOG_SPEED) if self.jogging else self.speed
        share = 0.0 if still else speed * scaling
        self.trajectory.advance(seconds, share, urgent=scaling < 1)
        if self.trajectory.arrived and self.jogging:
            self.end_jog()
        elif self.trajectory.arrived and not still:
            self.arrive()

    def gripped(self, grip: Grip) -> None:
        """The gripper has opened or closed."""
        there = self.trajectory.arrived
        if grip == "open":
            brought = there and self.waypoint.purpose == "bring"
            self.delivered += self.carrying and brought
            self.carrying = False
        else:
            self.carrying = there and self.waypoint.purpose == "take"
        self.gripper, self.gripping = grip, None

    def arrive(self) -> None:
        """Do what is done at this waypoint, then go on."""
        purpose, closed = self.waypoint.purpose, self.gripper == "closed"
        if purpose == "take" and not self.carrying:
            self.grip("open" if closed else "closed")
        elif purpose == "bring" and closed:
            self.grip("open")
        else:
            self.go(1)

    def state(
        self, stamp: int, protective_stop: bool = False, connected: bool = True
    ) -> ArmState:
        """What it does now."""
        return ArmState(
            stamp=stamp,
            q=self.trajectory.q,
            moving=not self.trajectory.stands,
            paused=self.paused,
            hold_reason=self.hold_reason,
            speed=self.speed,
            gripper=self.gripper,
            target=self.waypoint.name,
            protective_stop=protective_stop,
            connected=connected,
            carrying=self.carrying,
            delivered=self.delivered,
            jogging=self.jogging,
            pause_count=self.pause_count,
        )
