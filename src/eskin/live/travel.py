"""Which way each touch has gone over the robot."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.robot import Robot
from eskin.touch import Touch, TouchState
from eskin.touch.poses import LivePoses


@final
class Travel:
    """Remembers every open touch as it was at its latest contact; stateful.

    Few touches are ever asked about: a direction is worked out when it is.
    """

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
        self.felt: dict[int, tuple[Touch, np.ndarray]] = {}

    def push(self, state: TouchState) -> None:
        """Follow the touches that are in contact at this reading."""
        for touch in state.touches:
            if touch.last == state.reading.stamp:
                self.felt[touch.id] = touch, self.poses.at(state.reading.q)

    def of(self, touch: Touch) -> Float[np.ndarray, "3"]:
        """The direction of a touch at its latest contact.

        A unit vector in the world, zero where the touch stayed in its place.
        """
        then, T_world_link = self.felt[touch.id]
        distance = np.linalg.norm(then.travel)
        if distance < self.still:
            return np.zeros(3)
        R_world_link = T_world_link[self.robot.link_index(then.link), :3, :3]
        return R_world_link @ then.travel / distance

    def forget(self, closed: tuple[Touch, ...]) -> None:
        """Drop touches that are over."""
        for touch in closed:
            self.felt.pop(touch.id, None)
