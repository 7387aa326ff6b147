"""This module computes signed distances and outward normals of shapes and links.

Distances are negative inside [m]. A normal is that of the nearest point of the surface;
where several points are nearest, it is that of one of them.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import RobotError
from eskin.robot.robot import Link
from eskin.robot.shapes import Box, Cylinder, Geom, Sphere, TriangleMesh
from eskin.transforms import apply, invert, rotate

Points = Float[np.ndarray, "point 3"]
Triangles = Float[np.ndarray, "face 3 3"]
Distances = tuple[Float[np.ndarray, "point"], Float[np.ndarray, "point 3"]]

PAIRS_AT_ONCE = 200_000
"""Number of pairs of points and triangles that are processed at once."""
ON_SURFACE = 1e-7
"""Distance below which the normal is that of the nearest triangle [m]."""


def compute_surface_distance(link: Link, p_link: Points) -> Distances:
    """Compute signed distances [m] and unit normals of the union of a link's geoms.

    Points and normals are in the link's frame. The distance is exact outside and on the
    surface. Inside overlapping geoms it is that of the geom in which the point is
    deepest, a lower bound of the depth.

    Raises:
        RobotError: The link has no geoms.
    """
    if not link.geoms:
        raise RobotError(
            f"link '{link.name}' has no surface: its URDF gives it no <collision>; "
            "add one, or choose another link"
        )
    distances, normals = zip(
        *(compute_geom_distance(geom, p_link) for geom in link.geoms), strict=True
    )
    nearest = np.argmin(distances, axis=0)
    points = np.arange(len(p_link))
    return np.array(distances)[nearest, points], np.array(normals)[nearest, points]


def compute_geom_distance(geom: Geom, p_link: Points) -> Distances:
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
            distance, normal = compute_mesh_distance(mesh, points)
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


def compute_mesh_distance(mesh: TriangleMesh, points: Points) -> Distances:
    """Compute distance and normal of a closed mesh.

    Every point is compared with every triangle, which suits the layout and checks of
    skins but not the real-time path.
    """
    corners = mesh.vertices[mesh.faces]
    nearest = np.empty_like(points)
    face = np.empty(len(points), dtype=int)
    inside = np.empty(len(points), dtype=bool)
    step = max(1, PAIRS_AT_ONCE // len(corners))
    for start in range(0, len(points), step):
        part = slice(start, start + step)
        face[part], nearest[part] = find_nearest_triangle(corners, points[part])
        inside[part] = np.abs(compute_winding_number(corners, points[part])) > 0.5
    offset = points - nearest
    distance = np.linalg.norm(offset, axis=-1) * np.where(inside, -1.0, 1.0)
    on_surface = np.abs(distance) < ON_SURFACE
    safe = np.where(on_surface, 1.0, distance)[:, None]
    flat = compute_triangle_normals(corners[face])
    return distance, np.where(on_surface[:, None], flat, offset / safe)


def compute_winding_number(
    corners: Triangles, points: Points
) -> Float[np.ndarray, "point"]:
    """Compute the winding number of triangles: 1 inside a closed mesh, 0 outside.

    It is the sum of the solid angles (Van Oosterom and Strackee 1983), which holds for
    overlapping meshes and degrades smoothly at holes (Jacobson 2013).
    """
    a, b, c = np.moveaxis(corners[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    volume = dot(a, np.cross(b, c))
    cosine = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return np.sum(np.arctan2(volume, cosine), axis=-1) / (2 * np.pi)


def find_nearest_triangle(
    corners: Triangles, points: Points
) -> tuple[Int[np.ndarray, "point"], Points]:
    """Return for each point the nearest triangle, and the nearest point on it."""
    candidates = find_nearest_points(corners[None], points[:, None])
    square = np.sum((points[:, None] - candidates) ** 2, axis=-1)
    face = np.argmin(square, axis=-1)
    return face, candidates[np.arange(len(points)), face]


def find_nearest_points(
    corners: Float[np.ndarray, "1 face 3 3"], points: Float[np.ndarray, "point 1 3"]
) -> Float[np.ndarray, "point face 3"]:
    """Return the nearest point on every triangle to every point."""
    normals = compute_triangle_normals(corners[0])[None]
    height = dot(points - corners[:, :, 0], normals)
    flat = points - height[..., None] * normals
    over = np.any(normals != 0, axis=-1) & are_inside_edges(corners, normals, flat)
    best = np.where(over[..., None], flat, 0.0)
    shortest = np.where(over, height**2, np.inf)
    for i in range(3):
        start, end = corners[:, :, i], corners[:, :, (i + 1) % 3]
        edge = end - start
        square = np.maximum(dot(edge, edge), np.finfo(float).tiny)
        along = np.clip(dot(points - start, edge) / square, 0.0, 1.0)
        on_edge = start + along[..., None] * edge
        length = np.sum((points - on_edge) ** 2, axis=-1)
        closer = length < shortest
        best = np.where(closer[..., None], on_edge, best)
        shortest = np.where(closer, length, shortest)
    return best


def are_inside_edges(
    corners: Float[np.ndarray, "1 face 3 3"],
    normals: Float[np.ndarray, "1 face 3"],
    flat: Float[np.ndarray, "point face 3"],
) -> Bool[np.ndarray, "point face"]:
    """Return whether points in the planes of triangles lie inside the triangles."""
    inside = np.ones(flat.shape[:2], dtype=bool)
    for i in range(3):
        start, end = corners[:, :, i], corners[:, :, (i + 1) % 3]
        inside &= dot(np.cross(end - start, flat - start), normals) >= 0
    return inside


def compute_triangle_normals(corners: Triangles) -> Float[np.ndarray, "face 3"]:
    """Compute unit normals, which are zero for triangles without area."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def dot(
    a: Float[np.ndarray, "*#batch 3"], b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*out"]:
    """Return the inner product over the last axis."""
    return np.einsum("...i,...i->...", a, b)
