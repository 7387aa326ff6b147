"""Which poses a robot would take."""

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.people.hand import MM
from eskin.sim.robot.world import World
from eskin.sim.site.folding import faces_of

CM2 = 1e-4


def limits(
    world: World,
) -> tuple[Float[np.ndarray, "joint"], Float[np.ndarray, "joint"]]:
    """Least and greatest joint values that poses are drawn from [rad]."""
    ranges = [
        np.deg2rad(world.constants.array(f"robot.range.{name}"))
        for name in world.mounted.robot.joint_names
    ]
    low, high = np.array(ranges).T
    return low, high


def acceptable(
    world: World, q: Float[np.ndarray, "pose joint"]
) -> Bool[np.ndarray, "pose"]:
    """Whether nothing collides and some skin is where people reach."""
    T = world.poses(q)
    good = is_free(world, T)
    good[good] = is_reachable(world, T[good])
    return good


def is_free(
    world: World, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Whether links keep clear of each other and of the table."""
    value = world.constants.value
    least, low = value("robot.clearance") * MM, value("robot.table_clearance") * MM
    gap, height = world.solids.clearance(T_world_link, least).T
    return (gap >= least) & (height >= low) & tool_is_up(world, T_world_link)


def tool_is_up(
    world: World, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Whether the last link is above the table as far as tools need."""
    least = world.constants.value("robot.tool_height")
    return T_world_link[:, -1, 2, 3] >= least


def is_reachable(
    world: World, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Whether enough skin is at a height that people of average size reach."""
    low, high = world.constants.array("place.height")
    table = world.constants.value("robot.table")
    faces = faces_of(world)
    up = T_world_link[:, faces.links, 2]
    points = np.split(faces.points, faces.starts[1:-1])
    rises = [up[:, i, :3] @ each.T + up[:, i, 3:] for i, each in enumerate(points)]
    height = table + np.concatenate(rises, axis=1)
    within = (height >= low) & (height <= high)
    least = world.constants.value("robot.reachable") * CM2
    return within @ faces.areas >= least
