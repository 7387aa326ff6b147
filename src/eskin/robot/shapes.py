"""This module defines the collision shapes of links and builds their meshes."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from eskin.robot.triangles import TriangleTree
from eskin.transforms import apply


@dataclass(frozen=True)
class Cylinder:
    """A closed cylinder lies along its local z axis and is centred on its origin."""

    radius: float
    """Radius [m]."""
    length: float
    """Length along z [m]."""


@dataclass(frozen=True)
class Sphere:
    """A sphere is centred on its origin."""

    radius: float
    """Radius [m]."""


@dataclass(frozen=True)
class Box:
    """A box is aligned with its local axes and centred on its origin."""

    size: tuple[float, float, float]
    """Full lengths along x, y and z [m]."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A mesh holds triangles, each counter-clockwise when seen from outside."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Positions of the vertices [m]."""
    faces: Int[np.ndarray, "face 3"]
    """Indices into `vertices`."""

    @cached_property
    def tree(self) -> TriangleTree:
        """Return a tree of the triangles."""
        return TriangleTree(self.vertices[self.faces])


Shape = Cylinder | Sphere | Box | TriangleMesh


@dataclass(frozen=True, eq=False)
class Geom:
    """A geom places one collision shape on a link."""

    source: Shape | Callable[[], Shape]
    """The shape, or a function that reads it when it is first needed."""
    T_link_shape: Float[np.ndarray, "4 4"]
    """Pose of the shape's own frame in the link's frame [m]."""

    @cached_property
    def shape(self) -> Shape:
        """Return the shape.

        Raises:
            RobotError: It cannot be read, such as a mesh whose file is missing.
        """
        return self.source() if callable(self.source) else self.source


def build_geom_mesh(geom: Geom, segments: int = 48) -> TriangleMesh:
    """Build a closed mesh of a geom, in its link's frame."""
    mesh = build_shape_mesh(geom.shape, segments)
    return TriangleMesh(apply(geom.T_link_shape, mesh.vertices), mesh.faces)


def build_shape_mesh(shape: Shape, segments: int = 48) -> TriangleMesh:
    """Build a closed mesh of a shape, in its own frame, with vertices on its surface.

    Args:
        shape: the shape; a mesh is returned unchanged.
        segments: number of corners of a full circle.

    Raises:
        ValueError: There are fewer than three segments.
    """
    if segments < 3:
        raise ValueError(f"a circle of {segments} segments; wanted: 3 or more")
    match shape:
        case Box():
            return build_box_mesh(shape)
        case Cylinder():
            radius = shape.radius
            height = shape.length / 2
            profile = np.array([[radius, -height], [radius, height]])
            return revolve_profile(profile, height, segments)
        case Sphere():
            angle = np.linspace(-np.pi / 2, np.pi / 2, max(segments // 2, 2) + 1)[1:-1]
            profile = shape.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            return revolve_profile(profile, shape.radius, segments)
        case mesh:
            return mesh


def build_box_mesh(box: Box) -> TriangleMesh:
    """Build the eight corners and twelve triangles of a box."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    # Each digit is a corner 4x + 2y + z; sides are counter-clockwise from outside.
    sides = ("0132", "4675", "0451", "2376", "0264", "1573")
    quads = np.array([[int(corner) for corner in side] for side in sides])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return TriangleMesh(signs * np.array(box.size) / 2, faces)


def revolve_profile(
    profile: Float[np.ndarray, "ring 2"], height: float, segments: int
) -> TriangleMesh:
    """Revolve rings of (radius, z) [m] about z, the lowest first.

    Points at z = -height and z = height [m] close it; a ring has `segments` corners.
    """
    angle = np.arange(segments) * 2 * np.pi / segments
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rings = np.empty((len(profile), segments, 3))
    rings[..., :2] = profile[:, None, :1] * circle
    rings[..., 2] = profile[:, 1:]
    poles = np.array([[0.0, 0.0, -height], [0.0, 0.0, height]])
    vertices = np.concatenate([rings.reshape(-1, 3), poles])
    return TriangleMesh(vertices, build_ring_faces(len(profile), segments))


def build_ring_faces(rings: int, segments: int) -> Int[np.ndarray, "face 3"]:
    """Build triangles between neighbouring rings, and from end rings to end points."""
    index = np.arange(rings * segments).reshape(rings, segments)
    right = np.roll(index, -1, axis=1)
    bottom = rings * segments
    top = rings * segments + 1
    parts = [
        (index[:-1], right[:-1], right[1:]),
        (index[:-1], right[1:], index[1:]),
        (right[:1], index[:1], np.full((1, segments), bottom)),
        (index[-1:], right[-1:], np.full((1, segments), top)),
    ]
    return np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in parts])
