"""This module describes a robot: a tree of links connected by joints."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.robot.shapes import Geom

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]

MIN_AXIS = 0.01
"""Length of a link from which it has an axis [m]."""


@dataclass(frozen=True, eq=False)
class Link:
    """A link is a rigid part of a robot; its frame is the frame of its parent joint."""

    name: str
    """Name of the link, unique in its robot."""
    geoms: tuple[Geom, ...] = ()
    """Collision shapes of the link."""
    lacks_meshes: bool = False
    """Whether it has collision meshes that are not at hand."""


@dataclass(frozen=True)
class Mimic:
    """A mimic rule sets a joint's value to multiplier * other's value + offset."""

    joint: str
    """Name of the other joint."""
    multiplier: float = 1.0
    """Factor of the other joint's value."""
    offset: float = 0.0
    """Constant that is added [rad] or [m]."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint connects a child link to its parent and says how the child moves."""

    name: str
    """Name of the joint, unique in its robot."""
    kind: JointKind
    """Type of motion, as in URDF."""
    parent: str
    """Name of the parent link."""
    child: str
    """Name of the child link."""
    T_parent_joint: Float[np.ndarray, "4 4"]
    """Pose of the child's frame in the parent's at joint value 0."""
    axis: Float[np.ndarray, "3"]
    """Unit axis of motion in the joint's frame, which is the child's frame too."""
    lower: float = -np.inf
    """Smallest joint value [rad] or [m]."""
    upper: float = np.inf
    """Largest joint value [rad] or [m]."""
    velocity: float = np.inf
    """Largest speed [rad/s] or [m/s]."""
    mimic: Mimic | None = None
    """Rule by which this joint follows another; None where it has its own value."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot holds links and joints that form one tree.

    `q` holds one value for each joint in `joint_names`: those that move and do not
    follow another, in the order of `joints`.

    Raises:
        RobotError: The links and joints do not form one tree.
    """

    name: str
    links: tuple[Link, ...]
    """Links, in the order in which poses are computed."""
    joints: tuple[Joint, ...]
    """Joints, those without a value in `q` included."""
    urdf: bytes = field(default=b"", repr=False)
    """URDF that it was read from; empty for a robot built in code."""

    def __post_init__(self) -> None:
        """Check that links and joints form one tree."""
        check_tree(self)
        for joint in self.joints:
            if joint.mimic and joint.mimic.joint not in self.joint_names:
                raise RobotError(
                    f"robot '{self.name}': joint '{joint.name}' follows "
                    f"'{joint.mimic.joint}', which has no value of its own; "
                    f"allowed: {', '.join(self.joint_names) or 'none'}"
                )

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Return the names of all links, in their order."""
        return tuple(link.name for link in self.links)

    @cached_property
    def actuated_joints(self) -> tuple[Joint, ...]:
        """Return the joints that have a value in `q`, in the order of `q`."""
        return tuple(j for j in self.joints if j.kind != "fixed" and not j.mimic)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the joints that have a value in `q`, in its order."""
        return tuple(joint.name for joint in self.actuated_joints)

    @property
    def lower(self) -> Float[np.ndarray, "joint"]:
        """Return the smallest joint values [rad] or [m]."""
        return np.array([j.lower for j in self.actuated_joints], dtype=np.float64)

    @property
    def upper(self) -> Float[np.ndarray, "joint"]:
        """Return the largest joint values [rad] or [m]."""
        return np.array([j.upper for j in self.actuated_joints], dtype=np.float64)

    @property
    def velocity(self) -> Float[np.ndarray, "joint"]:
        """Return the largest joint speeds [rad/s] or [m/s]."""
        return np.array([j.velocity for j in self.actuated_joints], dtype=np.float64)

    def describe_lacking_meshes(self, deed: str) -> str:
        """Describe how the robot does without missing meshes; empty if none is missing.

        Recordings and skins hold the URDF of their robot without its meshes.

        Args:
            deed: what is done to the robot, as "drawn".
        """
        count = sum(link.lacks_meshes for link in self.links)
        if not count:
            return ""
        return (
            f"robot '{self.name}' is {deed} without the meshes of {count} of its "
            f"{len(self.links)} links, which are not kept with its URDF; --robot-urdf "
            "FILE brings them"
        )

    def link_index(self, name: str) -> int:
        """Return the index of a link in `links`.

        Raises:
            RobotError: The robot has no such link.
        """
        if name not in self.link_names:
            raise RobotError(
                f"robot '{self.name}' has no link '{name}'; "
                f"allowed: {', '.join(self.link_names)}"
            )
        return self.link_names.index(name)

    def find_axis(self, link: str) -> Float[np.ndarray, "3"]:
        """Return the unit vector along a link toward the tool, in the link's frame.

        It points from the joint that moves the link to the mean position of the joints
        that the link carries; it is zero where that is less than 1 cm away.
        """
        carried = [j.T_parent_joint[:3, 3] for j in self.joints if j.parent == link]
        along = np.mean(carried, axis=0) if carried else np.zeros(3)
        length = np.linalg.norm(along)
        return along / length if length >= MIN_AXIS else np.zeros(3)


def check_tree(robot: Robot) -> None:
    """Raise unless the links and joints of a robot form one tree."""
    if not robot.links:
        raise RobotError(f"robot '{robot.name}' has no links; at least one is needed")
    joint_names = [joint.name for joint in robot.joints]
    for kind, names in (("link", robot.link_names), ("joint", joint_names)):
        if duplicate := find_duplicate(names):
            raise RobotError(
                f"robot '{robot.name}' has {kind} '{duplicate}' twice; rename one"
            )
    for joint in robot.joints:
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in robot.link_names:
                raise RobotError(
                    f"robot '{robot.name}': joint '{joint.name}' has unknown {end} "
                    f"link '{link}'; allowed: {', '.join(sorted(robot.link_names))}"
                )
    if child := find_duplicate(joint.child for joint in robot.joints):
        joints = sorted(joint.name for joint in robot.joints if joint.child == child)
        raise RobotError(
            f"robot '{robot.name}': link '{child}' is the child of several joints "
            f"({', '.join(joints)}); allowed: one"
        )
    check_connected(robot)


def check_connected(robot: Robot) -> None:
    """Raise where there are several roots, or links form a cycle."""
    parent_of = {joint.child: joint.parent for joint in robot.joints}
    roots = [link for link in robot.link_names if link not in parent_of]
    if len(roots) > 1:
        raise RobotError(
            f"robot '{robot.name}' has several roots ({', '.join(roots)}); "
            "join them with fixed joints to leave one"
        )
    reached = set(roots)
    left = [link for link in robot.link_names if link not in reached]
    while new := {link for link in left if parent_of[link] in reached}:
        reached |= new
        left = [link for link in left if link not in new]
    if left:
        raise RobotError(
            f"robot '{robot.name}': links {', '.join(left)} form a cycle; "
            "remove the joint that closes it"
        )


def find_duplicate(names: Iterable[str]) -> str | None:
    """Return the first name that occurs more than once."""
    return next((name for name, count in Counter(names).items() if count > 1), None)
