"""A robot in its skin and people about it, for tests; its pool of poses is small."""

from functools import lru_cache

import numpy as np

from eskin.robot import load_robot
from eskin.sim.constants import load_constants
from eskin.sim.people.person import draw_person
from eskin.sim.scene import build_environment
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.skin import MountedSkin
from eskin.skin.presets import build_ur5_skin

EVERY = POSE_GROUPS


@lru_cache(maxsize=1)
def world():
    small = {"robot.pool_tries": 1 / 8, "robot.pool_bent": 1 / 8}
    constants = load_constants().scaled(small)
    return build_environment(
        MountedSkin(build_ur5_skin(), load_robot("ur5")), constants
    )


def people(count, seed=0):
    rng = np.random.default_rng(seed)
    return [draw_person(f"p{i}", world().constants, rng) for i in range(count)]


def poses(count, seed=0, **options):
    rng = np.random.default_rng(seed)
    return np.array([draw_pose(world(), EVERY, rng, **options) for _ in range(count)])


def surface_points(link, spacing=0.012):
    """Points on all cylinders of a link, in its frame."""
    found = []
    for body in link.geoms:
        radius, half = body.shape.radius, body.shape.length / 2
        around = np.arange(0, 2 * np.pi, spacing / radius)
        heights = np.linspace(-half, half, int(2 * half / spacing) + 2)
        turn, z = (grid.ravel() for grid in np.meshgrid(around, heights))
        rings = [np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])]
        for inner in np.arange(spacing, radius, spacing):
            turn = np.arange(0, 2 * np.pi, spacing / inner)
            flat = np.column_stack([inner * np.cos(turn), inner * np.sin(turn)])
            rings += [
                np.column_stack([flat, np.full(len(flat), z)]) for z in (-half, half)
            ]
        local = np.concatenate(rings)
        found.append(local @ body.T_link_shape[:3, :3].T + body.T_link_shape[:3, 3])
    return np.concatenate(found)
