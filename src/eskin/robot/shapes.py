"""This module holds the solid shapes that links are made of, and builds their meshes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.transforms import apply


@dataclass(frozen=True)
class Cylinder:
    """A closed cylinder along its local z axis, centred on its origin."""

    radius: float
    """[m]"""
    length: float
    """[m]"""


@dataclass(frozen=True)
class Sphere:
    """A ball centred on its origin."""

    radius: float
    """[m]"""


@dataclass(frozen=True)
class Box:
    """A box along its local axes, centred on its origin."""

    size: tuple[float, float, float]
    """Whole lengths along x, y and z [m]."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles, each counter-clockwise when seen from outside."""

    vertices: Float[np.ndarray, "vertex 3"]
    """[m]"""
    faces: Int[np.ndarray, "face 3"]
    """Indices into `vertices`."""


Shape = Cylinder | Sphere | Box | TriangleMesh


@dataclass(frozen=True, eq=False)
class Geom:
    """One shape placed on a link."""

    shape: Shape
    T_link_shape: Float[np.ndarray, "4 4"]
    """Pose of the shape's own frame in the link's frame [m]."""


def build_geom_mesh(body: Geom, segments: int = 48) -> TriangleMesh:
    """A closed mesh of a body, in its link's frame."""
    mesh = build_shape_mesh(body.shape, segments)
    return TriangleMesh(apply(body.T_link_shape, mesh.vertices), mesh.faces)


def build_shape_mesh(shape: Shape, segments: int = 48) -> TriangleMesh:
    """A closed mesh of a shape, in its own frame, its vertices on the surface.

    Args:
        shape: What to mesh; a mesh is given back as it is.
        segments: Corners of a full circle.

    Raises:
        ValueError: Fewer than three segments.
    """
    if segments < 3:
        raise ValueError(f"a circle of {segments} segments; wanted: 3 or more")
    match shape:
        case Box():
            return box_mesh(shape)
        case Cylinder():
            radius, height = shape.radius, shape.length / 2
            return revolve_profile(
                np.array([[radius, -height], [radius, height]]), height, segments
            )
        case Sphere():
            angle = np.linspace(-np.pi / 2, np.pi / 2, max(segments // 2, 2) + 1)[1:-1]
            profile = shape.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            return revolve_profile(profile, shape.radius, segments)
        case mesh:
            return mesh


def box_mesh(box: Box) -> TriangleMesh:
    """Eight corners and twelve triangles."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    # Corner 4x + 2y + z; the four of each side, counter-clockwise from outside.
    sides = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ]
    quads = np.array(sides)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return TriangleMesh(signs * np.array(box.size) / 2, faces)


def revolve_profile(
    profile: Float[np.ndarray, "ring 2"], height: float, segments: int
) -> TriangleMesh:
    """Turn a profile of (radius, z) about z and close it with a point at either end.

    Args:
        profile: From the lowest ring to the highest [m].
        height: The end points are at z = -height and z = height [m].
        segments: Corners of a ring.
    """
    angle = np.arange(segments) * 2 * np.pi / segments
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = np.empty((len(profile), segments, 3))
    rings[..., :2] = profile[:, None, :1] * circle
    rings[..., 2] = profile[:, 1:]
    poles = np.array([[0.0, 0.0, -height], [0.0, 0.0, height]])
    vertices = np.concatenate([rings.reshape(-1, 3), poles])
    return TriangleMesh(vertices, lathe_faces(len(profile), segments))


def lathe_faces(rings: int, segments: int) -> Int[np.ndarray, "face 3"]:
    """Triangles between neighbouring rings, and from end rings to end points."""
    index = np.arange(rings * segments).reshape(rings, segments)
    right = np.roll(index, -1, axis=1)
    bottom, top = rings * segments, rings * segments + 1
    parts = [
        (index[:-1], right[:-1], right[1:]),
        (index[:-1], right[1:], index[1:]),
        (right[:1], index[:1], np.full((1, segments), bottom)),
        (index[-1:], right[-1:], np.full((1, segments), top)),
    ]
    return np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in parts])
