"""Round surfaces: the side of a tube, and a dome."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.skin.surface import Surface, Wrapped
from eskin.transforms import apply, rotate

__all__ = ["Dome", "Tube"]


@final
@dataclass(frozen=True, eq=False)
class Tube(Surface):
    """The outside of a tube along z of its frame.

    s runs round the tube in the sense of a right-hand turn about z, from 0 on the x
    axis to both sides up to half the circumference; t runs along z.
    """

    radius: float
    """[m]"""

    T_link_surface: Float[np.ndarray, "4 4"]

    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> Wrapped:
        """Lay unrolled points (s, t) [m] round the tube."""
        angle = unrolled[:, 0] / self.radius
        zeros = np.zeros_like(angle)
        outward = np.column_stack([np.cos(angle), np.sin(angle), zeros])
        around = np.column_stack([-np.sin(angle), np.cos(angle), zeros])
        along = np.column_stack([zeros, zeros, unrolled[:, 1]])
        return Wrapped(
            positions=apply(self.T_link_surface, self.radius * outward + along),
            normals=rotate(self.T_link_surface, outward),
            tangents=rotate(self.T_link_surface, around),
            stretch=np.ones_like(angle),
        )

    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Arc from the x axis and height [m]."""
        x, y, z = self.local(positions).T
        return np.column_stack([self.radius * np.arctan2(y, x), z])

    def distances(
        self,
        sources: Float[np.ndarray, "source 3"],
        targets: Float[np.ndarray, "target 3"],
    ) -> Float[np.ndarray, "source target"]:
        """Helices, the shorter way round [m]."""
        arc, rise = np.moveaxis(
            self.unroll(sources)[:, None] - self.unroll(targets)[None], -1, 0
        )
        whole = 2 * np.pi * self.radius
        arc = np.abs(arc)
        return np.hypot(np.minimum(arc, whole - arc), rise)

    def gaps(
        self,
        positions: Float[np.ndarray, "point 3"],
        normals: Float[np.ndarray, "point 3"],
    ) -> Float[np.ndarray, "point"]:
        """Distance from the wall [m], plus the normals' lean."""
        wrapped = self.wrap(self.unroll(positions))
        return miss(wrapped, positions, normals)


@final
@dataclass(frozen=True, eq=False)
class Dome(Surface):
    """A sphere about the origin of its frame, seen from its pole on z.

    (s, t) are polar coordinates about the pole: a point lies |(s, t)| from the pole
    along the surface, in the direction of (s, t) from x to y.
    """

    radius: float
    """[m]"""

    T_link_surface: Float[np.ndarray, "4 4"]

    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> Wrapped:
        """Lay unrolled points (s, t) [m] over the dome."""
        angle = np.linalg.norm(unrolled, axis=1) / self.radius
        spread = np.sinc(angle / np.pi)
        flat = unrolled / self.radius
        outward = np.column_stack([spread[:, None] * flat, np.cos(angle)])
        # The x axis carried from the pole to the point along a great circle.
        pole = np.array([0.0, 0.0, 1.0])
        half = outward + pole
        carried = np.eye(3)[0] - (outward[:, 0] / half[:, 2])[:, None] * half
        return Wrapped(
            positions=apply(self.T_link_surface, self.radius * outward),
            normals=rotate(self.T_link_surface, outward),
            tangents=rotate(self.T_link_surface, carried),
            stretch=spread,
        )

    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Arc from the pole, in the direction seen from above it [m]."""
        local = self.local(positions)
        across = np.linalg.norm(local[:, :2], axis=1)
        arc = self.radius * np.arctan2(across, local[:, 2])
        return local[:, :2] * (arc / np.where(across > 0, across, 1.0))[:, None]

    def distances(
        self,
        sources: Float[np.ndarray, "source 3"],
        targets: Float[np.ndarray, "target 3"],
    ) -> Float[np.ndarray, "source target"]:
        """Great circles [m]."""
        a, b = (
            local / np.linalg.norm(local, axis=1, keepdims=True)
            for local in (self.local(sources), self.local(targets))
        )
        chord = np.linalg.norm(a[:, None] - b[None], axis=-1)
        return 2 * self.radius * np.arcsin(np.minimum(chord / 2, 1.0))

    def gaps(
        self,
        positions: Float[np.ndarray, "point 3"],
        normals: Float[np.ndarray, "point 3"],
    ) -> Float[np.ndarray, "point"]:
        """Distance from the sphere [m], plus the normals' lean."""
        wrapped = self.wrap(self.unroll(positions))
        return miss(wrapped, positions, normals)


def miss(
    wrapped: Wrapped,
    positions: Float[np.ndarray, "point 3"],
    normals: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, "point"]:
    """How far points and normals are from where the surface has them."""
    return np.linalg.norm(wrapped.positions - positions, axis=1) + np.linalg.norm(
        wrapped.normals - normals, axis=1
    )
