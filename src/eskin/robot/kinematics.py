"""This module computes forward and inverse kinematics."""

import math
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.robot.kinematics_kernels import compute_link_poses
from eskin.robot.robot import Joint, Robot
from eskin.transforms import log_so3, skew


@final
class Kinematics:
    """Forward kinematics map one `q`, or a batch, to poses of all links in float64.

    A joint's motion is linear in sin q, 1 - cos q and q (Rodrigues), so the constant
    matrices of all joints are multiplied once, at construction.
    """

    def __init__(self, robot: Robot) -> None:
        """Compute the constant matrices of every joint."""
        self.robot = robot
        self.order = sort_links(robot)
        links = len(robot.links)
        self.mimic = np.tile([1.0, 0.0], (links, 1))
        self.motion = np.zeros((links, 4, 3, 4))
        self.motion[:, 0] = np.eye(4)[:3]
        for joint in robot.joints:
            link = robot.link_index(joint.child)
            terms = joint.T_parent_joint @ np.array(compute_motion_terms(joint))
            self.motion[link] = terms[:, :3]
            if joint.mimic:
                self.mimic[link] = joint.mimic.multiplier, joint.mimic.offset

    def poses(
        self, q: Float[np.ndarray, "*batch joint"]
    ) -> Float[np.ndarray, "*batch link 4 4"]:
        """Return T_world_link of every link, in the order of `robot.links`.

        The world is the frame of the root link.

        Args:
            q: values of the joints in `robot.joint_names` [rad] or [m].

        Raises:
            ValueError: q has the wrong length.
        """
        names = self.robot.joint_names
        if q.shape[-1] != len(names):
            raise ValueError(
                f"q has {q.shape[-1]} values, robot '{self.robot.name}' has "
                f"{len(names)} moving joints; give one for each of: {', '.join(names)}"
            )
        batch = q.shape[:-1]
        rows = np.ascontiguousarray(q, np.float64).reshape(math.prod(batch), len(names))
        T_world_link = np.empty((len(rows), len(self.order), 4, 4))
        compute_link_poses(rows, self.order, self.mimic, self.motion, T_world_link)
        return T_world_link.reshape(*batch, len(self.order), 4, 4)


def compute_motion_terms(joint: Joint) -> list[Float[np.ndarray, "4 4"]]:
    """Return the constant term of a joint's motion and those of sin q, 1 - cos q, q."""
    sine, versine, slide = np.zeros((3, 4, 4))
    if joint.kind == "prismatic":
        slide[:3, 3] = joint.axis
    elif joint.kind != "fixed":
        sine[:3, :3] = skew(joint.axis)
        versine = sine @ sine
    return [np.eye(4), sine, versine, slide]


def sort_links(robot: Robot) -> Int[np.ndarray, "link 3"]:
    """Return link, parent and index in `q` (or -1), parents before children.

    A joint that follows another has the index of that one; a fixed joint has -1.
    """
    indices = {name: index for index, name in enumerate(robot.joint_names)}
    rows = {
        joint.child: (
            robot.link_index(joint.child),
            robot.link_index(joint.parent),
            indices.get(joint.mimic.joint if joint.mimic else joint.name, -1),
        )
        for joint in robot.joints
    }
    ordered = [(i, -1, -1) for i, n in enumerate(robot.link_names) if n not in rows]
    for link, *_ in ordered:
        children = [j.child for j in robot.joints if j.parent == robot.link_names[link]]
        ordered += [rows[child] for child in children]
    return np.array(ordered, dtype=np.int64)


MAX_ITERATIONS = 50
DAMPING = 0.01
"""Damping that limits joint steps near a singularity [m], [rad]."""
TOLERANCE = 1e-5
"""Largest remaining error of the link's pose [m], [rad]."""
JACOBIAN_STEP = 1e-6
"""Joint step of the finite differences of the Jacobian [rad]."""
MAX_JOINT_STEP = 0.5
"""Largest change of a joint for a small step; more means a singularity [rad]."""


@final
class DampedLeastSquaresIK:
    """Damped least squares find joint positions that move one link by a small step.

    The link keeps its orientation. The iteration (Wampler 1986) begins at the current
    joint positions.
    """

    def __init__(self, robot: Robot, link: str) -> None:
        """Prepare the kinematics of one link of a robot."""
        self.robot = robot
        self.link = robot.link_index(link)
        self.kinematics = Kinematics(robot)
        self.poses(np.zeros((1, len(robot.joint_names))))

    def poses(self, q: Float[np.ndarray, "n joint"]) -> Float[np.ndarray, "n 4 4"]:
        """Return T_world_link of the link."""
        return self.kinematics.poses(q)[:, self.link]

    def solve_step(
        self, q: Float[np.ndarray, "joint"], step_world: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "joint"] | None:
        """Return joint positions that move the link; None where it cannot get there.

        Args:
            q: current joint positions [rad].
            step_world: translation of the link [m].
        """
        goal = self.poses(q[None])[0]
        goal[:3, 3] += step_world
        found = q.astype(np.float64)
        for _ in range(MAX_ITERATIONS):
            nudged = np.vstack([found, found + JACOBIAN_STEP * np.eye(len(q))])
            T = self.poses(nudged)
            error = compute_pose_error(goal[None], T[:1])[0]
            if np.abs(error).max() < TOLERANCE:
                return found if self.is_allowed(found, q) else None
            J = compute_pose_error(T[1:], T[:1]).T / JACOBIAN_STEP
            found = found + J.T @ np.linalg.solve(
                J @ J.T + DAMPING**2 * np.eye(len(J)), error
            )
        return None

    def is_allowed(
        self, found: Float[np.ndarray, "joint"], q: Float[np.ndarray, "joint"]
    ) -> bool:
        """Return whether joints are within their limits and near the current `q`."""
        inside = (found >= self.robot.lower) & (found <= self.robot.upper)
        return bool(inside.all() and np.abs(found - q).max() <= MAX_JOINT_STEP)


def compute_pose_error(
    T_to: Float[np.ndarray, "n 4 4"], T_from: Float[np.ndarray, "1 4 4"]
) -> Float[np.ndarray, "n 6"]:
    """Return translation [m] and rotation [rad] in the world from a pose to others."""
    turn = T_to[:, :3, :3] @ T_from[:, :3, :3].swapaxes(1, 2)
    return np.concatenate([T_to[:, :3, 3] - T_from[:, :3, 3], log_so3(turn)], axis=1)
