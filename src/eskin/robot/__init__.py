"""Robots: their links, joints and shapes, and where every link is for a given `q`."""

from eskin.robot.dynamics import Wrench
from eskin.robot.kinematics import Kinematics, Reach
from eskin.robot.presets import ROBOTS, load_robot, recorded_robot
from eskin.robot.robot import Joint, Link, Mimic, Robot
from eskin.robot.shapes import (
    Body,
    Box,
    Cylinder,
    Shape,
    Sphere,
    TriangleMesh,
    body_mesh,
    shape_mesh,
)
from eskin.robot.surface import surface_distance
from eskin.robot.urdf import load_urdf

__all__ = [
    "ROBOTS",
    "Body",
    "Box",
    "Cylinder",
    "Joint",
    "Kinematics",
    "Link",
    "Mimic",
    "Reach",
    "Robot",
    "Shape",
    "Sphere",
    "TriangleMesh",
    "Wrench",
    "body_mesh",
    "load_robot",
    "load_urdf",
    "recorded_robot",
    "shape_mesh",
    "surface_distance",
]
