"""Which way each touch has gone over the robot."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.robot import Robot
from eskin.touch import Touch, TouchState
from eskin.touch.poses import LivePoses


@final
class Travel:
    """Remembers the direction of travel of every open touch; stateful."""

    def __init__(self, robot: Robot, poses: LivePoses, still: float) -> None:
        """Start without touches.

        Args:
            robot: that the touches are on.
            poses: of its links.
            still: travel below which a touch has no direction [m].
        """
        self.robot = robot
        self.poses = poses
        self.still = still
        self.directions: dict[int, np.ndarray] = {}

    def push(self, state: TouchState) -> None:
        """Follow the touches that are in contact at this reading."""
        for touch in state.touches:
            if touch.last == state.reading.stamp:
                self.directions[touch.id] = self.direction(touch, state.reading.q)

    def direction(
        self, touch: Touch, q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "3"]:
        """Unit vector in the world, zero where the touch stayed in its place."""
        distance = np.linalg.norm(touch.travel)
        if distance < self.still:
            return np.zeros(3)
        R_world_link = self.poses.at(q)[self.robot.link_index(touch.link), :3, :3]
        return R_world_link @ touch.travel / distance

    def of(self, touch: Touch) -> Float[np.ndarray, "3"]:
        """The direction of a touch at its latest contact."""
        return self.directions[touch.id]

    def forget(self, closed: tuple[Touch, ...]) -> None:
        """Drop touches that are over."""
        for touch in closed:
            self.directions.pop(touch.id, None)
