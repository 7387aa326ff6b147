"""Robots hold links, joints and shapes; kinematics place the links for a given `q`."""

from eskin.robot.kinematics import DampedLeastSquaresIK, Kinematics
from eskin.robot.presets import ROBOT_PRESETS, load_robot
from eskin.robot.robot import Joint, Link, Mimic, Robot
from eskin.robot.shapes import (
    Box,
    Cylinder,
    Geom,
    Shape,
    Sphere,
    TriangleMesh,
    build_geom_mesh,
    build_shape_mesh,
    revolve_profile,
)
from eskin.robot.surface import compute_surface_distance
from eskin.robot.urdf import load_urdf

__all__ = [
    "ROBOT_PRESETS",
    "Box",
    "Cylinder",
    "DampedLeastSquaresIK",
    "Geom",
    "Joint",
    "Kinematics",
    "Link",
    "Mimic",
    "Robot",
    "Shape",
    "Sphere",
    "TriangleMesh",
    "build_geom_mesh",
    "build_shape_mesh",
    "compute_surface_distance",
    "load_robot",
    "load_urdf",
    "revolve_profile",
]
