"""This package simulates a robot in its skin: poses, motion, sites and scenes."""

from eskin.sim.scene.environment import (
    SimEnvironment,
    build_environment,
    load_environment,
)
from eskin.sim.scene.poses import find_untouched_links
from eskin.sim.scene.validity import are_collision_free, compute_joint_limits

__all__ = [
    "SimEnvironment",
    "are_collision_free",
    "build_environment",
    "compute_joint_limits",
    "find_untouched_links",
    "load_environment",
]
