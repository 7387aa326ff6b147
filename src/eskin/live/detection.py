"""This module defines detections and tracks the direction of each touch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.recording import DetectionRecord
from eskin.touch import LinkPoseCache, Touch, TouchState, TouchStatus


@dataclass(frozen=True, eq=False)
class Detection:
    """What was said of one touch: said once, and never withdrawn."""

    stamp: int
    """When it was said: the stamp of the latest reading [ns since the epoch]."""

    touch: int
    """Id of the touch."""

    gesture: str
    """One of the model's vocabulary, or `unknown`."""

    confidence: float
    """Calibrated probability of the gesture; of the likeliest where it is unknown."""

    onset: int
    """First contact [ns since the epoch]."""

    end: int
    """Latest contact by `stamp` [ns since the epoch]."""

    link: str
    """Link of the most loaded taxel at `end`."""

    patch: str
    """Patch of that taxel."""

    p_world: Float[np.ndarray, "3"]
    """Force-weighted centre of the strongest contact at `end` [m]."""

    n_world: Float[np.ndarray, "3"]
    """Mean outward normal of that contact."""

    direction_world: Float[np.ndarray, "3"]
    """Unit vector of travel at `end`, with the robot's own motion taken out; zero where
    the touch stayed in its place."""

    peak_force: float
    """Greatest force until `stamp` [N]."""

    likeliest: str = ""
    """Likeliest gesture of a touch that is unknown, perhaps `none`; empty where it is
    known."""

    def record(self) -> DetectionRecord:
        """As a recording keeps it."""
        return DetectionRecord(
            stamp=self.stamp,
            gesture=self.gesture,
            confidence=self.confidence,
            onset=self.onset,
            end=self.end,
            link=self.link,
            patch=self.patch,
            p_world=vector(self.p_world),
            n_world=vector(self.n_world),
            direction_world=vector(self.direction_world),
            peak_force=self.peak_force,
        )


def vector(array: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """As plain numbers."""
    x, y, z = array.tolist()
    return x, y, z


@final
class Travel:
    """Remembers every open touch as it was at its latest contact; stateful.

    Few touches are ever asked about: a direction is worked out when it is.
    """

    def __init__(self, poses: LinkPoseCache, still: float) -> None:
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
        if not state.open:
            return
        then = state, self.poses.get(state.reading.q)
        for touch in state.open:
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

    def forget(self, closed: Sequence[Touch | TouchStatus]) -> None:
        """Drop touches that are over."""
        for touch in closed:
            self.felt.pop(touch.id, None)
