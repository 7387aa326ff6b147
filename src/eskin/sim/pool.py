"""Poses found in advance, so that drawing one costs nothing."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.folding import faces_of, folds_at
from eskin.sim.groups import GROUPS, groups_of
from eskin.sim.hand import MM
from eskin.sim.touching import touch_links
from eskin.sim.world import World

CHUNK = 2048
CM2 = 1e-4
BENT = 300


@dataclass(frozen=True, eq=False)
class Pool:
    """Poses of each group, in the order in which they were found."""

    any: dict[int, Float[np.ndarray, "pose joint"]]
    """Poses as they come."""
    folded: dict[int, Float[np.ndarray, "pose joint"]]
    """Poses in which patches of different links face each other closely."""
    touching: dict[int, Float[np.ndarray, "pose joint"]]
    """Poses in which a link all but touches a patch of another."""
    shares: dict[int, float]
    """How many of all poses are of each group."""
    folded_shares: dict[int, float]
    """How many of all folded poses are of each group."""


@lru_cache(maxsize=4)
def pool_of(world: World) -> Pool:
    """The poses of a world: always the same ones."""
    rng = np.random.default_rng(int(world.constants.value("robot.pool_seed")))
    q = accepted(world, rng)
    group = groups_of(world, q, world.poses(q))
    any_count, folded_count, touching_count = (
        int(count) for count in world.constants.array("robot.pool")
    )
    folded = folds_at(world, q)
    touching, touching_group = touching_poses(world, q, group, touching_count, rng)
    return Pool(
        any=sorted_out(q, group, any_count),
        folded=sorted_out(q[folded], group[folded], folded_count),
        touching=sorted_out(touching, touching_group, touching_count),
        shares=shares_of(group),
        folded_shares=shares_of(group[folded]),
    )


def sorted_out(
    q: Float[np.ndarray, "pose joint"], group: Int[np.ndarray, "pose"], most: int
) -> dict[int, Float[np.ndarray, "_ joint"]]:
    """The first poses of each group."""
    return {each: q[group == each][:most] for each in sorted(GROUPS)}


def shares_of(group: Int[np.ndarray, "pose"]) -> dict[int, float]:
    """How many of the poses are of each group."""
    return {each: float(np.mean(group == each)) for each in sorted(GROUPS)}


def accepted(world: World, rng: np.random.Generator) -> Float[np.ndarray, "pose joint"]:
    """Poses drawn evenly, those that a robot would take and people can reach."""
    low, high = limits(world)
    tries = int(world.constants.value("robot.pool_tries"))
    q = rng.uniform(low, high, (tries, len(low)))
    chunks = (q[i : i + CHUNK] for i in range(0, tries, CHUNK))
    return np.concatenate([chunk[acceptable(world, chunk)] for chunk in chunks])


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
    return is_free(world, T) & is_reachable(world, T)


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
    up = T_world_link[:, np.repeat(faces.links, np.diff(faces.starts)), 2]
    height = table + np.einsum("ptj,tj->pt", up[..., :3], faces.points) + up[..., 3]
    within = (height >= low) & (height <= high)
    least = world.constants.value("robot.reachable") * CM2
    return within @ faces.areas >= least


def touching_poses(
    world: World,
    q: Float[np.ndarray, "pose joint"],
    group: Int[np.ndarray, "pose"],
    most: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "_ joint"], Int[np.ndarray, "_"]]:
    """Poses bent until a link all but touches a patch of another, and their groups."""
    found = [np.zeros((0, q.shape[1]))]
    for each in sorted(GROUPS):
        found.append(touch_links(world, q[group == each][:BENT], most, rng))
    bent = np.concatenate(found)
    return bent, groups_of(world, bent, world.poses(bent))
