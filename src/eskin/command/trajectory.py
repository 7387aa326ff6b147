"""SynchronousStream lines between joint positions, run through on a clock that can be slowed."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

TOLERANCE = 1e-9
"""Distance below which two positions are one [rad], and times one [s]."""


@dataclass(frozen=True)
class MotionConfig:
    """How fast an arm goes; the defaults are gentle for a UR5."""

    speed: float = 1.05
    """Of the fastest joint at full speed [rad/s]; a UR5 can do 3.1."""

    acceleration: float = 1.4
    """Of that joint, when it starts and arrives at full speed [rad/s2]."""

    brake_seconds: float = 0.12
    """From full speed to standstill when it is stopped [s]."""

    ramp_seconds: float = 0.6
    """From standstill to full speed when it may go on, or slower [s]."""

    @property
    def max_acceleration(self) -> float:
        """Of any joint, whatever happens [rad/s2]."""
        return self.acceleration + self.speed / self.brake_seconds


@final
class JointSegment:
    """A straight line in joint space, run through with a trapezoid of speed.

    Attributes:
        start: where it begins [rad].
        goal: where it ends [rad].
        length: way of the joint that goes farthest [rad].
        rise: how long that joint speeds up, and slows down [s].
        duration: of the whole line [s].
    """

    def __init__(
        self,
        start: Float[np.ndarray, "joint"],
        goal: Float[np.ndarray, "joint"],
        config: MotionConfig,
    ) -> None:
        """Between two positions [rad]."""
        self.start = start
        self.goal = goal
        self.length = float(np.abs(goal - start).max(initial=0.0))
        self.gain = config.acceleration
        self.rise = min(config.speed / self.gain, math.sqrt(self.length / self.gain))
        peak = self.gain * self.rise
        self.duration = self.rise + self.length / peak if peak > 0 else 0.0
        self.each = (goal - start) / self.length if peak > 0 else np.zeros_like(start)

    def q(self, time: float) -> Float[np.ndarray, "joint"]:
        """Joint positions at a time from its beginning [rad]."""
        left = max(self.duration - time, 0.0)
        if left <= TOLERANCE:
            return self.goal
        if time < self.rise:
            way = self.gain * time**2 / 2
        elif left < self.rise:
            way = self.length - self.gain * left**2 / 2
        else:
            way = self.gain * self.rise * (time - self.rise / 2)
        return self.start + self.each * way

    def velocity(self, time: float) -> Float[np.ndarray, "joint"]:
        """Joint speeds at a time from its beginning [rad/s]."""
        rise = min(time, self.duration - time, self.rise)
        return self.each * (self.gain * max(rise, 0.0))


@final
class Trajectory:
    """Runs through one line after the other on a clock of its own.

    Its clock runs at a share of real time between 0 and 1, the time scale. The scale
    changes at a bounded rate, so stopping and going on is smooth; while it is 0 the
    clock stands. A new goal is taken up once the arm stands.

    Attributes:
        line: that it is on.
        coming: the next goal, while there is one [rad].
        time: of its clock since the line began [s].
        scale: of that time to real time.
    """

    def __init__(
        self, q: Float[np.ndarray, "joint"], config: MotionConfig | None = None
    ) -> None:
        """Stand at joint positions [rad]."""
        self.config = config or MotionConfig()
        self.coming: np.ndarray | None = None
        self.begin(q, q)

    def begin(
        self, start: Float[np.ndarray, "joint"], goal: Float[np.ndarray, "joint"]
    ) -> None:
        """Stand at the beginning of a line [rad]."""
        start, goal = np.array(start, np.float64), np.array(goal, np.float64)
        self.line = JointSegment(start, goal, self.config)
        self.coming = None
        self.time = self.scale = 0.0

    @property
    def goal(self) -> Float[np.ndarray, "joint"]:
        """Where it goes [rad]."""
        return self.line.goal if self.coming is None else self.coming

    @property
    def arrived(self) -> bool:
        """Whether it stands at its goal, with no other to come."""
        return self.coming is None and self.time >= self.line.duration - TOLERANCE

    @property
    def stands(self) -> bool:
        """Whether no joint moves."""
        return self.scale <= 0 or not 0 < self.time < self.line.duration - TOLERANCE

    @property
    def q(self) -> Float[np.ndarray, "joint"]:
        """Joint positions now [rad]."""
        return self.line.q(self.time)

    @property
    def velocity(self) -> Float[np.ndarray, "joint"]:
        """Joint speeds now [rad/s]."""
        return self.line.velocity(self.time) * self.scale

    def go_to(self, goal: Float[np.ndarray, "joint"]) -> None:
        """Go to other joint positions [rad], once it stands."""
        self.coming = np.array(goal, np.float64)

    def stand_at(self, q: Float[np.ndarray, "joint"]) -> None:
        """Be at `q` [rad] and go to the same goal from there.

        Only for an arm that was found standing elsewhere than it was sent.
        """
        self.begin(q, self.goal)

    def advance(self, seconds: float, share: float, urgent: bool = False) -> None:
        """Let time pass.

        Args:
            seconds: how much of it.
            share: the time scale to bring about; 0 stops.
            urgent: whether it is brought about as fast as a stop.
        """
        while seconds > TOLERANCE:
            if self.coming is not None and self.stands:
                self.begin(self.q, self.coming)
            changing = self.coming is not None
            wanted = 0.0 if changing else share
            seconds -= self.step(seconds, wanted, urgent or wanted <= 0)

    def step(self, seconds: float, share: float, urgent: bool) -> float:
        """Let time pass until the time scale is reached, at most; how much did [s]."""
        ramp = self.config.brake_seconds if urgent else self.config.ramp_seconds
        before, gap = self.scale, share - self.scale
        needed = abs(gap) * ramp
        passed = seconds if needed <= TOLERANCE else min(seconds, needed)
        if passed >= needed:
            self.scale = share
        else:
            self.scale += math.copysign(passed / ramp, gap)
        self.time += (before + self.scale) / 2 * passed
        self.time = min(self.time, self.line.duration)
        return passed
