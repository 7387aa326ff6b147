"""Poses of the robot, drawn evenly among those it would take."""

import numpy as np
from jaxtyping import Float

from eskin.sim.robot.groups import GROUPS, group_of, groups_meant, is_grouped
from eskin.sim.robot.pool import Pool, pool_of
from eskin.sim.robot.world import World, build_world

__all__ = [
    "GROUPS",
    "build_world",
    "can_fold",
    "can_touch_itself",
    "draw_pose",
    "draw_touching_pose",
    "group_of",
    "pool_of",
]


def can_fold(world: World, groups: frozenset[int]) -> bool:
    """Whether patches of different links face each other in a pose of some groups."""
    poses = pool_of(world).folded
    return any(len(poses.get(group, ())) for group in groups_meant(world, groups))


def can_touch_itself(world: World, groups: frozenset[int]) -> bool:
    """Whether a link all but touches a patch of another in a pose of some groups."""
    poses = pool_of(world).touching
    return any(len(poses.get(group, ())) for group in groups_meant(world, groups))


def draw_pose(
    world: World,
    groups: set[int] | frozenset[int],
    rng: np.random.Generator,
    fold: bool = False,
) -> Float[np.ndarray, "joint"]:
    """A pose of some groups, as often as such poses are [rad].

    Nothing of what poses are chosen by depends on the base, which is drawn anew.

    Args:
        world: the robot.
        groups: of `GROUPS`.
        rng: to draw from.
        fold: whether patches of different links must face each other closely.

    Raises:
        ValueError: there is no such group, or no such pose in any of them.
    """
    pool = pool_of(world)
    poses = pool.folded if fold else pool.any
    shares = pool.folded_shares if fold else pool.shares
    return draw_of(world, poses, shares, groups, rng)


def draw_touching_pose(
    world: World, groups: set[int] | frozenset[int], rng: np.random.Generator
) -> Float[np.ndarray, "joint"]:
    """A pose in which a link all but touches a patch of another [rad].

    Raises:
        ValueError: there is no such group, or no such pose in any of them.
    """
    pool: Pool = pool_of(world)
    shares = {group: float(len(q)) for group, q in pool.touching.items()}
    return draw_of(world, pool.touching, shares, groups, rng)


def draw_of(
    world: World,
    poses: dict[int, Float[np.ndarray, "_ joint"]],
    shares: dict[int, float],
    groups: set[int] | frozenset[int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "joint"]:
    """One of the poses of some groups, the base of an arm turned anywhere."""
    if not groups or not groups <= GROUPS:
        raise ValueError(
            f"groups are {sorted(groups)}; give some of 1 to {len(GROUPS)}"
        )
    asked = [group for group in groups_meant(world, groups) if len(poses[group])]
    if not asked:
        raise ValueError(f"no such pose in groups {sorted(groups)}; allow more groups")
    weights = np.array([shares[group] for group in asked])
    group = asked[int(rng.choice(len(asked), p=weights / weights.sum()))]
    q = poses[group][rng.integers(len(poses[group]))].copy()
    if not is_grouped(world):
        return q
    base = world.mounted.robot.joint_names[0]
    low, high = np.deg2rad(world.constants.array(f"robot.range.{base}"))
    q[0] = rng.uniform(low, high)
    return q
