"""This module tells which poses are valid, and where links press on each other."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.robot import Robot
from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactSite
from eskin.sim.scene.environment import SimEnvironment, build_site
from eskin.sim.scene.folds import sample_patches
from eskin.sim.scene.kernels import compute_point_distances

CM2 = 1e-4


def compute_joint_limits(
    env: SimEnvironment,
) -> tuple[Float[np.ndarray, "joint"], Float[np.ndarray, "joint"]]:
    """Return the least and greatest joint values that poses are drawn from.

    Joints of an arm like the UR5 have ranges of their own; those of other robots are
    near 0, as far as their limits permit.

    Returns:
        Values of each joint [rad], or [m] of a prismatic one.
    """
    robot = env.mounted.robot
    if not has_ranges(env):
        rest = np.clip(0.0, robot.lower, robot.upper)
        kinds = [joint.kind for joint in robot.actuated_joints]
        spread = "robot.spread" if env.is_arm else "robot.spread_legs"
        turn = np.deg2rad(env.constants.value(spread))
        slide = env.constants.value("robot.slide") * MM
        most = np.where(np.array(kinds) == "prismatic", slide, turn)
        return np.maximum(rest - most, robot.lower), np.minimum(
            rest + most, robot.upper
        )
    ranges = [
        np.deg2rad(env.constants.array(f"robot.range.{name}"))
        for name in robot.joint_names
    ]
    low, high = np.array(ranges).T
    return low, high


def has_ranges(env: SimEnvironment) -> bool:
    """Tell whether the constants have a range for every joint, as for a UR5."""
    names = env.mounted.robot.joint_names
    return all(f"robot.range.{name}" in env.constants.entries for name in names)


def are_poses_valid(
    env: SimEnvironment, q: Float[np.ndarray, "pose joint"]
) -> Bool[np.ndarray, "pose"]:
    """Tell which poses are free of collisions and let people reach some skin."""
    T = env.poses(q)
    good = are_collision_free(env, T)
    good[good] = is_skin_reachable(env, T[good])
    return good


def are_collision_free(
    env: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Tell in which poses links keep clear of each other and of the table."""
    value = env.constants.value
    least = value("robot.clearance") * MM
    low = value("robot.table_clearance") * MM
    gap, height = env.collision.compute_clearance(T_world_link, least).T
    return (gap >= least) & (height >= low) & is_tool_above_table(env, T_world_link)


def is_tool_above_table(
    env: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Tell in which poses the last link is high enough above the table for a tool."""
    if not has_ranges(env):
        return np.ones(len(T_world_link), dtype=bool)
    least = env.constants.value("robot.tool_height")
    return T_world_link[:, find_tool(env.mounted.robot), 2, 3] >= least


def find_tool(robot: Robot) -> int:
    """Find the last of the links that most joints lie before."""
    depth = dict.fromkeys(robot.link_names, 0)
    parent_of = {joint.child: joint.parent for joint in robot.joints}
    for name in robot.link_names:
        link = name
        while link in parent_of:
            depth[name] = depth[name] + 1
            link = parent_of[link]
    deepest = max(depth.values())
    return max(i for i, name in enumerate(robot.link_names) if depth[name] == deepest)


def is_skin_reachable(
    env: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Tell in which poses people of average size reach enough skin."""
    low, high = env.constants.array("place.height")
    table = env.base_height
    samples = sample_patches(env)
    up = T_world_link[:, samples.links, 2]
    points = np.split(samples.points, samples.starts[1:-1])
    rises = [up[:, i, :3] @ each.T + up[:, i, 3:] for i, each in enumerate(points)]
    height = table + np.concatenate(rises, axis=1)
    within = (height >= low) & (height <= high)
    least = env.constants.value("robot.reachable") * CM2
    return within @ samples.areas >= least


BENT_JOINTS = ("elbow_joint", "wrist_1_joint", "wrist_2_joint")
"""Joints that are bent until links nearly touch."""
BISECTIONS = 12


def find_self_contact_sites(
    env: SimEnvironment, q: Float[np.ndarray, "joint"]
) -> tuple[ContactSite, ...]:
    """Find the sites where another link is so close that it presses.

    The angle of such a site is along the other link.
    """
    T_world_link = env.poses(q)
    cylinders = env.collision.cylinders
    found = []
    for chart in range(len(env.charts)):
        gaps, nearest = find_self_pressed_taxels(env, chart, T_world_link)
        taxels = np.flatnonzero(nearest >= 0)
        for cylinder in np.unique(nearest[taxels]):
            strip = taxels[nearest[taxels] == cylinder]
            taxel = strip[np.argmin(gaps[strip])]
            R = T_world_link[cylinders.links[cylinder], :3, :3]
            along = R @ cylinders.axes[cylinder]
            centre = env.charts[chart].unrolled[env.charts[chart].own[taxel]]
            found.append(build_site(env, chart, centre, along, T_world_link))
    return tuple(found)


def find_self_pressed_taxels(
    env: SimEnvironment, chart: int, T_world_link: Float[np.ndarray, "link 4 4"]
) -> tuple[Float[np.ndarray, "part"], Int[np.ndarray, "part"]]:
    """Return each own taxel's distance to other links [m], and the nearest cylinder.

    The cylinder is -1 where none is close enough to press.
    """
    link = env.links[chart]
    here = env.charts[chart]
    local = env.mounted.skin.positions[here.taxels[here.own]]
    T = T_world_link[link]
    points = local @ T[:3, :3].T + T[:3, 3]
    others = env.collision.unjoined[link]
    gaps, cylinders = compute_point_distances(
        env.collision.cylinders, T_world_link, points, others
    )
    near = gaps < env.constants.value("fold.contact") * MM
    return gaps, np.where(near, cylinders, -1)


def bend_until_self_contact(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    most: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "_ joint"]:
    """Bend one joint of each pose until a link nearly touches a patch of another."""
    names = [name for name in BENT_JOINTS if name in env.mounted.robot.joint_names]
    if not names:
        return q[:0]
    joints = np.array([env.joint_index(name) for name in names])
    chosen = joints[rng.integers(len(joints), size=len(q))]
    signs = rng.choice([-1.0, 1.0], len(q))
    found = [
        pose
        for pose in bend_joints(env, q, chosen, signs)
        if is_clear_of_table(env, pose[None]) and find_self_contact_sites(env, pose)
    ]
    return np.array(found[:most]).reshape(-1, q.shape[1])


def bend_joints(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    joints: Int[np.ndarray, "pose"],
    signs: Float[np.ndarray, "pose"],
) -> Float[np.ndarray, "_ joint"]:
    """Turn a joint of each pose until links are as close as `fold.touching`.

    Poses in which links never get so close are left out.
    """
    low, high = env.constants.array("fold.touching") * MM
    step, farthest = env.constants.array("fold.bend")
    turns = np.arange(0.0, farthest, step)
    gaps = [
        compute_link_gaps(env, turn_joints(q, joints, turn * signs), high)
        for turn in turns
    ]
    close = np.stack(gaps, axis=1) < low
    hits = np.flatnonzero(close.any(axis=1) & ~close[:, 0])
    q = q[hits]
    joints = joints[hits]
    signs = signs[hits]
    hit = turns[np.argmax(close[hits], axis=1)] * signs
    away = hit - step * signs
    for _ in range(BISECTIONS):
        middle = (away + hit) / 2
        gap = compute_link_gaps(env, turn_joints(q, joints, middle), high)
        apart = gap >= (low + high) / 2
        away = np.where(apart, middle, away)
        hit = np.where(apart, hit, middle)
    bent = turn_joints(q, joints, away)
    gap = compute_link_gaps(env, bent, 2 * high)
    return bent[(gap >= low) & (gap <= high)]


def turn_joints(
    q: Float[np.ndarray, "pose joint"],
    joints: Int[np.ndarray, "pose"],
    turns: Float[np.ndarray, "pose"],
) -> Float[np.ndarray, "pose joint"]:
    """Return each pose with one joint turned further [rad]."""
    moved = q.copy()
    moved[np.arange(len(q)), joints] += turns
    return moved


def compute_link_gaps(
    env: SimEnvironment, q: Float[np.ndarray, "pose joint"], exact_within: float
) -> Float[np.ndarray, "pose"]:
    """Return the least distance of links [m], a lower bound beyond `exact_within`."""
    return env.collision.compute_clearance(env.poses(q), exact_within)[:, 0]


def is_clear_of_table(env: SimEnvironment, q: Float[np.ndarray, "pose joint"]) -> bool:
    """Tell whether poses keep clear of the table and within their joint limits."""
    T = env.poses(q)
    height = env.collision.compute_clearance(T, 0.0)[:, 1]
    clear = height >= env.constants.value("robot.table_clearance") * MM
    low, high = compute_joint_limits(env)
    within = np.all((q >= low) & (q <= high), axis=1)
    return bool(np.all(clear & is_tool_above_table(env, T) & within))
