"""Finding the plane, tube or dome that taxels lie on, from the taxels alone."""

import numpy as np
from jaxtyping import Float

from eskin.skin.round import Dome, Tube
from eskin.skin.surface import Plane, Surface
from eskin.transforms import make_transform

__all__ = ["fit_surface"]

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
