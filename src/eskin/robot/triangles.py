"""Signed distance and outward normal of a surface of triangles.

Every point meets every triangle: meant for laying and checking skins, not for the
live path.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.robot.primitives import Distances
from eskin.robot.shapes import TriangleMesh

__all__ = ["mesh_distance", "winding_number"]

PAIRS_AT_ONCE = 200_000
"""Points times triangles held in memory at one time."""
ON_SURFACE = 1e-7
"""Closer than this [m] the nearest triangle's own normal is taken."""


def mesh_distance(
    mesh: TriangleMesh, points: Float[np.ndarray, "point 3"]
) -> Distances:
    """Signed distance and outward normal of a closed mesh, negative inside [m]."""
    corners = mesh.vertices[mesh.faces]
    nearest = np.empty_like(points)
    face = np.empty(len(points), dtype=int)
    inside = np.empty(len(points), dtype=bool)
    step = max(1, PAIRS_AT_ONCE // len(corners))
    for start in range(0, len(points), step):
        part = slice(start, start + step)
        face[part], nearest[part] = nearest_triangle(corners, points[part])
        inside[part] = np.abs(winding_number(corners, points[part])) > 0.5
    offset = points - nearest
    distance = np.linalg.norm(offset, axis=-1) * np.where(inside, -1.0, 1.0)
    on_surface = np.abs(distance) < ON_SURFACE
    safe = np.where(on_surface, 1.0, distance)[:, None]
    flat = triangle_normals(corners[face])
    return distance, np.where(on_surface[:, None], flat, offset / safe)


def winding_number(
    corners: Float[np.ndarray, "face 3 3"], points: Float[np.ndarray, "point 3"]
) -> Float[np.ndarray, "point"]:
    """How often triangles wind around points: 1 inside a closed mesh, 0 outside.

    The sum of the solid angles (Van Oosterom and Strackee 1983), which holds for
    overlapping meshes too and bends rather than breaks at holes (Jacobson 2013).
    """
    a, b, c = np.moveaxis(corners[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    volume = dot(a, np.cross(b, c))
    cosine = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return np.sum(np.arctan2(volume, cosine), axis=-1) / (2 * np.pi)


def nearest_triangle(
    corners: Float[np.ndarray, "face 3 3"], points: Float[np.ndarray, "point 3"]
) -> tuple[Int[np.ndarray, "point"], Float[np.ndarray, "point 3"]]:
    """For each point the nearest triangle, and the nearest point on it."""
    candidates = nearest_on_triangles(corners[None], points[:, None])
    square = np.sum((points[:, None] - candidates) ** 2, axis=-1)
    face = np.argmin(square, axis=-1)
    return face, candidates[np.arange(len(points)), face]


def nearest_on_triangles(
    corners: Float[np.ndarray, "1 face 3 3"], points: Float[np.ndarray, "point 1 3"]
) -> Float[np.ndarray, "point face 3"]:
    """The nearest point on every triangle to every point."""
    normals = triangle_normals(corners[0])[None]
    height = dot(points - corners[:, :, 0], normals)
    flat = points - height[..., None] * normals
    over = np.any(normals != 0, axis=-1) & inside_edges(corners, normals, flat)
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


def inside_edges(
    corners: Float[np.ndarray, "1 face 3 3"],
    normals: Float[np.ndarray, "1 face 3"],
    flat: Float[np.ndarray, "point face 3"],
) -> Bool[np.ndarray, "point face"]:
    """Do points in the planes of triangles lie inside them?"""
    inside = np.ones(flat.shape[:2], dtype=bool)
    for i in range(3):
        start, end = corners[:, :, i], corners[:, :, (i + 1) % 3]
        inside &= dot(np.cross(end - start, flat - start), normals) >= 0
    return inside


def triangle_normals(
    corners: Float[np.ndarray, "face 3 3"],
) -> Float[np.ndarray, "face 3"]:
    """Unit normals, zero for triangles without area."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def dot(
    a: Float[np.ndarray, "*#batch 3"], b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*out"]:
    """Inner product over the last axis."""
    return np.einsum("...i,...i->...", a, b)
