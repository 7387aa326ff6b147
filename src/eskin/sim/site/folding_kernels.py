"""Compiled search for skin that faces skin. `no_type_check` keeps hooks off it."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled


@compiled
@no_type_check
def placed_points(
    T: Float[np.ndarray, "4 4"], local: Float[np.ndarray, "3"], shifted: float
) -> tuple[float, float, float]:
    """A point (shifted 1) or a direction (shifted 0) of a link in the world."""
    x = T[0, 0] * local[0] + T[0, 1] * local[1] + T[0, 2] * local[2]
    y = T[1, 0] * local[0] + T[1, 1] * local[1] + T[1, 2] * local[2]
    z = T[2, 0] * local[0] + T[2, 1] * local[1] + T[2, 2] * local[2]
    return x + shifted * T[0, 3], y + shifted * T[1, 3], z + shifted * T[2, 3]


@compiled
@no_type_check
def facing_gaps(
    points: Float[np.ndarray, "point 3"],
    normals: Float[np.ndarray, "point 3"],
    starts: Int[np.ndarray, "chart_and_one"],
    links: Int[np.ndarray, "chart"],
    balls: Float[np.ndarray, "chart 4"],
    pairs: Int[np.ndarray, "pair 2"],
    T_world_link: Float[np.ndarray, "pose link 4 4"],
    thinnest: float,
    within: float,
    cosine: float,
) -> tuple[Float[np.ndarray, "pose pair"], Int[np.ndarray, "pose pair 2"]]:
    """Least distance of points of two charts that face each other, and which two [m].

    Infinite, and -1, where none do between `thinnest` and `within`.
    """
    poses = len(T_world_link)
    gaps = np.full((poses, len(pairs)), np.inf)
    which = np.full((poses, len(pairs), 2), -1)
    world = np.empty((len(points), 6))
    middles = np.empty((len(links), 3))
    for pose in range(poses):
        for chart in range(len(links)):
            T = T_world_link[pose, links[chart]]
            x, y, z = placed_points(T, balls[chart, :3], 1.0)
            middles[chart, 0], middles[chart, 1], middles[chart, 2] = x, y, z
            for i in range(starts[chart], starts[chart + 1]):
                x, y, z = placed_points(T, points[i], 1.0)
                world[i, 0], world[i, 1], world[i, 2] = x, y, z
                x, y, z = placed_points(T, normals[i], 0.0)
                world[i, 3], world[i, 4], world[i, 5] = x, y, z
        for pair in range(len(pairs)):
            one, other = pairs[pair]
            apart = 0.0
            for axis in range(3):
                apart += (middles[one, axis] - middles[other, axis]) ** 2
            if np.sqrt(apart) > within + balls[one, 3] + balls[other, 3]:
                continue
            best = within * within
            beyond = (within + balls[other, 3]) ** 2
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
                    which[pose, pair, 0], which[pose, pair, 1] = i, j
            if which[pose, pair, 0] >= 0:
                gaps[pose, pair] = np.sqrt(best)
    return gaps, which
