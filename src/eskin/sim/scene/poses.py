"""This module draws poses of the robot among those that it would take.

Poses that are alike form groups, so that whole groups can be kept for tests. They are
those of an arm like the UR5. All poses of another robot are in one group of their own,
which stands for every group that is asked for.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.folds import find_folded_poses
from eskin.sim.scene.validity import (
    are_poses_valid,
    bend_until_self_contact,
    compute_joint_limits,
)

POSE_GROUPS = frozenset(range(1, 13))
"""All groups. The forearm is level in 1-4, rises in 5-8 and hangs in 9-12."""

UNGROUPED = 0
"""Group of all poses of a robot that is no such arm."""

FOREARM, LIFT, ELBOW = "forearm_link", "shoulder_lift_joint", "elbow_joint"
FIRST_GROUPS = np.array([9, 1, 5])
"""First group of a forearm that hangs, is level, rises."""


def has_pose_groups(env: SimEnvironment) -> bool:
    """Tell whether the robot is an arm whose poses come in groups."""
    robot = env.mounted.robot
    return FOREARM in robot.link_names and {LIFT, ELBOW} <= set(robot.joint_names)


def resolve_groups(env: SimEnvironment, asked: Collection[int]) -> list[int]:
    """Return the groups of this robot that stand for those asked for."""
    return sorted(asked) if has_pose_groups(env) else [UNGROUPED]


def compute_pose_group(env: SimEnvironment, q: Float[np.ndarray, "joint"]) -> int:
    """Return the group of a pose, 1 to 12 or `UNGROUPED`, whatever the base's turn."""
    return int(compute_pose_groups(env, q[None], env.poses(q[None]))[0])


def compute_pose_groups(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
) -> Int[np.ndarray, "pose"]:
    """Return the group of each pose by slope of the forearm, lift and elbow's bend."""
    if not has_pose_groups(env):
        return np.full(len(q), UNGROUPED, dtype=np.int64)
    forearm = env.mounted.robot.link_index(FOREARM)
    rise = np.arcsin(np.clip(T_world_link[:, forearm, 2, 2], -1.0, 1.0))
    band = np.digitize(rise, np.deg2rad(env.constants.array("robot.slope")))
    lift = np.rad2deg(q[:, env.joint_index(LIFT)])
    elbow = np.rad2deg(q[:, env.joint_index(ELBOW)])
    backward = lift < env.constants.value("robot.upright")
    bent = np.abs(elbow) > env.constants.value("robot.bent")
    return FIRST_GROUPS[band] + 2 * backward.astype(np.int64) + bent


CHUNK = 2048


@dataclass(frozen=True, eq=False)
class PosePool:
    """A pose pool holds poses found in advance, so that drawing one costs nothing."""

    any: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses of each group without further condition."""
    folded: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses in which patches of different links face each other closely."""
    touching: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses in which a link all but touches a patch of another."""
    shares: dict[int, float]
    """Share of each group among all poses."""
    folded_shares: dict[int, float]
    """Share of each group among all folded poses."""


@lru_cache(maxsize=4)
def build_pose_pool(env: SimEnvironment) -> PosePool:
    """Build the poses of an environment: always the same ones."""
    rng = np.random.default_rng(int(env.constants.value("robot.pool_seed")))
    q = draw_valid_poses(env, rng)
    group = compute_pose_groups(env, q, env.poses(q))
    any_count, folded_count, touching_count = (
        int(count) for count in env.constants.array("robot.pool")
    )
    folded = find_folded_poses(env, q)
    touching, touching_group = draw_touching_poses(env, q, group, touching_count, rng)
    return PosePool(
        any=sort_by_group(env, q, group, any_count),
        folded=sort_by_group(env, q[folded], group[folded], folded_count),
        touching=sort_by_group(env, touching, touching_group, touching_count),
        shares=compute_group_shares(env, group),
        folded_shares=compute_group_shares(env, group[folded]),
    )


def sort_by_group(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    group: Int[np.ndarray, "pose"],
    most: int,
) -> dict[int, Float[np.ndarray, "_ joint"]]:
    """Return the first poses of each group."""
    return {each: q[group == each][:most] for each in resolve_groups(env, POSE_GROUPS)}


def compute_group_shares(
    env: SimEnvironment, group: Int[np.ndarray, "pose"]
) -> dict[int, float]:
    """Return the share of each group among some poses."""
    total = max(1, len(group))
    return {
        each: float(np.count_nonzero(group == each) / total)
        for each in resolve_groups(env, POSE_GROUPS)
    }


def draw_valid_poses(
    env: SimEnvironment, rng: np.random.Generator
) -> Float[np.ndarray, "pose joint"]:
    """Draw poses evenly among those that a robot would take and people can reach.

    A robot without joints takes the one pose it has.
    """
    if not env.can_move:
        return np.zeros((1, 0))
    low, high = compute_joint_limits(env)
    tries = int(env.constants.value("robot.pool_tries"))
    q = rng.uniform(low, high, (tries, len(low)))
    chunks = (q[i : i + CHUNK] for i in range(0, tries, CHUNK))
    return np.concatenate([chunk[are_poses_valid(env, chunk)] for chunk in chunks])


def draw_touching_poses(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    group: Int[np.ndarray, "pose"],
    most: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "_ joint"], Int[np.ndarray, "_"]]:
    """Bend poses until a link all but touches another's patch; return their groups."""
    tries = int(env.constants.value("robot.pool_bent"))
    found = [
        bend_until_self_contact(env, q[group == each][:tries], most, rng)
        for each in resolve_groups(env, POSE_GROUPS)
    ]
    bent = np.concatenate(found)
    return bent, compute_pose_groups(env, bent, env.poses(bent))


def can_fold(env: SimEnvironment, groups: frozenset[int]) -> bool:
    """Tell whether patches of two links face each other in a pose of some groups."""
    poses = build_pose_pool(env).folded
    return any(len(poses.get(group, ())) for group in resolve_groups(env, groups))


def can_touch_itself(env: SimEnvironment, groups: frozenset[int]) -> bool:
    """Tell whether a link all but touches another's patch in a pose of some groups."""
    poses = build_pose_pool(env).touching
    return any(len(poses.get(group, ())) for group in resolve_groups(env, groups))


def draw_pose(
    env: SimEnvironment,
    groups: set[int] | frozenset[int],
    rng: np.random.Generator,
    fold: bool = False,
) -> Float[np.ndarray, "joint"]:
    """Draw a pose of some groups, as often as such poses are [rad].

    The base affects none of the conditions on poses and is drawn anew.

    Args:
        env: robot in its skin.
        groups: some of `POSE_GROUPS`.
        rng: random generator.
        fold: whether patches of different links must face each other closely.

    Raises:
        ValueError: there is no such group, or no such pose in any of them.
    """
    pool = build_pose_pool(env)
    poses = pool.folded if fold else pool.any
    shares = pool.folded_shares if fold else pool.shares
    return draw_from_groups(env, poses, shares, groups, rng)


def draw_touching_pose(
    env: SimEnvironment, groups: set[int] | frozenset[int], rng: np.random.Generator
) -> Float[np.ndarray, "joint"]:
    """Draw a pose in which a link all but touches a patch of another [rad].

    Raises:
        ValueError: there is no such group, or no such pose in any of them.
    """
    pool: PosePool = build_pose_pool(env)
    shares = {group: float(len(q)) for group, q in pool.touching.items()}
    return draw_from_groups(env, pool.touching, shares, groups, rng)


def draw_from_groups(
    env: SimEnvironment,
    poses: dict[int, Float[np.ndarray, "_ joint"]],
    shares: dict[int, float],
    groups: set[int] | frozenset[int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "joint"]:
    """Draw one of the poses of some groups, the base of an arm turned anywhere."""
    if not groups or not groups <= POSE_GROUPS:
        raise ValueError(
            f"groups are {sorted(groups)}; give some of 1 to {len(POSE_GROUPS)}"
        )
    asked = [group for group in resolve_groups(env, groups) if len(poses[group])]
    if not asked:
        raise ValueError(f"no such pose in groups {sorted(groups)}; allow more groups")
    weights = np.array([shares[group] for group in asked])
    group = asked[int(rng.choice(len(asked), p=weights / weights.sum()))]
    q = poses[group][rng.integers(len(poses[group]))].copy()
    if not has_pose_groups(env):
        return q
    base = env.mounted.robot.joint_names[0]
    low, high = np.deg2rad(env.constants.array(f"robot.range.{base}"))
    q[0] = rng.uniform(low, high)
    return q
