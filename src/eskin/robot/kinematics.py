"""Forward kinematics: from joint values to the pose of every link."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.robot.robot import Joint, Robot
from eskin.transforms import skew

__all__ = ["Kinematics"]


@final
class Kinematics:
    """Poses of all links of a robot, in float64, for one `q` or any batch of them.

    A joint's motion is linear in sin q, 1 - cos q and q (Rodrigues), so the constant
    matrices of all joints are multiplied once, here; then each generation of the tree
    takes one matrix product.
    """

    def __init__(self, robot: Robot) -> None:
        """Prepare the constant matrices of every joint."""
        self.robot = robot
        # One row a link: what hangs it on its parent, and the root's fixed identity.
        joint_of = {joint.child: joint for joint in robot.joints}
        self.rest = np.tile(np.eye(4), (len(robot.links), 1, 1))
        for index, name in enumerate(robot.link_names):
            if name in joint_of:
                self.rest[index] = joint_of[name].T_parent_joint
        moving = [joint for joint in robot.joints if joint.kind != "fixed"]
        self.moving = np.array([robot.link_index(j.child) for j in moving], dtype=int)
        self.source, self.multiplier, self.offset = followers(robot, moving)
        motions = np.array([motion_terms(j) for j in moving]).reshape(-1, 3, 4, 4)
        self.sine, self.versine, self.slide = np.moveaxis(
            self.rest[self.moving][:, None] @ motions, 1, 0
        )
        self.generations = generations(robot)

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
        value = q[..., self.source] * self.multiplier + self.offset
        value = value[..., None, None]
        T = np.broadcast_to(self.rest, (*q.shape[:-1], *self.rest.shape)).copy()
        T[..., self.moving, :, :] += (
            np.sin(value) * self.sine
            + 2 * np.sin(value / 2) ** 2 * self.versine
            + value * self.slide
        )
        for parents, children in self.generations:
            T[..., children, :, :] = T[..., parents, :, :] @ T[..., children, :, :]
        return T


def motion_terms(joint: Joint) -> list[Float[np.ndarray, "4 4"]]:
    """Matrices that sin q, 1 - cos q and q multiply in the joint's motion."""
    sine, versine, slide = np.zeros((3, 4, 4))
    if joint.kind == "prismatic":
        slide[:3, 3] = joint.axis
    else:
        sine[:3, :3] = skew(joint.axis)
        versine = sine @ sine
    return [sine, versine, slide]


def followers(
    robot: Robot, moving: list[Joint]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each moving joint: the place in `q` it reads, its multiplier and offset."""
    places = {name: place for place, name in enumerate(robot.joint_names)}
    source, multiplier, offset = [], [], []
    for joint in moving:
        source.append(places[joint.mimic.joint if joint.mimic else joint.name])
        multiplier.append(joint.mimic.multiplier if joint.mimic else 1.0)
        offset.append(joint.mimic.offset if joint.mimic else 0.0)
    return np.array(source, dtype=int), np.array(multiplier), np.array(offset)


def generations(robot: Robot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Parents and children as link indices, generation by generation from the root."""
    edges = [
        (robot.link_index(j.parent), robot.link_index(j.child)) for j in robot.joints
    ]
    parents = {i for i in range(len(robot.links))} - {child for _, child in edges}
    result = []
    while step := [(parent, child) for parent, child in edges if parent in parents]:
        result.append((np.array([p for p, _ in step]), np.array([c for _, c in step])))
        parents = {child for _, child in step}
    return result
