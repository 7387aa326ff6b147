"""How an arm goes about its task, and what stops it; without clock, thread or robot."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.arm import ArmState, Grip
from eskin.command.task import Task, Waypoint
from eskin.command.trajectory import MotionConfig, Trajectory

GRIP_SECONDS = 0.6
"""How long a gripper takes to open or close [s]."""
STEP = 0.008
"""Longest time let pass at once [s]."""


@final
class Routine:
    """Runs a task on a trajectory; says where the arm is to be after any time.

    Attributes:
        task: what is done.
        trajectory: the motion.
        place: of the waypoint that it goes to.
        paused: whether a person asked it to pause.
        holding: why it was stopped without being asked; None where it was not.
        speed: share of full speed.
        gripper: what it is, or was before it began to move.
        carrying: whether there is a part in it.
        delivered: parts that were brought.
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
        self.paused = False
        self.holding: str | None = None
        self.speed = 1.0
        self.gripper: Grip = "open"
        self.gripping: Grip | None = None
        self.grip_left = 0.0
        self.carrying = False
        self.delivered = 0
        self.trajectory.go_to(begin)

    @property
    def waypoint(self) -> Waypoint:
        """Where it goes."""
        return self.task.waypoints[self.place]

    def pause(self) -> None:
        """Stop, because a person wants it."""
        self.paused = True

    def resume(self) -> None:
        """End a pause."""
        self.paused = False

    def hold(self, why: str) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""
        self.holding = self.holding or why

    def release(self) -> None:
        """End a hold."""
        self.holding = None

    def next_waypoint(self) -> None:
        """Go to the next waypoint from where it is."""
        self.go(1)

    def previous_waypoint(self) -> None:
        """Go back to the waypoint before."""
        self.go(-1)

    def go(self, steps: int) -> None:
        """Go to the waypoint some steps on."""
        self.place = self.task.after(self.place, steps)
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
        return self.paused or self.holding is not None

    def advance(self, seconds: float, scaling: float = 1.0) -> None:
        """Let time pass.

        Args:
            seconds: how much.
            scaling: share of its speed that the robot allows, 0 to 1: the clock of the
                trajectory runs no faster.
        """
        while seconds > 0:
            passed = min(seconds, STEP)
            seconds -= passed
            self.step(passed, scaling)

    def step(self, seconds: float, scaling: float) -> None:
        """Let a short time pass."""
        if self.gripping is not None and self.holding is None:
            self.grip_left -= seconds
            if self.grip_left <= 0:
                self.gripped(self.gripping)
        still = self.stopped or self.gripping is not None
        share = 0.0 if still else self.speed * scaling
        self.trajectory.advance(seconds, share, urgent=scaling < 1)
        if self.trajectory.arrived and not still:
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
            holding=self.holding,
            speed=self.speed,
            gripper=self.gripper,
            target=self.waypoint.name,
            protective_stop=protective_stop,
            connected=connected,
            carrying=self.carrying,
            delivered=self.delivered,
        )
