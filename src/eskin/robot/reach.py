"""From a small step of a link to joint positions: inverse kinematics by iteration."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.robot.kinematics import Kinematics
from eskin.robot.robot import Robot
from eskin.transforms import log_so3

ROUNDS = 50
DAMPING = 0.01
"""Keeps joints from racing where the arm is near a singularity [m], [rad]."""
CLOSE = 1e-5
"""How far from its goal the link may end up [m], [rad]."""
NUDGE = 1e-6
"""Change of a joint over which the Jacobian is taken [rad]."""
FARTHEST = 0.5
"""What a joint may turn for a small step: more leads past a singularity [rad]."""


@final
class Reach:
    """Finds joint positions that put one link a step on, turned as it was.

    Damped least squares (Wampler 1986), beginning where the arm is.
    """

    def __init__(self, robot: Robot, link: str) -> None:
        """For one link of a robot."""
        self.robot = robot
        self.link = robot.link_index(link)
        self.kinematics = Kinematics(robot)
        self.poses(np.zeros((1, len(robot.joint_names))))

    def poses(self, q: Float[np.ndarray, "n joint"]) -> Float[np.ndarray, "n 4 4"]:
        """T_world_link of the link."""
        return self.kinematics.poses(q)[:, self.link]

    def stepped(
        self, q: Float[np.ndarray, "joint"], step_world: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "joint"] | None:
        """Joint positions a step away; None where the arm does not reach so far.

        Args:
            q: where the arm stands [rad].
            step_world: how far the link is to go [m].
        """
        goal = self.poses(q[None])[0]
        goal[:3, 3] += step_world
        found = q.astype(np.float64)
        for _ in range(ROUNDS):
            nudged = np.vstack([found, found + NUDGE * np.eye(len(q))])
            T = self.poses(nudged)
            gap = difference(goal[None], T[:1])[0]
            if np.abs(gap).max() < CLOSE:
                return found if self.allowed(found, q) else None
            J = difference(T[1:], T[:1]).T / NUDGE
            found = found + J.T @ np.linalg.solve(
                J @ J.T + DAMPING**2 * np.eye(len(J)), gap
            )
        return None

    def allowed(
        self, found: Float[np.ndarray, "joint"], q: Float[np.ndarray, "joint"]
    ) -> bool:
        """Whether the joints may be there, and it is not far to go."""
        inside = (found >= self.robot.lower) & (found <= self.robot.upper)
        return bool(inside.all() and np.abs(found - q).max() <= FARTHEST)


def difference(
    T_to: Float[np.ndarray, "n 4 4"], T_from: Float[np.ndarray, "1 4 4"]
) -> Float[np.ndarray, "n 6"]:
    """Shift [m] and turn [rad] in the world from one pose to others."""
    turn = T_to[:, :3, :3] @ T_from[:, :3, :3].swapaxes(1, 2)
    return np.concatenate([T_to[:, :3, 3] - T_from[:, :3, 3], log_so3(turn)], axis=1)
