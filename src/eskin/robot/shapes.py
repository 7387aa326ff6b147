"""The solid shapes that links are made of."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Body", "Box", "Cylinder", "Shape", "Sphere", "TriangleMesh"]


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
class Body:
    """One shape placed on a link."""

    shape: Shape
    T_link_shape: Float[np.ndarray, "4 4"]
    """Pose of the shape's own frame in the link's frame [m]."""
