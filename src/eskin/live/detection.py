"""This module defines detections and tracks the direction in which touches travel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.recording import DetectionRecord
from eskin.touch import LinkPoseCache, Touch, TouchState, TouchStatus

Heading = Literal["", "toward_tool", "toward_base", "left", "right"]
"""Direction of travel on a link: along it, or across it as seen by who faces the skin
there with the tool above."""


@dataclass(frozen=True, eq=False)
class Detection:
    """A detection reports the gesture of one touch, once, and is never withdrawn."""

    stamp: int
    """When it was reported: the stamp of the latest reading [ns since the epoch]."""
    touch: int
    """Id of the touch."""
    gesture: str
    """One of the model's vocabulary, or `unknown`."""
    confidence: float
    """Calibrated probability of the gesture; if unknown, of the likeliest."""
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
    """Unit vector of travel at `end`, without the robot's own motion; zero where the
    touch stayed in its place."""
    peak_force: float
    """Greatest force until `stamp` [N]."""
    heading: Heading = ""
    """Direction of travel along or across the link; empty where it has none."""
    likeliest: str = ""
    """Likeliest class where the gesture is `unknown`, perhaps `none`; else empty."""

    def record(self) -> DetectionRecord:
        """Return the row that a recording keeps of it."""
        return DetectionRecord(
            stamp=self.stamp,
            gesture=self.gesture,
            confidence=self.confidence,
            onset=self.onset,
            end=self.end,
            link=self.link,
            patch=self.patch,
            p_world=to_tuple(self.p_world),
            n_world=to_tuple(self.n_world),
            direction_world=to_tuple(self.direction_world),
            peak_force=self.peak_force,
        )


def to_tuple(array: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """Return a vector as plain numbers."""
    x, y, z = array.tolist()
    return x, y, z


MIN_HEADING = 0.5
"""Part of a direction along or across the link from which it counts."""


def find_row(state: TouchState, touch: int) -> np.void:
    """Return the TOUCH with an id."""
    touches = state.records.touches
    [row] = touches[touches["id"] == touch]
    return row


@final
class DirectionTracker:
    """A tracker keeps the state of every open touch at its latest contact.

    Directions are needed rarely, so they are computed on request.
    """

    def __init__(self, poses: LinkPoseCache, still: float) -> None:
        """Start without touches.

        Args:
            poses: poses of the links of the robot that the touches are on.
            still: travel below which a touch has no direction [m].
        """
        self.poses = poses
        self.still = still
        self.contacts: dict[int, tuple[TouchState, np.ndarray]] = {}

    def update(self, state: TouchState) -> None:
        """Keep the state of the touches that are in contact at this reading."""
        if not state.tracking.open:
            return
        contact = state, self.poses.get(state.reading.q)
        for touch in state.tracking.open:
            if touch.last == state.reading.stamp:
                self.contacts[touch.id] = contact

    def compute_direction(self, touch: int) -> Float[np.ndarray, "3"]:
        """Return the direction of the touch with that id at its latest contact.

        It is a unit vector in the world, zero where the touch stayed in its place.
        """
        state, T_world_link = self.contacts[touch]
        row = find_row(state, touch)
        return T_world_link[row["link"], :3, :3] @ self.compute_travel(row)

    def compute_travel(self, row: np.void) -> Float[np.ndarray, "3"]:
        """Return the direction of a TOUCH in its link's frame, zero if it stayed."""
        travel = row["latest"] - row["start"]
        distance = np.linalg.norm(travel)
        return np.zeros(3) if distance < self.still else travel / distance

    def find_heading(self, touch: int, n_world: Float[np.ndarray, "3"]) -> Heading:
        """Return along or across which side of its link a touch has travelled.

        Args:
            touch: id of the touch.
            n_world: outward normal of the skin at its latest contact.
        """
        state, T_world_link = self.contacts[touch]
        row, robot = find_row(state, touch), state.mounted.robot
        axis = robot.find_axis(robot.link_names[row["link"]])
        n_link = T_world_link[row["link"], :3, :3].T @ n_world
        travel = self.compute_travel(row)
        along, across = float(travel @ axis), float(travel @ np.cross(axis, n_link))
        if max(abs(along), abs(across)) < MIN_HEADING:
            return ""
        if abs(along) >= abs(across):
            return "toward_tool" if along > 0 else "toward_base"
        return "right" if across > 0 else "left"

    def forget(self, closed: Sequence[Touch | TouchStatus]) -> None:
        """Drop touches that have closed."""
        for touch in closed:
            self.contacts.pop(touch.id, None)
