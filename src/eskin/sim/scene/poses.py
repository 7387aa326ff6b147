"""This module draws valid poses of the robot.

Similar poses form groups, so that whole groups can be held out for testing. The groups
are defined for arms like the UR5. All poses of another robot are in one group, which
stands for every group that is requested.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import MM
from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.folds import find_folded_poses
from eskin.sim.scene.validity import (
    are_poses_valid,
    bend_until_self_contact,
    compute_joint_limits,
    has_ranges,
)
from eskin.transforms import apply, rotate

POSE_GROUPS = frozenset(range(1, 13))
"""All groups. The forearm is level in 1-4, rises in 5-8 and hangs in 9-12."""

UNGROUPED = 0
"""Group of all poses of a robot that is not such an arm."""

FOREARM = "forearm_link"
LIFT = "shoulder_lift_joint"
ELBOW = "elbow_joint"
FIRST_GROUPS = np.array([9, 1, 5])
"""First group of a forearm that hangs, is level or rises."""


def has_pose_groups(env: SimEnvironment) -> bool:
    """Tell whether the robot is an arm like the UR5, whose poses have groups."""
    robot = env.mounted.robot
    has_joints = {LIFT, ELBOW} <= set(robot.joint_names) and has_ranges(env)
    return FOREARM in robot.link_names and has_joints


def resolve_groups(env: SimEnvironment, requested: Collection[int]) -> list[int]:
    """Return the groups of this robot that stand for the requested ones."""
    return sorted(requested) if has_pose_groups(env) else [UNGROUPED]


def compute_pose_group(env: SimEnvironment, q: Float[np.ndarray, "joint"]) -> int:
    """Return the group of a pose: 1 to 12, or `UNGROUPED`."""
    return int(compute_pose_groups(env, q[None], env.poses(q[None]))[0])


def compute_pose_groups(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
) -> Int[np.ndarray, "pose"]:
    """Return the group of each pose, by forearm slope, shoulder lift and elbow angle.

    The angle of the base does not matter.
    """
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
"""Poses that are checked at a time."""


@dataclass(frozen=True, eq=False)
class PosePool:
    """A pose pool holds poses found in advance, so that drawing one is cheap."""

    any: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses of each group, without further condition."""
    folded: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses in which patches of different links face each other closely."""
    touching: dict[int, Float[np.ndarray, "_ joint"]]
    """Poses in which a link nearly touches a patch of another link."""
    shares: dict[int, float]
    """Share of each group among all poses."""
    folded_shares: dict[int, float]
    """Share of each group among all folded poses."""


@lru_cache(maxsize=4)
def build_pose_pool(env: SimEnvironment) -> PosePool:
    """Build the pose pool of an environment, the same every time.

    Fig. 9 of Jiang et al. 2025 shows such random poses, in which the robot stands.
    """
    rng = np.random.default_rng(int(env.constants.value("robot.pool_seed")))
    q = draw_valid_poses(env, rng)
    group = compute_pose_groups(env, q, env.poses(q))
    any_count, folded_count, touching_count = (
        int(count) for count in env.constants.array("robot.pool")
    )
    folded = find_folded_poses(env, q)
    q_folded = q[folded]
    folded_group = group[folded]
    touching, touching_group = draw_touching_poses(env, q, group, touching_count, rng)
    every = resolve_groups(env, POSE_GROUPS)

    def compute_shares(group: Int[np.ndarray, "pose"]) -> dict[int, float]:
        total = max(1, len(group))
        return {g: float(np.count_nonzero(group == g) / total) for g in every}

    return PosePool(
        any={g: q[group == g][:any_count] for g in every},
        folded={g: q_folded[folded_group == g][:folded_count] for g in every},
        touching={g: touching[touching_group == g][:touching_count] for g in every},
        shares=compute_shares(group),
        folded_shares=compute_shares(folded_group),
    )


def draw_valid_poses(
    env: SimEnvironment, rng: np.random.Generator
) -> Float[np.ndarray, "pose joint"]:
    """Draw valid poses uniformly; a robot without joints has one pose."""
    if not env.can_move:
        return np.zeros((1, 0))
    low, high = compute_joint_limits(env)
    count = int(env.constants.value("robot.pool_tries"))
    if has_ranges(env):
        q = rng.uniform(low, high, (count, len(low)))
    else:
        # All are in one group. Where many joints are far from 0, links collide.
        count = count // len(POSE_GROUPS)
        rest = np.clip(0.0, low, high)
        share = rng.uniform(0.0, 1.0, (count, 1))
        q = rest + share * (rng.uniform(low, high, (count, len(low))) - rest)
    chunks = (q[i : i + CHUNK] for i in range(0, count, CHUNK))
    valid = np.concatenate([chunk[are_poses_valid(env, chunk)] for chunk in chunks])
    return (
        valid if has_ranges(env) else valid[: int(env.constants.array("robot.pool")[0])]
    )


def draw_touching_poses(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    group: Int[np.ndarray, "pose"],
    max_count: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "_ joint"], Int[np.ndarray, "_"]]:
    """Bend poses until a link nearly touches another's patch; return their groups."""
    tries = int(env.constants.value("robot.pool_bent"))
    bent = np.concatenate(
        [
            bend_until_self_contact(env, q[group == each][:tries], max_count, rng)
            for each in resolve_groups(env, POSE_GROUPS)
        ]
    )
    return bent, compute_pose_groups(env, bent, env.poses(bent))


def can_fold(env: SimEnvironment, groups: frozenset[int]) -> bool:
    """Tell whether patches of two links face each other in a pose of some groups."""
    poses = build_pose_pool(env).folded
    return any(len(poses[group]) for group in resolve_groups(env, groups))


def can_touch_itself(env: SimEnvironment, groups: frozenset[int]) -> bool:
    """Tell whether links nearly touch each other in a pose of some groups."""
    poses = build_pose_pool(env).touching
    return any(len(poses[group]) for group in resolve_groups(env, groups))


def draw_pose(
    env: SimEnvironment,
    groups: set[int] | frozenset[int],
    rng: np.random.Generator,
    fold: bool = False,
) -> Float[np.ndarray, "joint"]:
    """Draw a pose of some groups [rad], each group weighted by its share of poses.

    The base joint affects no condition on poses and is drawn anew. `groups` are some of
    `POSE_GROUPS`; with `fold`, patches of different links must face each other closely.

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
    """Draw a pose in which a link nearly touches a patch of another [rad].

    Raises:
        ValueError: there is no such group, or no such pose in any of them.
    """
    touching = build_pose_pool(env).touching
    shares = {group: float(len(q)) for group, q in touching.items()}
    return draw_from_groups(env, touching, shares, groups, rng)


def draw_from_groups(
    env: SimEnvironment,
    poses: dict[int, Float[np.ndarray, "_ joint"]],
    shares: dict[int, float],
    groups: set[int] | frozenset[int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "joint"]:
    """Draw one of the poses of some groups, with the base joint of an arm at random."""
    if not groups or not groups <= POSE_GROUPS:
        raise ValueError(
            f"groups are {sorted(groups)}; give some of 1 to {len(POSE_GROUPS)}"
        )
    allowed = [group for group in resolve_groups(env, groups) if len(poses[group])]
    if not allowed:
        raise ValueError(f"no such pose in groups {sorted(groups)}; allow more groups")
    weights = np.array([shares[group] for group in allowed])
    group = allowed[int(rng.choice(len(allowed), p=weights / weights.sum()))]
    q = poses[group][rng.integers(len(poses[group]))].copy()
    if not has_pose_groups(env):
        return q
    base = env.mounted.robot.joint_names[0]
    low, high = np.deg2rad(env.constants.array(f"robot.range.{base}"))
    q[0] = rng.uniform(low, high)
    return q


UNTOUCHED_POSES = 8
UNTOUCHED_TARGETS = 24
"""Number of poses, and of targets of each link, by which untouched links are found."""


def find_untouched_links(env: SimEnvironment) -> tuple[str, ...]:
    """Find the links with skin that nobody touches, in the order of the robot.

    In some poses of the pool every target of such a link, of those that are tried, is
    too high or too low for people of average size, or has no room for a finger.
    """
    value = env.constants.value
    table = env.base_height
    low, high = env.constants.array("place.height") - table
    room = value("place.room") * MM / 2
    rng = np.random.default_rng(0)
    (poses, *_) = build_pose_pool(env).any.values()
    links = np.array(env.links)[env.targets.chart]
    untouched = {int(link) for link in links}
    for T in env.poses(poses[:UNTOUCHED_POSES]):
        for link in tuple(untouched):
            targets = rng.permutation(np.flatnonzero(links == link))
            targets = targets[:UNTOUCHED_TARGETS]
            p_world = apply(T[link], env.targets.positions[targets])
            n_world = rotate(T[link], env.targets.normals[targets])
            reached = (p_world[:, 2] >= low) & (p_world[:, 2] <= high)
            away = env.collision.compute_free_distance(
                T, p_world + room * n_world, link
            )
            if np.any(reached & (away >= room)):
                untouched.discard(link)
    return tuple(env.mounted.robot.link_names[link] for link in sorted(untouched))
