"""Which way each touch has gone over the robot."""

from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.touch import Touch, TouchState
from eskin.touch.pipeline import LivePoses
from eskin.touch.records import TouchBrief


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
        self.felt: dict[int, tuple[TouchState, np.ndarray]] = {}

    def push(self, state: TouchState) -> None:
        """Follow the touches that are in contact at this reading."""
        if not state.going:
            return
        then = state, self.poses.at(state.reading.q)
        for touch in state.going:
            if touch.last == state.reading.stamp:
                self.felt[touch.id] = then

    def of(self, touch: int) -> Float[np.ndarray, "3"]:
        """The direction of the touch of that id at its latest contact.

        A unit vector in the world, zero where the touch stayed in its place.
        """
        state, T_world_link = self.felt[touch]
        touches = state.records.touches
        [then] = touches[touches["id"] == touch]
        travel = then["latest"] - then["start"]
        distance = np.linalg.norm(travel)
        if distance < self.still:
            return np.zeros(3)
        return T_world_link[then["link"], :3, :3] @ travel / distance

    def forget(self, closed: Sequence[Touch | TouchBrief]) -> None:
        """Drop touches that are over."""
        for touch in closed:
            self.felt.pop(touch.id, None)
