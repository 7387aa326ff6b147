"""Compiled distances of cylinders. `no_type_check` keeps the tests' hooks off them."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit


class Rods(NamedTuple):
    """Cylinders in the frames of their links."""

    links: np.ndarray
    """Index of the link of each (rod)."""
    centres: np.ndarray
    """[m] (rod, 3)"""
    axes: np.ndarray
    """Unit directions (rod, 3)."""
    radii: np.ndarray
    """[m] (rod)"""
    halves: np.ndarray
    """Half lengths [m] (rod)."""


ROUNDS = 100
CLOSE = 2e-5
"""Distances are found to this [m], from below."""


@njit(cache=True)
@no_type_check
def placed(
    rods: Rods, T_world_link: Float[np.ndarray, "link 4 4"]
) -> tuple[Float[np.ndarray, "rod 3"], Float[np.ndarray, "rod 3"]]:
    """Centres and axes in the world."""
    count = len(rods.links)
    centres, axes = np.empty((count, 3)), np.empty((count, 3))
    for rod in range(count):
        T = T_world_link[rods.links[rod]]
        for i in range(3):
            centre, axis = T[i, 3], 0.0
            for j in range(3):
                centre += T[i, j] * rods.centres[rod, j]
                axis += T[i, j] * rods.axes[rod, j]
            centres[rod, i], axes[rod, i] = centre, axis
    return centres, axes


@njit(cache=True)
@no_type_check
def dot(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
@no_type_check
def axis_points(
    c: Float[np.ndarray, "3"],
    a: Float[np.ndarray, "3"],
    h: float,
    e: Float[np.ndarray, "3"],
    b: Float[np.ndarray, "3"],
    k: float,
) -> tuple[float, float]:
    """Where two axes come nearest, from their middles (Ericson 2005, 5.1.9) [m]."""
    r = c - e
    ab, ar, br = dot(a, b), dot(a, r), dot(b, r)
    flat = 1.0 - ab * ab
    u = 0.0
    if flat > 1e-12:
        u = min(max((ab * br - ar) / flat, -h), h)
    v = min(max(ab * u + br, -k), k)
    u = min(max(ab * v - ar, -h), h)
    return u, v


@njit(cache=True)
@no_type_check
def nearest(
    p: Float[np.ndarray, "3"],
    c: Float[np.ndarray, "3"],
    a: Float[np.ndarray, "3"],
    radius: float,
    half: float,
) -> Float[np.ndarray, "3"]:
    """The point of a solid cylinder that is nearest to p."""
    d = p - c
    along = dot(d, a)
    across = d - along * a
    out = np.sqrt(dot(across, across))
    if out > radius:
        across *= radius / out
    return c + min(max(along, -half), half) * a + across


@njit(cache=True)
@no_type_check
def reach(
    n: Float[np.ndarray, "3"], a: Float[np.ndarray, "3"], radius: float, half: float
) -> float:
    """How far a cylinder reaches from its centre in a direction [m]."""
    along = dot(n, a)
    return abs(along) * half + radius * np.sqrt(max(1.0 - along * along, 0.0))


@njit(cache=True)
@no_type_check
def between(
    c: Float[np.ndarray, "3"],
    a: Float[np.ndarray, "3"],
    r: float,
    h: float,
    e: Float[np.ndarray, "3"],
    b: Float[np.ndarray, "3"],
    s: float,
    k: float,
    enough: float,
) -> float:
    """Distance of two solid cylinders, never too large; 0 where they meet [m].

    Capsules about them settle what is farther apart than `enough`. The rest is found by
    projecting to and fro, with the plane between as a bound from below.
    """
    u, v = axis_points(c, a, h, e, b, k)
    p = c + u * a
    gap = e + v * b - p
    capsule = np.sqrt(dot(gap, gap)) - r - s
    if capsule >= enough:
        return capsule
    best = max(capsule, 0.0)
    for _ in range(ROUNDS):
        q = nearest(p, e, b, s, k)
        p = nearest(q, c, a, r, h)
        gap = q - p
        length = np.sqrt(dot(gap, gap))
        if length < CLOSE:
            return best
        n = gap / length
        below = dot(n, e - c) - reach(n, a, r, h) - reach(n, b, s, k)
        best = max(best, below)
        if length - best < CLOSE:
            break
    return best


@njit(cache=True)
@no_type_check
def clearances(
    rods: Rods,
    pairs: Int[np.ndarray, "pair 2"],
    free: Int[np.ndarray, "free"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
    enough: float,
) -> Float[np.ndarray, "pose 2"]:
    """Least distance of pairs of rods, and least height of the free ones [m].

    What is farther than `enough` may be given as any distance beyond.
    """
    found = np.empty((len(T_world_link), 2))
    for pose in range(len(T_world_link)):
        centres, axes = placed(rods, T_world_link[pose])
        low = np.inf
        for rod in free:
            up = abs(axes[rod, 2])
            below = up * rods.halves[rod] + rods.radii[rod] * np.sqrt(
                max(1.0 - up * up, 0.0)
            )
            low = min(low, centres[rod, 2] - below)
        least = np.inf
        for one, other in pairs:
            gap = between(
                centres[one],
                axes[one],
                rods.radii[one],
                rods.halves[one],
                centres[other],
                axes[other],
                rods.radii[other],
                rods.halves[other],
                min(enough, least),
            )
            least = min(least, gap)
        found[pose, 0], found[pose, 1] = least, low
    return found


@njit(cache=True)
@no_type_check
def rooms(
    rods: Rods,
    T_world_link: Float[np.ndarray, "link 4 4"],
    points: Float[np.ndarray, "point 3"],
    others: Int[np.ndarray, "other"],
) -> tuple[Float[np.ndarray, "point"], Int[np.ndarray, "point"]]:
    """Distance of points of the world from the nearest of some rods, and which [m]."""
    centres, axes = placed(rods, T_world_link)
    found = np.full(len(points), np.inf)
    which = np.full(len(points), -1)
    for i in range(len(points)):
        for rod in others:
            at = nearest(
                points[i], centres[rod], axes[rod], rods.radii[rod], rods.halves[rod]
            )
            gap = points[i] - at
            length = np.sqrt(dot(gap, gap))
            if length < found[i]:
                found[i], which[i] = length, rod
    return found, which
