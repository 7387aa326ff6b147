"""Groups of poses that are alike, so that whole groups can be kept for tests.

They are those of an arm like the UR5. All poses of another robot are in one group of
their own, which every group that is asked for stands for.
"""

from collections.abc import Collection

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.robot.world import World

GROUPS = frozenset(range(1, 13))
"""All groups. The forearm is level in 1-4, rises in 5-8 and hangs in 9-12."""

UNGROUPED = 0
"""Group of all poses of a robot that is no such arm."""

FOREARM, LIFT, ELBOW = "forearm_link", "shoulder_lift_joint", "elbow_joint"
BANDS = np.array([9, 1, 5])
"""First group of a forearm that hangs, is level, rises."""


def is_grouped(world: World) -> bool:
    """Whether the robot is an arm whose poses come in groups."""
    robot = world.mounted.robot
    return FOREARM in robot.link_names and {LIFT, ELBOW} <= set(robot.joint_names)


def groups_meant(world: World, asked: Collection[int]) -> list[int]:
    """The groups of this robot that those asked for stand for."""
    return sorted(asked) if is_grouped(world) else [UNGROUPED]


def group_of(world: World, q: Float[np.ndarray, "joint"]) -> int:
    """The group of a pose, 1 to 12 or `UNGROUPED`; the base's turn does not matter."""
    return int(groups_of(world, q[None], world.poses(q[None]))[0])


def groups_of(
    world: World,
    q: Float[np.ndarray, "pose joint"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
) -> Int[np.ndarray, "pose"]:
    """The group of each pose: by rise of the forearm, lift, and bend of the elbow."""
    if not is_grouped(world):
        return np.full(len(q), UNGROUPED, dtype=np.int64)
    forearm = world.mounted.robot.link_index(FOREARM)
    rise = np.arcsin(np.clip(T_world_link[:, forearm, 2, 2], -1.0, 1.0))
    band = np.digitize(rise, np.deg2rad(world.constants.array("robot.slope")))
    lift = np.rad2deg(q[:, world.joint(LIFT)])
    elbow = np.rad2deg(q[:, world.joint(ELBOW)])
    backward = lift < world.constants.value("robot.upright")
    bent = np.abs(elbow) > world.constants.value("robot.bent")
    return BANDS[band] + 2 * backward.astype(np.int64) + bent
