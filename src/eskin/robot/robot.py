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

Edge = tuple[str, str, str]


def check_tree(robot: str, links: Sequence[str], joints: Sequence[Edge]) -> None:
    """Refuse links and joints (name, parent, child) that do not form one tree.

    Raises:
        RobotError: Names twice, unknown links, two parents, several roots or a cycle.
    """
    if not links:
        raise RobotError(f"robot '{robot}' has no links; at least one is needed")
    for kind, names in (("link", links), ("joint", [name for name, _, _ in joints])):
        if twice := repeated(names):
            raise RobotError(f"robot '{robot}' has {kind} '{twice}' twice; rename one")
    check_ends(robot, set(links), joints)
    if child := repeated([child for _, _, child in joints]):
        parents = sorted(name for name, _, c in joints if c == child)
        raise RobotError(
            f"robot '{robot}': link '{child}' hangs from several joints "
            f"({', '.join(parents)}); allowed: one"
        )
    check_connected(robot, links, joints)


def check_ends(robot: str, links: set[str], joints: Sequence[Edge]) -> None:
    """Refuse joints whose parent or child is no link."""
    for name, parent, child in joints:
        for end, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise RobotError(
                    f"robot '{robot}': joint '{name}' has unknown {end} link "
                    f"'{link}'; allowed: {', '.join(sorted(links))}"
                )


def check_connected(robot: str, links: Sequence[str], joints: Sequence[Edge]) -> None:
    """Refuse several roots, and links in a cycle."""
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


def repeated(names: Iterable[str]) -> str | None:
    """The first name that comes more than once."""
    return next((name for name, count in Counter(names).items() if count > 1), None)


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part of a robot; its frame is that of the joint it hangs from."""

    name: str
    geoms: tuple[Geom, ...] = ()


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: value = multiplier * other's value + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0
    """[rad] or [m]"""


@dataclass(frozen=True, eq=False)
class Joint:
    """What holds a child link to its parent, and how it may move."""

    name: str
    kind: Literal["revolute", "continuous", "prismatic", "fixed"]
    parent: str
    child: str
    T_parent_joint: Float[np.ndarray, "4 4"]
    """Pose of the child's frame in the parent's at joint value 0."""
    axis: Float[np.ndarray, "3"]
    """Unit axis of motion in the joint's frame, which is the child's frame too."""
    lower: float = -np.inf
    """Least joint value [rad] or [m]."""
    upper: float = np.inf
    """Greatest joint value [rad] or [m]."""
    velocity: float = np.inf
    """Greatest speed [rad/s] or [m/s]."""
    mimic: Mimic | None = None
    """Set where this joint has no value of its own but follows another's."""


@dataclass(frozen=True, eq=False)
class Robot:
    """Links and joints that form one tree.

    `q` holds one value for each joint in `joint_names`: those that move and do not
    follow another, in the order of `joints`.

    Raises:
        RobotError: The links and joints do not form one tree.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        """Refuse what is not one tree."""
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
        """Names of all links, in their order."""
        return tuple(link.name for link in self.links)

    @cached_property
    def actuated_joints(self) -> tuple[Joint, ...]:
        """Joints with a value in `q`, in the order of `q`."""
        return tuple(j for j in self.joints if j.kind != "fixed" and not j.mimic)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints with a value in `q`, in the order of `q`."""
        return tuple(joint.name for joint in self.actuated_joints)

    @property
    def lower(self) -> Float[np.ndarray, "joint"]:
        """Least joint values [rad] or [m]."""
        return np.array(
            [joint.lower for joint in self.actuated_joints], dtype=np.float64
        )

    @property
    def upper(self) -> Float[np.ndarray, "joint"]:
        """Greatest joint values [rad] or [m]."""
        return np.array(
            [joint.upper for joint in self.actuated_joints], dtype=np.float64
        )

    @property
    def velocity(self) -> Float[np.ndarray, "joint"]:
        """Greatest joint speeds [rad/s] or [m/s]."""
        return np.array(
            [joint.velocity for joint in self.actuated_joints], dtype=np.float64
        )

    def link_index(self, name: str) -> int:
        """Place of a link in `links`.

        Raises:
            RobotError: The robot has no such link.
        """
        if name not in self.link_names:
            raise RobotError(
                f"robot '{self.name}' has no link '{name}'; "
                f"allowed: {', '.join(self.link_names)}"
            )
        return self.link_names.index(name)
