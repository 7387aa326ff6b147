"""Compiled kernels compute distances of cylinders and gaps between facing patches."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.sim.contact.kernels import dot


class CylinderArrays(NamedTuple):
    """This tuple holds cylinders in the frames of their links."""

    links: np.ndarray
    """Index of the link of each (cylinder)."""
    centres: np.ndarray
    """Centres (cylinder, 3) [m]."""
    axes: np.ndarray
    """Unit directions (cylinder, 3)."""
    radii: np.ndarray
    """Radii (cylinder) [m]."""
    half_lengths: np.ndarray
    """Half lengths (cylinder) [m]."""


MAX_ITERATIONS = 100
DISTANCE_TOLERANCE = 2e-5
"""Accuracy of distances, which are lower bounds [m]."""


@compiled
@no_type_check
def place_cylinders(
    cylinders: CylinderArrays, T_world_link: Float[np.ndarray, "link 4 4"]
) -> tuple[Float[np.ndarray, "cylinder 3"], Float[np.ndarray, "cylinder 3"]]:
    """Return centres and axes in the world."""
    count = len(cylinders.links)
    centres = np.empty((count, 3))
    axes = np.empty((count, 3))
    for cylinder in range(count):
        T = T_world_link[cylinders.links[cylinder]]
        for i in range(3):
            centre = T[i, 3]
            axis = 0.0
            for j in range(3):
                centre += T[i, j] * cylinders.centres[cylinder, j]
                axis += T[i, j] * cylinders.axes[cylinder, j]
            centres[cylinder, i] = centre
            axes[cylinder, i] = axis
    return centres, axes


@compiled
@no_type_check
def find_nearest_axis_points(
    c: Float[np.ndarray, "3"],
    a: Float[np.ndarray, "3"],
    h: float,
    e: Float[np.ndarray, "3"],
    b: Float[np.ndarray, "3"],
    k: float,
) -> tuple[float, float]:
    """Return the nearest points of two segments, from their centres [m].

    Ericson 2005, section 5.1.9.
    """
    x, y, z = c[0] - e[0], c[1] - e[1], c[2] - e[2]
    ab = dot(a, b)
    ar = x * a[0] + y * a[1] + z * a[2]
    br = x * b[0] + y * b[1] + z * b[2]
    flat = 1.0 - ab * ab
    u = 0.0
    if flat > 1e-12:
        u = min(max((ab * br - ar) / flat, -h), h)
    v = min(max(ab * u + br, -k), k)
    u = min(max(ab * v - ar, -h), h)
    return u, v


@compiled
@no_type_check
def find_nearest_point(
    p: tuple[float, float, float],
    c: Float[np.ndarray, "3"],
    a: Float[np.ndarray, "3"],
    radius: float,
    half: float,
) -> tuple[float, float, float]:
    """Return the point of a solid cylinder that is nearest to p."""
    x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    along = x * a[0] + y * a[1] + z * a[2]
    x, y, z = x - along * a[0], y - along * a[1], z - along * a[2]
    out = np.sqrt(x * x + y * y + z * z)
    share = radius / out if out > radius else 1.0
    up = min(max(along, -half), half)
    return (
        c[0] + up * a[0] + share * x,
        c[1] + up * a[1] + share * y,
        c[2] + up * a[2] + share * z,
    )


@compiled
@no_type_check
def compute_extent(
    n: tuple[float, float, float],
    a: Float[np.ndarray, "3"],
    radius: float,
    half: float,
) -> float:
    """Return how far a cylinder extends from its centre in a direction [m]."""
    along = n[0] * a[0] + n[1] * a[1] + n[2] * a[2]
    return abs(along) * half + radius * np.sqrt(max(1.0 - along * along, 0.0))


@compiled
@no_type_check
def compute_distance(
    p: tuple[float, float, float], q: tuple[float, float, float]
) -> float:
    """Return the distance between two points [m]."""
    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    return np.sqrt(x * x + y * y + z * z)


@compiled
@no_type_check
def compute_cylinder_distance(
    c: Float[np.ndarray, "3"],
    a: Float[np.ndarray, "3"],
    r: float,
    h: float,
    e: Float[np.ndarray, "3"],
    b: Float[np.ndarray, "3"],
    s: float,
    k: float,
    exact_within: float,
) -> float:
    """Return a lower bound of the distance between two solid cylinders [m].

    It is 0 where they intersect. Beyond `exact_within` it is the distance of the
    enclosing capsules. Otherwise it is accurate to `DISTANCE_TOLERANCE`, by alternating
    projections with a separating plane as the bound.
    """
    u, v = find_nearest_axis_points(c, a, h, e, b, k)
    p = (c[0] + u * a[0], c[1] + u * a[1], c[2] + u * a[2])
    q = (e[0] + v * b[0], e[1] + v * b[1], e[2] + v * b[2])
    capsule = compute_distance(p, q) - r - s
    if capsule >= exact_within:
        return capsule
    best = max(capsule, 0.0)
    for _ in range(MAX_ITERATIONS):
        q = find_nearest_point(p, e, b, s, k)
        p = find_nearest_point(q, c, a, r, h)
        length = compute_distance(p, q)
        if length < DISTANCE_TOLERANCE:
            return best
        n = (
            (q[0] - p[0]) / length,
            (q[1] - p[1]) / length,
            (q[2] - p[2]) / length,
        )
        middles = n[0] * (e[0] - c[0]) + n[1] * (e[1] - c[1]) + n[2] * (e[2] - c[2])
        best = max(
            best, middles - compute_extent(n, a, r, h) - compute_extent(n, b, s, k)
        )
        if length - best < DISTANCE_TOLERANCE:
            break
    return best


@compiled
@no_type_check
def compute_clearances(
    cylinders: CylinderArrays,
    pairs: Int[np.ndarray, "pair 2"],
    free: Int[np.ndarray, "free"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
    exact_within: float,
) -> Float[np.ndarray, "pose 2"]:
    """Return the least distance of pairs and the least height of free cylinders [m].

    Distances beyond `exact_within` are only lower bounds.
    """
    found = np.empty((len(T_world_link), 2))
    for pose in range(len(T_world_link)):
        centres, axes = place_cylinders(cylinders, T_world_link[pose])
        low = np.inf
        for cylinder in free:
            radius = cylinders.radii[cylinder]
            half = cylinders.half_lengths[cylinder]
            extent = compute_extent((0.0, 0.0, 1.0), axes[cylinder], radius, half)
            low = min(low, centres[cylinder, 2] - extent)
        least = np.inf
        for one, other in pairs:
            gap = compute_cylinder_distance(
                centres[one],
                axes[one],
                cylinders.radii[one],
                cylinders.half_lengths[one],
                centres[other],
                axes[other],
                cylinders.radii[other],
                cylinders.half_lengths[other],
                min(exact_within, least),
            )
            least = min(least, gap)
        found[pose, 0] = least
        found[pose, 1] = low
    return found


@compiled
@no_type_check
def compute_point_distances(
    cylinders: CylinderArrays,
    T_world_link: Float[np.ndarray, "link 4 4"],
    points: Float[np.ndarray, "point 3"],
    others: Int[np.ndarray, "other"],
) -> tuple[Float[np.ndarray, "point"], Int[np.ndarray, "point"]]:
    """Return the distance of points to the nearest cylinder [m], and its index."""
    centres, axes = place_cylinders(cylinders, T_world_link)
    found = np.full(len(points), np.inf)
    which = np.full(len(points), -1)
    for i in range(len(points)):
        p = (points[i, 0], points[i, 1], points[i, 2])
        for cylinder in others:
            at = find_nearest_point(
                p,
                centres[cylinder],
                axes[cylinder],
                cylinders.radii[cylinder],
                cylinders.half_lengths[cylinder],
            )
            length = compute_distance(p, at)
            if length < found[i]:
                found[i] = length
                which[i] = cylinder
    return found, which


@compiled
@no_type_check
def transform_point(
    T: Float[np.ndarray, "4 4"], local: Float[np.ndarray, "3"], shifted: float
) -> tuple[float, float, float]:
    """Transform a link's point (shifted 1) or direction (shifted 0) to the world."""
    x = T[0, 0] * local[0] + T[0, 1] * local[1] + T[0, 2] * local[2]
    y = T[1, 0] * local[0] + T[1, 1] * local[1] + T[1, 2] * local[2]
    z = T[2, 0] * local[0] + T[2, 1] * local[1] + T[2, 2] * local[2]
    return x + shifted * T[0, 3], y + shifted * T[1, 3], z + shifted * T[2, 3]


@compiled
@no_type_check
def find_facing_points(
    points: Float[np.ndarray, "point 3"],
    normals: Float[np.ndarray, "point 3"],
    starts: Int[np.ndarray, "chart_and_one"],
    links: Int[np.ndarray, "chart"],
    spheres: Float[np.ndarray, "chart 4"],
    pairs: Int[np.ndarray, "pair 2"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
    thinnest: float,
    within: float,
    cosine: float,
) -> tuple[Float[np.ndarray, "pose pair"], Int[np.ndarray, "pose pair 2"]]:
    """Find the least distance of facing points of two charts, and which two [m].

    Distances are infinite, and indices -1, where no points face each other between
    `thinnest` and `within`.
    """
    poses = len(T_world_link)
    gaps = np.full((poses, len(pairs)), np.inf)
    which = np.full((poses, len(pairs), 2), -1)
    world = np.empty((len(points), 6))
    middles = np.empty((len(links), 3))
    for pose in range(poses):
        for chart in range(len(links)):
            T = T_world_link[pose, links[chart]]
            x, y, z = transform_point(T, spheres[chart, :3], 1.0)
            middles[chart, 0] = x
            middles[chart, 1] = y
            middles[chart, 2] = z
            for i in range(starts[chart], starts[chart + 1]):
                x, y, z = transform_point(T, points[i], 1.0)
                world[i, 0] = x
                world[i, 1] = y
                world[i, 2] = z
                x, y, z = transform_point(T, normals[i], 0.0)
                world[i, 3] = x
                world[i, 4] = y
                world[i, 5] = z
        for pair in range(len(pairs)):
            one, other = pairs[pair]
            apart = 0.0
            for axis in range(3):
                apart += (middles[one, axis] - middles[other, axis]) ** 2
            if np.sqrt(apart) > within + spheres[one, 3] + spheres[other, 3]:
                continue
            best = within * within
            beyond = (within + spheres[other, 3]) ** 2
            for i in range(starts[one], starts[one + 1]):
                a = world[i]
                apart = 0.0
                for axis in range(3):
                    apart += (a[axis] - middles[other, axis]) ** 2
                if apart > beyond:
                    continue
                for j in range(starts[other], starts[other + 1]):
                    b = world[j]
                    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
                    square = x * x + y * y + z * z
                    if square >= best or square < thinnest * thinnest:
                        continue
                    least = cosine * np.sqrt(square)
                    if x * a[3] + y * a[4] + z * a[5] < least:
                        continue
                    if x * b[3] + y * b[4] + z * b[5] > -least:
                        continue
                    if a[3] * b[3] + a[4] * b[4] + a[5] * b[5] > -cosine:
                        continue
                    best = square
                    which[pose, pair, 0] = i
                    which[pose, pair, 1] = j
            if which[pose, pair, 0] >= 0:
                gaps[pose, pair] = np.sqrt(best)
    return gaps, which
