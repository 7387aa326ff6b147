"""This module computes forward and inverse kinematics."""

import math
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.robot.kinematics_kernels import pose_links
from eskin.robot.robot import Joint, Robot
from eskin.transforms import log_so3, skew


@final
class Kinematics:
    """Poses of all links of a robot, in float64, for one `q` or any batch of them.

    A joint's motion is linear in sin q, 1 - cos q and q (Rodrigues), so the constant
    matrices of all joints are multiplied once, here.
    """

    def __init__(self, robot: Robot) -> None:
        """Prepare the constant matrices of every joint."""
        self.robot = robot
        self.order = order_of(robot)
        links = len(robot.links)
        self.gear = np.tile([1.0, 0.0], (links, 1))
        self.motion = np.zeros((links, 4, 3, 4))
        self.motion[:, 0] = np.eye(4)[:3]
        for joint in robot.joints:
            link = robot.link_index(joint.child)
            terms = joint.T_parent_joint @ np.array(motion_terms(joint))
            self.motion[link] = terms[:, :3]
            if joint.mimic:
                self.gear[link] = joint.mimic.multiplier, joint.mimic.offset

    def poses(
        self, q: Float[np.ndarray, "*batch joint"]
    ) -> Float[np.ndarray, "*batch link 4 4"]:
        """T_world_link of every link, in the order of `robot.links`.

        The world is the frame of the root link.

        Args:
            q: Values of the joints in `robot.joint_names` [rad] or [m].

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
        pose_links(rows, self.order, self.gear, self.motion, T_world_link)
        return T_world_link.reshape(*batch, len(self.order), 4, 4)


def motion_terms(joint: Joint) -> list[Float[np.ndarray, "4 4"]]:
    """The frame at rest, and what sin q, 1 - cos q and q multiply in the motion."""
    sine, versine, slide = np.zeros((3, 4, 4))
    if joint.kind == "prismatic":
        slide[:3, 3] = joint.axis
    elif joint.kind != "fixed":
        sine[:3, :3] = skew(joint.axis)
        versine = sine @ sine
    return [np.eye(4), sine, versine, slide]


def order_of(robot: Robot) -> Int[np.ndarray, "link 3"]:
    """Parents before children: each link, its parent and the place in `q`, or -1.

    A joint that follows another reads that one's place; a fixed one reads none.
    """
    places = {name: place for place, name in enumerate(robot.joint_names)}
    rows = {
        joint.child: (
            robot.link_index(joint.child),
            robot.link_index(joint.parent),
            places.get(joint.mimic.joint if joint.mimic else joint.name, -1),
        )
        for joint in robot.joints
    }
    ordered = [(i, -1, -1) for i, n in enumerate(robot.link_names) if n not in rows]
    for link, *_ in ordered:
        children = [j.child for j in robot.joints if j.parent == robot.link_names[link]]
        ordered += [rows[child] for child in children]
    return np.array(ordered, dtype=np.int64)


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
class DampedLeastSquaresIK:
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

    def solve_step(
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
