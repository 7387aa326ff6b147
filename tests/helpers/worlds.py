"""These helpers build a robot in its skin with a small pool of poses, and people."""

from functools import lru_cache

import numpy as np

from eskin.robot import load_robot
from eskin.sim import load_constants
from eskin.sim.people.person import draw_person
from eskin.sim.scene import build_environment
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.skin import MountedSkin
from eskin.skin.presets import build_ur5_skin

EVERY = POSE_GROUPS
SMALL_POOL = {"robot.pool_tries": 1 / 8, "robot.pool_bent": 1 / 8}
"""Factors on constants with which the pool of poses is built quickly."""


@lru_cache(maxsize=1)
def world():
    constants = load_constants().scaled(SMALL_POOL)
    mounted = MountedSkin(build_ur5_skin(), load_robot("ur5"))
    return build_environment(mounted, constants)


def people(count, seed=0):
    rng = np.random.default_rng(seed)
    return [draw_person(f"p{i}", world().constants, rng) for i in range(count)]


def poses(count, seed=0, **options):
    rng = np.random.default_rng(seed)
    return np.array([draw_pose(world(), EVERY, rng, **options) for _ in range(count)])
