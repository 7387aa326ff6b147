"""The surface of a link: how far points are from it, and which way is out."""

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.robot.primitives import (
    Distances,
    box_distance,
    cylinder_distance,
    sphere_distance,
)
from eskin.robot.robot import Link
from eskin.robot.shapes import Body, Box, Cylinder, Sphere
from eskin.robot.triangles import mesh_distance
from eskin.transforms import apply, invert, rotate

__all__ = ["surface_distance"]


def surface_distance(link: Link, p_link: Float[np.ndarray, "point 3"]) -> Distances:
    """Signed distance and outward normal from points to the union of a link's bodies.

    The distance is exact outside and on the surface. Inside, where bodies overlap, it
    is that of the body the point is deepest in: no deeper than the union.

    Args:
        link: The link, which must have bodies.
        p_link: Points in the link's frame [m].

    Returns:
        The distance [m], negative inside, and the unit normal in the link's frame of
        the nearest point of the surface.

    Raises:
        RobotError: The link has no bodies.
    """
    if not link.bodies:
        raise RobotError(
            f"link '{link.name}' has no surface: its URDF gives it no <collision>; "
            "add one, or choose another link"
        )
    distances, normals = zip(
        *(body_distance(body, p_link) for body in link.bodies), strict=True
    )
    nearest = np.argmin(distances, axis=0)
    points = np.arange(len(p_link))
    return np.array(distances)[nearest, points], np.array(normals)[nearest, points]


def body_distance(body: Body, p_link: Float[np.ndarray, "point 3"]) -> Distances:
    """Signed distance [m] and outward normal from points to one body."""
    points = apply(invert(body.T_link_shape), p_link)
    match body.shape:
        case Sphere() as sphere:
            distance, normal = sphere_distance(sphere, points)
        case Box() as box:
            distance, normal = box_distance(box, points)
        case Cylinder() as cylinder:
            distance, normal = cylinder_distance(cylinder, points)
        case mesh:
            distance, normal = mesh_distance(mesh, points)
    return distance, rotate(body.T_link_shape, normal)
