"""This module decides which poses are valid, and where links of the robot touch its own skin."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactSite
from eskin.sim.scene.environment import SimEnvironment, build_site
from eskin.sim.scene.folds import sample_patches
from eskin.sim.scene.kernels import compute_point_distances

CM2 = 1e-4


def compute_joint_limits(
    world: SimEnvironment,
) -> tuple[Float[np.ndarray, "joint"], Float[np.ndarray, "joint"]]:
    """Least and greatest joint values that poses are drawn from [rad]."""
    ranges = [
        np.deg2rad(world.constants.array(f"robot.range.{name}"))
        for name in world.mounted.robot.joint_names
    ]
    low, high = np.array(ranges).T
    return low, high


def are_poses_valid(
    world: SimEnvironment, q: Float[np.ndarray, "pose joint"]
) -> Bool[np.ndarray, "pose"]:
    """Whether nothing collides and some skin is where people reach."""
    T = world.poses(q)
    good = are_collision_free(world, T)
    good[good] = is_skin_reachable(world, T[good])
    return good


def are_collision_free(
    world: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Whether links keep clear of each other and of the table."""
    value = world.constants.value
    least, low = value("robot.clearance") * MM, value("robot.table_clearance") * MM
    gap, height = world.collision.compute_clearance(T_world_link, least).T
    return (gap >= least) & (height >= low) & is_tool_above_table(world, T_world_link)


def is_tool_above_table(
    world: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Whether the last link is above the table as far as tools need."""
    least = world.constants.value("robot.tool_height")
    return T_world_link[:, -1, 2, 3] >= least


def is_skin_reachable(
    world: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> Bool[np.ndarray, "pose"]:
    """Whether enough skin is at a height that people of average size reach."""
    low, high = world.constants.array("place.height")
    table = world.constants.value("robot.table")
    faces = sample_patches(world)
    up = T_world_link[:, faces.links, 2]
    points = np.split(faces.points, faces.starts[1:-1])
    rises = [up[:, i, :3] @ each.T + up[:, i, 3:] for i, each in enumerate(points)]
    height = table + np.concatenate(rises, axis=1)
    within = (height >= low) & (height <= high)
    least = world.constants.value("robot.reachable") * CM2
    return within @ faces.areas >= least


BENT_JOINTS = ("elbow_joint", "wrist_1_joint", "wrist_2_joint")
"""Joints that are bent until links meet."""
BISECTIONS = 12


def find_self_contact_sites(
    world: SimEnvironment, q: Float[np.ndarray, "joint"]
) -> tuple[ContactSite, ...]:
    """Places where another link is so close that it presses, in strips.

    The angle of such a site is that of the strip: along the other link.
    """
    T_world_link = world.poses(q)
    found = []
    for chart in range(len(world.charts)):
        gaps, rods = find_self_pressed_taxels(world, chart, T_world_link)
        taxels = np.flatnonzero(rods >= 0)
        for rod in np.unique(rods[taxels]):
            strip = taxels[rods[taxels] == rod]
            nearest = int(strip[np.argmin(gaps[strip])])
            found.append(
                build_self_contact_site(world, chart, nearest, int(rod), T_world_link)
            )
    return tuple(found)


def find_self_pressed_taxels(
    world: SimEnvironment, chart: int, T_world_link: Float[np.ndarray, "link 4 4"]
) -> tuple[Float[np.ndarray, "part"], Int[np.ndarray, "part"]]:
    """Distance of each taxel of a chart to other links [m], and the rod that presses.

    The rod is -1 where none is close enough.
    """
    link = world.links[chart]
    local = world.mounted.skin.positions[world.charts[chart].taxels]
    T = T_world_link[link]
    points = local @ T[:3, :3].T + T[:3, 3]
    others = world.collision.unjoined[link]
    gaps, rods = compute_point_distances(
        world.collision.cylinders, T_world_link, points, others
    )
    near = gaps < world.constants.value("fold.contact") * MM
    return gaps, np.where(near, rods, -1)


def build_self_contact_site(
    world: SimEnvironment,
    chart: int,
    taxel: int,
    rod: int,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> ContactSite:
    """The place of a taxel, its angle along the rod that presses there."""
    rods = world.collision.cylinders
    along = T_world_link[rods.links[rod], :3, :3] @ rods.axes[rod]
    centre = world.charts[chart].unrolled[taxel]
    return build_site(world, chart, centre, along, T_world_link)


def bend_until_self_contact(
    world: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    most: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "_ joint"]:
    """Bend poses, one joint each, until a link all but touches a patch of another."""
    names = [name for name in BENT_JOINTS if name in world.mounted.robot.joint_names]
    if not names:
        return q[:0]
    joints = np.array([world.joint_index(name) for name in names])
    chosen = joints[rng.integers(len(joints), size=len(q))]
    ways = rng.choice([-1.0, 1.0], len(q))
    bent = [
        pose
        for pose in bend_joints(world, q, chosen, ways)
        if is_clear_of_table(world, pose[None])
    ]
    found = [pose for pose in bent if find_self_contact_sites(world, pose)]
    return np.array(found[:most]).reshape(-1, q.shape[1])


def bend_joints(
    world: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    joints: Int[np.ndarray, "pose"],
    ways: Float[np.ndarray, "pose"],
) -> Float[np.ndarray, "_ joint"]:
    """Turn a joint of each pose until links are as close as `fold.touching`.

    Poses in which they never come so close are left out.
    """
    low, high = world.constants.array("fold.touching") * MM
    step, farthest = world.constants.array("fold.bend")
    turns = np.arange(0.0, farthest, step)
    gaps = [
        compute_link_gaps(world, turn_joints(q, joints, turn * ways), high)
        for turn in turns
    ]
    close = np.stack(gaps, axis=1) < low
    hits = np.flatnonzero(close.any(axis=1) & ~close[:, 0])
    q, joints, ways = q[hits], joints[hits], ways[hits]
    hit = turns[np.argmax(close[hits], axis=1)] * ways
    away = hit - step * ways
    for _ in range(BISECTIONS):
        middle = (away + hit) / 2
        apart = (
            compute_link_gaps(world, turn_joints(q, joints, middle), high)
            >= (low + high) / 2
        )
        away, hit = np.where(apart, middle, away), np.where(apart, hit, middle)
    bent = turn_joints(q, joints, away)
    gap = compute_link_gaps(world, bent, 2 * high)
    return bent[(gap >= low) & (gap <= high)]


def turn_joints(
    q: Float[np.ndarray, "pose joint"],
    joints: Int[np.ndarray, "pose"],
    turns: Float[np.ndarray, "pose"],
) -> Float[np.ndarray, "pose joint"]:
    """Each pose with one joint turned on [rad]."""
    moved = q.copy()
    moved[np.arange(len(q)), joints] += turns
    return moved


def compute_link_gaps(
    world: SimEnvironment, q: Float[np.ndarray, "pose joint"], enough: float
) -> Float[np.ndarray, "pose"]:
    """Least distance of links [m], known only up to `enough`."""
    return world.collision.compute_clearance(world.poses(q), enough)[:, 0]


def is_clear_of_table(
    world: SimEnvironment, q: Float[np.ndarray, "pose joint"]
) -> bool:
    """Whether a pose keeps clear of the table, with its joints within their limits."""
    T = world.poses(q)
    height = world.collision.compute_clearance(T, 0.0)[:, 1]
    clear = height >= world.constants.value("robot.table_clearance") * MM
    low, high = compute_joint_limits(world)
    within = np.all((q >= low) & (q <= high), axis=1)
    return bool(np.all(clear & is_tool_above_table(world, T) & within))
