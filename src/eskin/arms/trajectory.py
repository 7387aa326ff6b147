"""This module moves joints along straight lines, on a clock that can be slowed."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

TOLERANCE = 1e-9
"""Distance below which two positions are equal [rad], and times [s]."""


@dataclass(frozen=True)
class MotionConfig:
    """A motion configuration limits an arm's speed; its defaults suit a UR5."""

    speed: float = 1.05
    """Speed of the fastest joint at full speed [rad/s]; a UR5 can do 3.1."""

    acceleration: float = 1.4
    """Acceleration of that joint when it starts and arrives at full speed [rad/s2]."""

    brake_seconds: float = 0.12
    """Time from full speed to standstill when it is stopped [s]."""

    ramp_seconds: float = 0.6
    """Time from standstill to full speed when it may go on, or slower [s]."""

    @property
    def max_acceleration(self) -> float:
        """Largest acceleration of any joint, whatever happens [rad/s2]."""
        return self.acceleration + self.speed / self.brake_seconds


@final
class JointSegment:
    """A joint segment is a straight line in joint space with a trapezoid of speed.

    Attributes:
        start: joint positions at its start [rad].
        goal: joint positions at its end [rad].
        length: distance of the joint that goes farthest [rad].
        acceleration: acceleration of that joint [rad/s2].
        ramp: how long that joint speeds up, and slows down [s].
        duration: duration of the whole segment [s].
        direction: movement of each joint for a unit of `length`.
    """

    def __init__(
        self,
        start: Float[np.ndarray, "joint"],
        goal: Float[np.ndarray, "joint"],
        config: MotionConfig,
    ) -> None:
        """Connect two positions [rad]."""
        self.start = start
        self.goal = goal
        self.length = float(np.abs(goal - start).max(initial=0.0))
        self.acceleration = config.acceleration
        self.ramp = min(
            config.speed / self.acceleration,
            math.sqrt(self.length / self.acceleration),
        )
        peak = self.acceleration * self.ramp
        self.duration = self.ramp + self.length / peak if peak > 0 else 0.0
        rest = np.zeros_like(start)
        self.direction = (goal - start) / self.length if peak > 0 else rest

    def q(self, time: float) -> Float[np.ndarray, "joint"]:
        """Return the joint positions at a time from its start [rad]."""
        left = max(self.duration - time, 0.0)
        if left <= TOLERANCE:
            return self.goal
        if time < self.ramp:
            distance = self.acceleration * time**2 / 2
        elif left < self.ramp:
            distance = self.length - self.acceleration * left**2 / 2
        else:
            distance = self.acceleration * self.ramp * (time - self.ramp / 2)
        return self.start + self.direction * distance

    def velocity(self, time: float) -> Float[np.ndarray, "joint"]:
        """Return the joint velocities at a time from its start [rad/s]."""
        ramped = min(time, self.duration - time, self.ramp)
        return self.direction * (self.acceleration * max(ramped, 0.0))


@final
class Trajectory:
    """A trajectory follows one segment after the other on a clock of its own.

    Its clock runs at a share of real time between 0 and 1, the time scale. The scale
    changes at a bounded rate, so stopping and going on is smooth; while it is 0 the
    clock is stopped. A new goal is taken up once the arm is at rest.

    Attributes:
        segment: the present segment.
        next_goal: the goal after this segment, while there is one [rad].
        time: time of its clock since the segment began [s].
        scale: the time scale.
    """

    def __init__(
        self, q: Float[np.ndarray, "joint"], config: MotionConfig | None = None
    ) -> None:
        """Stand at joint positions [rad]."""
        self.config = config or MotionConfig()
        self.next_goal: np.ndarray | None = None
        self.start_segment(q, q)

    def start_segment(
        self, start: Float[np.ndarray, "joint"], goal: Float[np.ndarray, "joint"]
    ) -> None:
        """Stand at the start of a new segment [rad]."""
        start = np.array(start, np.float64)
        goal = np.array(goal, np.float64)
        self.segment = JointSegment(start, goal, self.config)
        self.next_goal = None
        self.time = self.scale = 0.0

    @property
    def goal(self) -> Float[np.ndarray, "joint"]:
        """Joint positions that it goes to [rad]."""
        return self.segment.goal if self.next_goal is None else self.next_goal

    @property
    def arrived(self) -> bool:
        """Return whether it has stopped at its goal, with no other to come."""
        return self.next_goal is None and self.time >= self.segment.duration - TOLERANCE

    @property
    def stopped(self) -> bool:
        """Return whether no joint moves."""
        within = 0 < self.time < self.segment.duration - TOLERANCE
        return self.scale <= 0 or not within

    @property
    def q(self) -> Float[np.ndarray, "joint"]:
        """Present joint positions [rad]."""
        return self.segment.q(self.time)

    @property
    def velocity(self) -> Float[np.ndarray, "joint"]:
        """Present joint velocities [rad/s]."""
        return self.segment.velocity(self.time) * self.scale

    def go_to(self, goal: Float[np.ndarray, "joint"]) -> None:
        """Go to other joint positions [rad], once it has stopped."""
        self.next_goal = np.array(goal, np.float64)

    def restart_from(self, q: Float[np.ndarray, "joint"]) -> None:
        """Stand at `q` [rad] and go to the same goal from there.

        This is only for an arm that was found standing elsewhere than it was sent.
        """
        self.start_segment(q, self.goal)

    def advance(self, seconds: float, scale: float, urgent: bool = False) -> None:
        """Advance by a time.

        Args:
            seconds: the time that passes [s].
            scale: the time scale to reach; 0 stops.
            urgent: whether it is reached as fast as a stop.
        """
        while seconds > TOLERANCE:
            if self.next_goal is not None and self.stopped:
                self.start_segment(self.q, self.next_goal)
            changing = self.next_goal is not None
            wanted = 0.0 if changing else scale
            seconds -= self.step(seconds, wanted, urgent or wanted <= 0)

    def step(self, seconds: float, scale: float, urgent: bool) -> float:
        """Advance until the time scale is reached, at most; return the time passed."""
        ramp = self.config.brake_seconds if urgent else self.config.ramp_seconds
        before = self.scale
        gap = scale - self.scale
        needed = abs(gap) * ramp
        passed = seconds if needed <= TOLERANCE else min(seconds, needed)
        if passed >= needed:
            self.scale = scale
        else:
            self.scale += math.copysign(passed / ramp, gap)
        self.time += (before + self.scale) / 2 * passed
        self.time = min(self.time, self.segment.duration)
        return passed
