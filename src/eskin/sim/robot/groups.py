"""Groups of poses that are alike, so that whole groups can be kept for tests."""

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.robot.world import World

GROUPS = frozenset(range(1, 13))
"""All groups. The forearm is level in 1-4, rises in 5-8 and hangs in 9-12."""

FOREARM, LIFT, ELBOW = "forearm_link", "shoulder_lift_joint", "elbow_joint"
BANDS = np.array([9, 1, 5])
"""First group of a forearm that hangs, is level, rises."""


def group_of(world: World, q: Float[np.ndarray, "joint"]) -> int:
    """The group of a pose, 1 to 12; turning the base does not change it."""
    return int(groups_of(world, q[None], world.poses(q[None]))[0])


def groups_of(
    world: World,
    q: Float[np.ndarray, "pose joint"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
) -> Int[np.ndarray, "pose"]:
    """The group of each pose: by rise of the forearm, lift, and bend of the elbow."""
    forearm = world.mounted.robot.link_index(FOREARM)
    rise = np.arcsin(np.clip(T_world_link[:, forearm, 2, 2], -1.0, 1.0))
    band = np.digitize(rise, np.deg2rad(world.constants.array("robot.slope")))
    lift = np.rad2deg(q[:, world.joint(LIFT)])
    elbow = np.rad2deg(q[:, world.joint(ELBOW)])
    backward = lift < world.constants.value("robot.upright")
    bent = np.abs(elbow) > world.constants.value("robot.bent")
    return BANDS[band] + 2 * backward.astype(np.int64) + bent
