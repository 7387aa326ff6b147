"""This module computes signed distances and outward normals of shapes and links.

Distances are negative inside [m]. A normal is that of the nearest point of the surface;
where several points are nearest, it is that of one of them.
"""

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.robot.robot import Link
from eskin.robot.shapes import Box, Cylinder, Geom, Sphere, TriangleMesh
from eskin.robot.triangles import compute_triangle_normals
from eskin.transforms import apply, invert, rotate

Points = Float[np.ndarray, "point 3"]
Distances = tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point 3"]]

ON_SURFACE = 1e-7
"""Distance below which the normal is the normal of the nearest triangle [m]."""


def compute_surface_distance(
    link: Link, p_link: Points, exact_to: float = np.inf
) -> Distances:
    """Compute signed distances [m] and unit normals of the union of a link's geoms.

    Points and normals are in the link's frame. The distance is exact outside and on the
    surface. Inside overlapping geoms it is that of the geom in which the point is
    deepest, a lower bound of the depth.

    Args:
        link: the link.
        p_link: the points [m].
        exact_to: distance beyond which those from meshes may be 5 % too long [m], which
            is faster.

    Raises:
        RobotError: The link has no geoms.
    """
    if not link.geoms:
        raise RobotError(
            f"link '{link.name}' has no surface: its URDF gives it no <collision>; "
            "add one, or choose another link"
        )
    distances, normals = zip(
        *(compute_geom_distance(geom, p_link, exact_to) for geom in link.geoms),
        strict=True,
    )
    nearest = np.argmin(distances, axis=0)
    points = np.arange(len(p_link))
    return np.array(distances)[nearest, points], np.array(normals)[nearest, points]


def compute_geom_distance(geom: Geom, p_link: Points, exact_to: float) -> Distances:
    """Compute distance [m] and normal from points in the link's frame to one geom."""
    points = apply(invert(geom.T_link_shape), p_link)
    match geom.shape:
        case Sphere() as sphere:
            length, normal = split_length(points)
            distance = length - sphere.radius
        case Box() as box:
            distance, normal = compute_box_distance(box, points)
        case Cylinder() as cylinder:
            distance, normal = compute_cylinder_distance(cylinder, points)
        case mesh:
            distance, normal = compute_mesh_distance(mesh, points, exact_to)
    return distance, rotate(geom.T_link_shape, normal)


def compute_box_distance(box: Box, points: Points) -> Distances:
    """Compute distance and normal of a box, in its own frame."""
    beyond = np.abs(points) - np.array(box.size) / 2
    distance, normal = compute_corner_distance(beyond)
    return distance, normal * np.where(points < 0, -1.0, 1.0)


def compute_cylinder_distance(cylinder: Cylinder, points: Points) -> Distances:
    """Compute distance and normal of a closed cylinder, in its own frame."""
    radial, outward = split_length(points * [1.0, 1.0, 0.0])
    axial = np.abs(points[:, 2])
    beyond = np.stack([radial - cylinder.radius, axial - cylinder.length / 2], axis=-1)
    distance, slope = compute_corner_distance(beyond)
    normal = slope[:, :1] * outward
    normal[:, 2] = slope[:, 1] * np.where(points[:, 2] < 0, -1.0, 1.0)
    return distance, normal


def split_length(vectors: Points) -> Distances:
    """Return length and direction of vectors; a zero vector has the direction x."""
    length = np.linalg.norm(vectors, axis=-1)
    unit = vectors / np.where(length > 0, length, 1.0)[:, None]
    unit[length == 0] = [1.0, 0.0, 0.0]
    return length, unit


def compute_corner_distance(
    beyond: Float[np.ndarray, "point side"],
) -> tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point side"]]:
    """Compute distance and normal of a corner of perpendicular sides.

    `beyond` is the signed distance of each point from each side, negative inside [m].
    """
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=-1)
    nearest_side = np.eye(beyond.shape[1])[np.argmax(beyond, axis=-1)]
    is_outside = length > 0
    slope = outside / np.where(is_outside, length, 1.0)[:, None]
    distance = np.where(is_outside, length, np.max(beyond, axis=-1))
    return distance, np.where(is_outside[:, None], slope, nearest_side)


def compute_mesh_distance(
    mesh: TriangleMesh, points: Points, exact_to: float
) -> Distances:
    """Compute distance and normal of a closed mesh."""
    corners, nearest = mesh.tree.find_nearest(points, exact_to)
    inside = np.abs(mesh.tree.compute_winding_numbers(points)) > 0.5
    offset = points - nearest
    distance = np.linalg.norm(offset, axis=-1) * np.where(inside, -1.0, 1.0)
    on_surface = np.abs(distance) < ON_SURFACE
    safe = np.where(on_surface, 1.0, distance)[:, None]
    flat = compute_triangle_normals(corners)
    return distance, np.where(on_surface[:, None], flat, offset / safe)
