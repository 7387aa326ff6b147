"""Poses in which patches of two links meet that can also be far apart."""

from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.people.hand import MM
from eskin.sim.people.person import Person
from eskin.sim.robot.free import acceptable, limits
from eskin.sim.robot.pool import pool_of
from eskin.sim.robot.pose import draw_pose
from eskin.sim.robot.world import World
from eskin.sim.site.fold import fold_sites, gap_of, points_in_world
from eskin.sim.site.folding import faces_of, facing
from eskin.sim.site.site import Site

ELBOW = "elbow_joint"

Sites = tuple[Site, Site]
Pose = Float[np.ndarray, "joint"]


def draw_meeting(
    world: World,
    groups: frozenset[int],
    person: Person,
    rng: np.random.Generator,
) -> tuple[Pose, Pose, Sites]:
    """A pose in which two places meet, one in which they are far apart, and both.

    Args:
        world: the robot.
        groups: of poses, to take the one from in which they are apart.
        person: who touches.
        rng: to draw from.

    Raises:
        ValueError: no such poses were found.
    """
    value = world.constants.value
    near, far = value("pairs.near") * MM, value("pairs.far") * MM
    poses = meeting_poses(world)
    tries = int(value("pairs.tries")) if len(poses) else 0
    for _ in range(tries):
        folded = poses[rng.integers(len(poses))].copy()
        folded[0] = rng.uniform(*(each[0] for each in limits(world)))
        apart = draw_pose(world, groups, rng)
        found = [
            sites
            for sites in fold_sites(world, folded, person)
            if gap_of(world, folded, *sites) <= near
            and gap_of(world, apart, *sites) >= far
        ]
        if found:
            return folded, apart, found[rng.integers(len(found))]
    raise ValueError(
        f"no poses found that bring patches of robot '{world.mounted.robot.name}' "
        f"within {near} m of each other and {far} m apart; take a skin on a longer arm"
    )


@lru_cache(maxsize=2)
def meeting_poses(world: World) -> Float[np.ndarray, "pose joint"]:
    """Poses with the elbow bent as far as it goes, in which such patches meet.

    Always the same ones. Poses as others are drawn hardly ever bend it so far.
    """
    value, elbow = world.constants.value, world.joint(ELBOW)
    rng = np.random.default_rng(int(value("robot.pool_seed")))
    low, high = limits(world)
    count = int(value("pairs.pool"))
    q = rng.uniform(low, high, (count, len(low)))
    bent = np.deg2rad(world.constants.array("pairs.elbow"))
    q[:, elbow] = rng.uniform(bent[0], bent[1], count) * rng.choice([-1, 1], count)
    q = q[acceptable(world, q)]
    gaps, _ = facing(world, world.poses(q))
    gaps = gaps[:, partable(world)]
    return q[gaps.min(axis=1, initial=np.inf) <= value("pairs.near") * MM]


def partable(world: World) -> Bool[np.ndarray, "pair"]:
    """Which pairs of charts are far apart in some pose, middle from middle."""
    faces = faces_of(world)
    charts = np.arange(len(world.charts))
    widest = np.zeros(len(faces.pairs))
    for q in np.concatenate(list(pool_of(world).any.values())):
        middles = points_in_world(world, charts, faces.balls[:, :3], world.poses(q))
        one, other = middles[faces.pairs[:, 0]], middles[faces.pairs[:, 1]]
        widest = np.maximum(widest, np.linalg.norm(one - other, axis=1))
    return widest >= world.constants.value("pairs.far") * MM
