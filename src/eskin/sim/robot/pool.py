"""Poses found in advance, so that drawing one costs nothing."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.robot.free import acceptable, limits
from eskin.sim.robot.groups import GROUPS, groups_meant, groups_of
from eskin.sim.robot.world import World
from eskin.sim.site.folding import folds_at
from eskin.sim.site.touching import touch_links

CHUNK = 2048


@dataclass(frozen=True, eq=False)
class Pool:
    """Poses of each group, in the order in which they were found."""

    any: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses as they come."""
    folded: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses in which patches of different links face each other closely."""
    touching: dict[int, Float[np.ndarray, "_ joint"]]
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
        any=sorted_out(world, q, group, any_count),
        folded=sorted_out(world, q[folded], group[folded], folded_count),
        touching=sorted_out(world, touching, touching_group, touching_count),
        shares=shares_of(world, group),
        folded_shares=shares_of(world, group[folded]),
    )


def sorted_out(
    world: World,
    q: Float[np.ndarray, "pose joint"],
    group: Int[np.ndarray, "pose"],
    most: int,
) -> dict[int, Float[np.ndarray, "_ joint"]]:
    """The first poses of each group."""
    return {each: q[group == each][:most] for each in groups_meant(world, GROUPS)}


def shares_of(world: World, group: Int[np.ndarray, "pose"]) -> dict[int, float]:
    """How many of the poses are of each group."""
    total = max(1, len(group))
    return {
        each: float(np.count_nonzero(group == each) / total)
        for each in groups_meant(world, GROUPS)
    }


def accepted(world: World, rng: np.random.Generator) -> Float[np.ndarray, "pose joint"]:
    """Poses drawn evenly, those that a robot would take and people can reach.

    A robot without joints takes the one pose it has.
    """
    if not world.can_move:
        return np.zeros((1, 0))
    low, high = limits(world)
    tries = int(world.constants.value("robot.pool_tries"))
    q = rng.uniform(low, high, (tries, len(low)))
    chunks = (q[i : i + CHUNK] for i in range(0, tries, CHUNK))
    return np.concatenate([chunk[acceptable(world, chunk)] for chunk in chunks])


def touching_poses(
    world: World,
    q: Float[np.ndarray, "pose joint"],
    group: Int[np.ndarray, "pose"],
    most: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "_ joint"], Int[np.ndarray, "_"]]:
    """Poses bent until a link all but touches a patch of another, and their groups."""
    tries = int(world.constants.value("robot.pool_bent"))
    found = [
        touch_links(world, q[group == each][:tries], most, rng)
        for each in groups_meant(world, GROUPS)
    ]
    bent = np.concatenate(found)
    return bent, groups_of(world, bent, world.poses(bent))
