"""Which way each touch has gone over the robot."""

from collections.abc import Iterable
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.touch import TouchState
from eskin.touch.poses import LivePoses
from eskin.touch.records import TouchRow


@final
class Travel:
    """Remembers every open touch as it was at its latest contact; stateful.

    Few touches are ever asked about: a direction is worked out when it is.
    """

    def __init__(self, poses: LivePoses, still: float) -> None:
        """Start without touches.

        Args:
            poses: of the links of the robot that the touches are on.
            still: travel below which a touch has no direction [m].
        """
        self.poses = poses
        self.still = still
        self.felt: dict[int, tuple[TouchRow, np.ndarray]] = {}

    def push(self, state: TouchState) -> None:
        """Follow the touches that are in contact at this reading."""
        for touch in state.open_rows:
            if touch.last == state.reading.stamp:
                self.felt[touch.id] = touch, self.poses.at(state.reading.q)

    def of(self, touch: int) -> Float[np.ndarray, "3"]:
        """The direction of the touch of that id at its latest contact.

        A unit vector in the world, zero where the touch stayed in its place.
        """
        then, T_world_link = self.felt[touch]
        travel = then.latest - then.start
        distance = np.linalg.norm(travel)
        if distance < self.still:
            return np.zeros(3)
        return T_world_link[then.link, :3, :3] @ travel / distance

    def forget(self, closed: Iterable[int]) -> None:
        """Drop the touches of these ids, which are over."""
        for touch in closed:
            self.felt.pop(touch, None)
