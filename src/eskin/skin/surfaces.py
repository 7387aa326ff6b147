"""This module defines surfaces that a patch can be laid on and unrolled from.

Unrolled coordinates (s, t) are lengths [m] on the surface. The surface's own frame lies
in its link's frame at `T_link_surface`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.transforms import apply, invert, make_transform, rotate

Points = Float[np.ndarray, "point 3"]
Unrolled = Float[np.ndarray, "point 2"]

TOLERANCE = 1e-4
"""Largest error of a taxel on a fitted surface [m] plus that of its normal [rad]; files
may round positions to micrometres, and normals too."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """These points lie on a surface; they are given in the frame of its link."""

    positions: Points
    """Positions [m]."""
    normals: Points
    """Outward unit normals."""
    tangents: Points
    """Unit directions of increasing s."""
    area_scale: Float[np.ndarray, "point"]
    """Area on the surface over unrolled area."""


class Surface(ABC):
    """A surface maps unrolled coordinates to points of a link and back."""

    T_link_surface: Float[np.ndarray, "4 4"]

    @abstractmethod
    def wrap(self, unrolled: Unrolled) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] on the surface."""

    @abstractmethod
    def unroll(self, positions: Points) -> Unrolled:
        """Return the unrolled coordinates (s, t) [m] of points on the surface [m]."""

    def fit_errors(
        self, positions: Points, normals: Points
    ) -> Float[np.ndarray, "point"]:
        """Return the distances of points [m] plus the errors of normals [rad]."""
        found = self.wrap(self.unroll(positions))
        distances = np.linalg.norm(found.positions - positions, axis=1)
        return distances + np.linalg.norm(found.normals - normals, axis=1)

    def to_surface_frame(self, positions: Points) -> Points:
        """Return points of the link in the surface's own frame [m]."""
        return apply(invert(self.T_link_surface), positions)


@final
@dataclass(frozen=True, eq=False)
class Plane(Surface):
    """A plane is z = 0 of its frame, with its outside toward +z; s is x and t is y."""

    T_link_surface: Float[np.ndarray, "4 4"]
    """Pose of the surface's frame in the link's frame."""

    def wrap(self, unrolled: Unrolled) -> SurfacePoints:
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

    def unroll(self, positions: Points) -> Unrolled:
        """Return the coordinates x and y in the plane [m]."""
        return self.to_surface_frame(positions)[:, :2]

    def fit_errors(
        self, positions: Points, normals: Points
    ) -> Float[np.ndarray, "point"]:
        """Return the distances from the plane [m] plus the errors of normals [rad]."""
        lean = np.linalg.norm(normals - self.T_link_surface[:3, 2], axis=1)
        return np.abs(self.to_surface_frame(positions)[:, 2]) + lean


@final
@dataclass(frozen=True, eq=False)
class Tube(Surface):
    """A tube is the outside of a cylinder along z of its frame.

    s runs around the tube by the right-hand rule about z, from 0 on the x axis to plus
    and minus half the circumference; t runs along z.
    """

    radius: float
    """Radius [m]."""
    T_link_surface: Float[np.ndarray, "4 4"]
    """Pose of the surface's frame in the link's frame."""

    def wrap(self, unrolled: Unrolled) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] around the tube."""
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

    def unroll(self, positions: Points) -> Unrolled:
        """Return the arcs from the x axis and the heights [m]."""
        x, y, z = self.to_surface_frame(positions).T
        return np.column_stack([self.radius * np.arctan2(y, x), z])


@final
@dataclass(frozen=True, eq=False)
class Dome(Surface):
    """A dome is a sphere about the origin of its frame, unrolled from its pole on +z.

    (s, t) are azimuthal equidistant coordinates: their length is the arc from the pole
    to the point [m], their direction its azimuth from x to y.
    """

    radius: float
    """Radius [m]."""
    T_link_surface: Float[np.ndarray, "4 4"]
    """Pose of the surface's frame in the link's frame."""

    def wrap(self, unrolled: Unrolled) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] over the dome."""
        angle = np.linalg.norm(unrolled, axis=1) / self.radius
        spread = np.sinc(angle / np.pi)
        flat = unrolled / self.radius
        outward = np.column_stack([spread[:, None] * flat, np.cos(angle)])
        # The x axis, transported from the pole to the point along a great circle.
        half = outward + np.array([0.0, 0.0, 1.0])
        transported = np.eye(3)[0] - (outward[:, 0] / half[:, 2])[:, None] * half
        return SurfacePoints(
            positions=apply(self.T_link_surface, self.radius * outward),
            normals=rotate(self.T_link_surface, outward),
            tangents=rotate(self.T_link_surface, transported),
            area_scale=spread,
        )

    def unroll(self, positions: Points) -> Unrolled:
        """Return the arcs from the pole, as vectors seen from above [m]."""
        local = self.to_surface_frame(positions)
        across = np.linalg.norm(local[:, :2], axis=1)
        arc = self.radius * np.arctan2(across, local[:, 2])
        return local[:, :2] * (arc / np.where(across > 0, across, 1.0))[:, None]


def fit_surface(positions: Points, normals: Points) -> Surface | None:
    """Fit a plane, else a tube, else a dome through all taxels; None where none fits.

    The middle of the taxels lies near (s, t) = (0, 0).
    """
    if len(positions) == 0:
        return None
    for fit in (fit_plane, fit_tube, fit_dome):
        surface = fit(positions, normals)
        if surface and np.max(surface.fit_errors(positions, normals)) < TOLERANCE:
            return surface
    return None


def fit_plane(positions: Points, normals: Points) -> Plane:
    """Fit the plane through the mean taxel, perpendicular to the mean normal."""
    return Plane(build_frame(normals.mean(axis=0), positions.mean(axis=0)))


def fit_tube(positions: Points, normals: Points) -> Tube | None:
    """Fit the tube with the axis to which all normals are perpendicular."""
    axis = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
    x_axis = find_perpendicular(axis, normals.mean(axis=0))
    across = np.column_stack([x_axis, np.cross(axis, x_axis)])
    radius, centre = fit_centre(positions @ across, normals @ across)
    if not radius > 0:
        return None
    middle = across @ centre + axis * (positions @ axis).mean()
    rotation = np.column_stack([across, axis])
    return Tube(radius, make_transform(rotation, middle))


def fit_dome(positions: Points, normals: Points) -> Dome | None:
    """Fit the sphere from whose centre all normals point, its pole amid the taxels."""
    radius, centre = fit_centre(positions, normals)
    if not radius > 0:
        return None
    return Dome(radius, build_frame(normals.mean(axis=0), centre))


def fit_centre(
    points: Float[np.ndarray, "taxel dim"], normals: Float[np.ndarray, "taxel dim"]
) -> tuple[float, Float[np.ndarray, "dim"]]:
    """Fit radius r and centre c such that p - r n = c, by least squares.

    The radius is 0 where all normals are parallel.
    """
    from_middle = points - points.mean(axis=0)
    spread = normals - normals.mean(axis=0)
    power = np.sum(spread**2)
    if power < TOLERANCE**2:
        return 0.0, points.mean(axis=0)
    radius = float(np.sum(from_middle * spread) / power)
    return radius, points.mean(axis=0) - radius * normals.mean(axis=0)


def build_frame(
    z_axis: Float[np.ndarray, "3"], origin: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """Build T_link_surface with a given z axis, and x nearest to the link's x axis.

    Where z lies along the link's x axis, x is nearest to its y axis.
    """
    length = np.linalg.norm(z_axis)
    z_axis = z_axis / length if length > TOLERANCE else np.array([0.0, 0.0, 1.0])
    x_axis = find_perpendicular(z_axis, np.eye(3)[0])
    rotation = np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis])
    return make_transform(rotation, origin)


def find_perpendicular(
    axis: Float[np.ndarray, "3"], preferred: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Find the unit vector perpendicular to a unit axis nearest to a preferred one."""
    for seed in (preferred, *np.eye(3)):
        across = seed - (seed @ axis) * axis
        length = np.linalg.norm(across)
        if length > 0.1 * max(float(np.linalg.norm(seed)), TOLERANCE):
            return across / length
    raise ValueError(f"axis {axis} is not a unit vector")
