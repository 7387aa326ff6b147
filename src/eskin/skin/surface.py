"""Surfaces that a patch can be laid on, and that can be rolled flat again.

Unrolled coordinates (s, t) are lengths [m] on the surface. The surface's own frame lies
in its link's frame at `T_link_surface`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.transforms import apply, invert

__all__ = ["Plane", "Surface", "Wrapped"]


@dataclass(frozen=True, eq=False)
class Wrapped:
    """Points of an unrolled drawing, laid on a surface; in the link's frame."""

    positions: Float[np.ndarray, "point 3"]
    """[m]"""

    normals: Float[np.ndarray, "point 3"]
    """Outward unit normals."""

    tangents: Float[np.ndarray, "point 3"]
    """Unit directions in which s grows."""

    stretch: Float[np.ndarray, "point"]
    """Area on the surface for each unit of unrolled area."""


class Surface(ABC):
    """A surface with unrolled coordinates and a closed form for its distances."""

    T_link_surface: Float[np.ndarray, "4 4"]

    @abstractmethod
    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> Wrapped:
        """Lay unrolled points (s, t) [m] on the surface."""

    @abstractmethod
    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Unrolled coordinates (s, t) [m] of points of the surface [m]."""

    @abstractmethod
    def distances(
        self,
        sources: Float[np.ndarray, "source 3"],
        targets: Float[np.ndarray, "target 3"],
    ) -> Float[np.ndarray, "source target"]:
        """Lengths of the shortest ways along the surface [m] between its points."""

    @abstractmethod
    def gaps(
        self,
        positions: Float[np.ndarray, "point 3"],
        normals: Float[np.ndarray, "point 3"],
    ) -> Float[np.ndarray, "point"]:
        """How far points and normals miss the surface: distance [m] plus angle."""

    def local(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 3"]:
        """Points of the link in the surface's own frame [m]."""
        return apply(invert(self.T_link_surface), positions)


@final
@dataclass(frozen=True, eq=False)
class Plane(Surface):
    """The plane z = 0 of its frame, with its outside toward +z; s is x and t is y."""

    T_link_surface: Float[np.ndarray, "4 4"]

    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> Wrapped:
        """Lay unrolled points (s, t) [m] on the plane."""
        count = len(unrolled)
        points = np.column_stack([unrolled, np.zeros(count)])
        x_axis, _, z_axis = self.T_link_surface[:3, :3].T
        return Wrapped(
            positions=apply(self.T_link_surface, points),
            normals=np.tile(z_axis, (count, 1)),
            tangents=np.tile(x_axis, (count, 1)),
            stretch=np.ones(count),
        )

    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Coordinates x and y in the plane [m]."""
        return self.local(positions)[:, :2]

    def distances(
        self,
        sources: Float[np.ndarray, "source 3"],
        targets: Float[np.ndarray, "target 3"],
    ) -> Float[np.ndarray, "source target"]:
        """Straight lines [m]."""
        return np.linalg.norm(
            self.unroll(sources)[:, None] - self.unroll(targets)[None], axis=-1
        )

    def gaps(
        self,
        positions: Float[np.ndarray, "point 3"],
        normals: Float[np.ndarray, "point 3"],
    ) -> Float[np.ndarray, "point"]:
        """Height above or below the plane [m], plus the normals' lean."""
        lean = np.linalg.norm(normals - self.T_link_surface[:3, 2], axis=1)
        return np.abs(self.local(positions)[:, 2]) + lean
