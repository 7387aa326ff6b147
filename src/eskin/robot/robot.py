"""This module describes a robot: a tree of links connected by joints."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.robot.shapes import Geom

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]


@dataclass(frozen=True, eq=False)
class Link:
    """A link is a rigid part of a robot; its frame is that of its parent joint."""

    name: str
    """Name of the link, unique in its robot."""
    geoms: tuple[Geom, ...] = ()
    """Collision shapes of the link."""


@dataclass(frozen=True)
class Mimic:
    """A mimic rule sets a joint's value to multiplier * other's value + offset."""

    joint: str
    """Name of the joint that is followed."""
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
    """Name of the robot."""
    links: tuple[Link, ...]
    """Links, in the order in which poses are computed."""
    joints: tuple[Joint, ...]
    """Joints, those without a value in `q` included."""

    def __post_init__(self) -> None:
        """Check that links and joints form one tree."""
        check_tree(
            self.name,
            [link.name for link in self.links],
            [(joint.name, joint.parent, joint.child) for joint in self.joints],
        )
        for joint in self.joints:
            if joint.mimic and joint.mimic.joint not in self.joint_names:
                raise RobotError(
                    f"robot '{self.name}': joint '{joint.name}' follows "
                    f"'{joint.mimic.joint}', which is no moving joint with a value of "
                    f"its own; allowed: {', '.join(self.joint_names) or 'none'}"
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


JointTriple = tuple[str, str, str]


def check_tree(robot: str, links: Sequence[str], joints: Sequence[JointTriple]) -> None:
    """Raise unless links and joints (name, parent, child) form one tree.

    Raises:
        RobotError: A name is repeated, a link is unknown or has two parents, or there
            are several roots or a cycle.
    """
    if not links:
        raise RobotError(f"robot '{robot}' has no links; at least one is needed")
    for kind, names in (("link", links), ("joint", [name for name, _, _ in joints])):
        if duplicate := find_duplicate(names):
            raise RobotError(
                f"robot '{robot}' has {kind} '{duplicate}' twice; rename one"
            )
    check_link_references(robot, set(links), joints)
    if child := find_duplicate([child for _, _, child in joints]):
        parents = sorted(name for name, _, c in joints if c == child)
        raise RobotError(
            f"robot '{robot}': link '{child}' hangs from several joints "
            f"({', '.join(parents)}); allowed: one"
        )
    check_connected(robot, links, joints)


def check_link_references(
    robot: str, links: set[str], joints: Sequence[JointTriple]
) -> None:
    """Raise where the parent or child of a joint is not a link."""
    for name, parent, child in joints:
        for end, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise RobotError(
                    f"robot '{robot}': joint '{name}' has unknown {end} link "
                    f"'{link}'; allowed: {', '.join(sorted(links))}"
                )


def check_connected(
    robot: str, links: Sequence[str], joints: Sequence[JointTriple]
) -> None:
    """Raise where there are several roots, or links form a cycle."""
    parent_of = {child: parent for _, parent, child in joints}
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise RobotError(
            f"robot '{robot}' has several roots ({', '.join(roots)}); "
            "join them with fixed joints to leave one"
        )
    reached = set(roots)
    left = [link for link in links if link not in reached]
    while new := {link for link in left if parent_of[link] in reached}:
        reached |= new
        left = [link for link in left if link not in new]
    if left:
        raise RobotError(
            f"robot '{robot}': links {', '.join(left)} hang in a cycle; "
            "remove the joint that closes it"
        )


def find_duplicate(names: Iterable[str]) -> str | None:
    """Return the first name that occurs more than once."""
    return next((name for name, count in Counter(names).items() if count > 1), None)
