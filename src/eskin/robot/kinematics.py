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
    """Forward kinematics compute the poses of all links from one `q` or a batch.

    The transform of a joint is linear in sin q, 1 - cos q and q (Rodrigues); the
    constant matrices of these terms are computed once, at construction.
    """

    def __init__(self, robot: Robot) -> None:
        """Compute the constant matrices of every joint of a robot."""
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
        """Return T_world_link of every link (float64), in the order of `robot.links`.

        q are the values of the joints in `robot.joint_names` [rad] or [m].

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
    """Return a joint's constant matrix and the matrices of sin q, 1 - cos q and q."""
    sine, versine, slide = np.zeros((3, 4, 4))
    if joint.kind == "prismatic":
        slide[:3, 3] = joint.axis
    elif joint.kind != "fixed":
        sine[:3, :3] = skew(joint.axis)
        versine = sine @ sine
    return [np.eye(4), sine, versine, slide]


def sort_links(robot: Robot) -> Int[np.ndarray, "link 3"]:
    """Return the indices of each link, of its parent, and of its joint in `q`.

    Parents come before children. A joint that follows another has the index of that
    one; a fixed joint, and a missing parent, is -1.
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
"""Error of the link's pose below which the iteration has converged [m], [rad]."""
JACOBIAN_STEP = 1e-6
"""Joint step of the finite differences of the Jacobian [rad]."""
MAX_JOINT_STEP = 0.5
"""Largest change of a joint in a solution; larger ones are near singularities [rad]."""


@final
class DampedLeastSquaresIK:
    """This solver finds joint positions that translate one link by a small step.

    The link keeps its orientation. Damped least squares (Wampler 1986) are iterated
    from the current joint positions.
    """

    def __init__(self, robot: Robot, link: str) -> None:
        """Build the kinematics, and compile them before the first step."""
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
        """Return joint positions [rad] near `q` that translate the link by a step [m].

        There may be none.
        """
        goal = self.poses(q[None])[0]
        goal[:3, 3] += step_world
        solution = q.astype(np.float64)
        for _ in range(MAX_ITERATIONS):
            shifted = solution + JACOBIAN_STEP * np.eye(len(q))
            T = self.poses(np.vstack([solution, shifted]))
            error = compute_pose_error(goal[None], T[:1])[0]
            if np.abs(error).max() < TOLERANCE:
                return solution if self.is_allowed(solution, q) else None
            J = compute_pose_error(T[1:], T[:1]).T / JACOBIAN_STEP
            damped = J @ J.T + DAMPING**2 * np.eye(len(J))
            solution = solution + J.T @ np.linalg.solve(damped, error)
        return None

    def is_allowed(
        self, solution: Float[np.ndarray, "joint"], q: Float[np.ndarray, "joint"]
    ) -> bool:
        """Return whether a solution is within the joint limits and near `q`."""
        inside = (solution >= self.robot.lower) & (solution <= self.robot.upper)
        return bool(inside.all() and np.abs(solution - q).max() <= MAX_JOINT_STEP)


def compute_pose_error(
    T_to: Float[np.ndarray, "n 4 4"], T_from: Float[np.ndarray, "1 4 4"]
) -> Float[np.ndarray, "n 6"]:
    """Return translation [m] and rotation [rad] in the world from a pose to others."""
    R = T_to[:, :3, :3] @ T_from[:, :3, :3].swapaxes(1, 2)
    return np.concatenate([T_to[:, :3, 3] - T_from[:, :3, 3], log_so3(R)], axis=1)
