"""This module describes surfaces that a patch can be laid on."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.transforms import apply, invert, make_transform, rotate


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of an unrolled drawing, laid on a surface; in the link's frame."""

    positions: Float[np.ndarray, "point 3"]
    """[m]"""

    normals: Float[np.ndarray, "point 3"]
    """Outward unit normals."""

    tangents: Float[np.ndarray, "point 3"]
    """Unit directions in which s grows."""

    area_scale: Float[np.ndarray, "point"]
    """Area on the surface for each unit of unrolled area."""


class Surface(ABC):
    """A surface with unrolled coordinates and a closed form for its distances."""

    T_link_surface: Float[np.ndarray, "4 4"]

    @abstractmethod
    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] on the surface."""

    @abstractmethod
    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Unrolled coordinates (s, t) [m] of points of the surface [m]."""

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

    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] on the plane."""
        count = len(unrolled)
        points = np.column_stack([unrolled, np.zeros(count)])
        x_axis, _, z_axis = self.T_link_surface[:3, :3].T
        return SurfacePoints(
            positions=apply(self.T_link_surface, points),
            normals=np.tile(z_axis, (count, 1)),
            tangents=np.tile(x_axis, (count, 1)),
            area_scale=np.ones(count),
        )

    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Coordinates x and y in the plane [m]."""
        return self.local(positions)[:, :2]

    def gaps(
        self,
        positions: Float[np.ndarray, "point 3"],
        normals: Float[np.ndarray, "point 3"],
    ) -> Float[np.ndarray, "point"]:
        """Height above or below the plane [m], plus the normals' lean."""
        lean = np.linalg.norm(normals - self.T_link_surface[:3, 2], axis=1)
        return np.abs(self.local(positions)[:, 2]) + lean


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

    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] round the tube."""
        angle = unrolled[:, 0] / self.radius
        zeros = np.zeros_like(angle)
        outward = np.column_stack([np.cos(angle), np.sin(angle), zeros])
        around = np.column_stack([-np.sin(angle), np.cos(angle), zeros])
        along = np.column_stack([zeros, zeros, unrolled[:, 1]])
        return SurfacePoints(
            positions=apply(self.T_link_surface, self.radius * outward + along),
            normals=rotate(self.T_link_surface, outward),
            tangents=rotate(self.T_link_surface, around),
            area_scale=np.ones_like(angle),
        )

    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Arc from the x axis and height [m]."""
        x, y, z = self.local(positions).T
        return np.column_stack([self.radius * np.arctan2(y, x), z])

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

    def wrap(self, unrolled: Float[np.ndarray, "point 2"]) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] over the dome."""
        angle = np.linalg.norm(unrolled, axis=1) / self.radius
        spread = np.sinc(angle / np.pi)
        flat = unrolled / self.radius
        outward = np.column_stack([spread[:, None] * flat, np.cos(angle)])
        # The x axis carried from the pole to the point along a great circle.
        pole = np.array([0.0, 0.0, 1.0])
        half = outward + pole
        carried = np.eye(3)[0] - (outward[:, 0] / half[:, 2])[:, None] * half
        return SurfacePoints(
            positions=apply(self.T_link_surface, self.radius * outward),
            normals=rotate(self.T_link_surface, outward),
            tangents=rotate(self.T_link_surface, carried),
            area_scale=spread,
        )

    def unroll(
        self, positions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point 2"]:
        """Arc from the pole, in the direction seen from above it [m]."""
        local = self.local(positions)
        across = np.linalg.norm(local[:, :2], axis=1)
        arc = self.radius * np.arctan2(across, local[:, 2])
        return local[:, :2] * (arc / np.where(across > 0, across, 1.0))[:, None]

    def gaps(
        self,
        positions: Float[np.ndarray, "point 3"],
        normals: Float[np.ndarray, "point 3"],
    ) -> Float[np.ndarray, "point"]:
        """Distance from the sphere [m], plus the normals' lean."""
        wrapped = self.wrap(self.unroll(positions))
        return miss(wrapped, positions, normals)


def miss(
    wrapped: SurfacePoints,
    positions: Float[np.ndarray, "point 3"],
    normals: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, "point"]:
    """How far points and normals are from where the surface has them."""
    return np.linalg.norm(wrapped.positions - positions, axis=1) + np.linalg.norm(
        wrapped.normals - normals, axis=1
    )


# Files hold micrometres at least; a normal may be rounded as well.
TOLERANCE = 1e-4


def fit_surface(
    positions: Float[np.ndarray, "taxel 3"], normals: Float[np.ndarray, "taxel 3"]
) -> Surface | None:
    """The plane, else the tube, else the dome through all taxels, else None.

    The middle of the taxels comes to lie near (s, t) = (0, 0).
    """
    if len(positions) == 0:
        return None
    for fit in (fit_plane, fit_tube, fit_dome):
        surface = fit(positions, normals)
        if surface is not None and np.max(surface.gaps(positions, normals)) < TOLERANCE:
            return surface
    return None


def fit_plane(
    positions: Float[np.ndarray, "taxel 3"], normals: Float[np.ndarray, "taxel 3"]
) -> Plane:
    """The plane through the mean taxel, across the mean normal."""
    return Plane(frame(normals.mean(axis=0), positions.mean(axis=0)))


def fit_tube(
    positions: Float[np.ndarray, "taxel 3"], normals: Float[np.ndarray, "taxel 3"]
) -> Tube | None:
    """The tube whose axis is at right angles to all normals.

    p - r n lies on the axis for every taxel, which is linear in the radius r and the
    point c where the axis meets the plane across it.
    """
    axis = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
    x_axis = perpendicular(axis, normals.mean(axis=0))
    across = np.column_stack([x_axis, np.cross(axis, x_axis)])
    radius, centre = meeting_point(positions @ across, normals @ across)
    if not radius > 0:
        return None
    middle = across @ centre + axis * (positions @ axis).mean()
    rotation = np.column_stack([across, axis])
    return Tube(radius, make_transform(rotation, middle))


def fit_dome(
    positions: Float[np.ndarray, "taxel 3"], normals: Float[np.ndarray, "taxel 3"]
) -> Dome | None:
    """The sphere whose centre all normals point away from, its pole amid the taxels."""
    radius, centre = meeting_point(positions, normals)
    return Dome(radius, frame(normals.mean(axis=0), centre)) if radius > 0 else None


def meeting_point(
    points: Float[np.ndarray, "taxel dim"], normals: Float[np.ndarray, "taxel dim"]
) -> tuple[float, Float[np.ndarray, "dim"]]:
    """Radius r and centre c that fit p - r n = c best in least squares."""
    from_middle = points - points.mean(axis=0)
    spread = normals - normals.mean(axis=0)
    power = np.sum(spread**2)
    if power < TOLERANCE**2:
        return 0.0, points.mean(axis=0)
    radius = float(np.sum(from_middle * spread) / power)
    return radius, points.mean(axis=0) - radius * normals.mean(axis=0)


def frame(
    z_axis: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """T_link_surface with z that way and x as near the link's x (else y) as can be."""
    length = np.linalg.norm(z_axis)
    z_axis = z_axis / length if length > TOLERANCE else np.array([0.0, 0.0, 1.0])
    x_axis = perpendicular(z_axis, np.eye(3)[0])
    rotation = np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis])
    return make_transform(rotation, origin)


def perpendicular(
    axis: Float[np.ndarray, "3"], wish: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """The unit vector across a unit axis that is nearest to a wished one."""
    for seed in (wish, *np.eye(3)):
        across = seed - (seed @ axis) * axis
        length = np.linalg.norm(across)
        if length > 0.1 * max(float(np.linalg.norm(seed)), TOLERANCE):
            return across / length
    raise ValueError(f"axis {axis} is not a unit vector")
