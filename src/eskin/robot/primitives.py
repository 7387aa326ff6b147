"""Signed distance and outward normal of spheres, boxes and cylinders.

Distances are in the shape's own frame [m], negative inside. The normal is that of the
nearest point of the surface; where several are nearest, one of theirs.
"""

import numpy as np
from jaxtyping import Float

from eskin.robot.shapes import Box, Cylinder, Sphere

__all__ = ["Distances", "box_distance", "cylinder_distance", "sphere_distance"]

Points = Float[np.ndarray, "point 3"]
Distances = tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point 3"]]


def sphere_distance(sphere: Sphere, points: Points) -> Distances:
    """Signed distance and outward normal of a sphere."""
    length, normal = direction(points)
    return length - sphere.radius, normal


def box_distance(box: Box, points: Points) -> Distances:
    """Signed distance and outward normal of a box."""
    beyond = np.abs(points) - np.array(box.size) / 2
    distance, normal = corner_distance(beyond)
    return distance, normal * np.where(points < 0, -1.0, 1.0)


def cylinder_distance(cylinder: Cylinder, points: Points) -> Distances:
    """Signed distance and outward normal of a closed cylinder."""
    radial, outward = direction(points * [1.0, 1.0, 0.0])
    axial = np.abs(points[:, 2])
    beyond = np.stack([radial - cylinder.radius, axial - cylinder.length / 2], axis=-1)
    distance, slope = corner_distance(beyond)
    normal = slope[:, :1] * outward
    normal[:, 2] = slope[:, 1] * np.where(points[:, 2] < 0, -1.0, 1.0)
    return distance, normal


def direction(points: Points) -> Distances:
    """Length and direction of vectors; the direction of a zero is x."""
    length = np.linalg.norm(points, axis=-1)
    unit = points / np.where(length > 0, length, 1.0)[:, None]
    unit[length == 0] = [1.0, 0.0, 0.0]
    return length, unit


def corner_distance(
    beyond: Float[np.ndarray, "point side"],
) -> tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point side"]]:
    """Signed distance and normal of a corner of flat sides at right angles.

    Args:
        beyond: How far each point is outside each side, negative inside [m].
    """
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=-1)
    nearest_side = np.eye(beyond.shape[1])[np.argmax(beyond, axis=-1)]
    is_outside = length > 0
    slope = outside / np.where(is_outside, length, 1.0)[:, None]
    distance = np.where(is_outside, length, np.max(beyond, axis=-1))
    return distance, np.where(is_outside[:, None], slope, nearest_side)
