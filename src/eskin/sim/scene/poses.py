"""This module draws poses of the robot among those that it would take."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.scene.environment import World
from eskin.sim.scene.folds import folds_at
from eskin.sim.scene.validity import acceptable, limits, touch_links

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
