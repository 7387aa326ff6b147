"""Compiled geometry of a few points, boxes and links."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled


@compiled
@no_type_check
def place(
    taxels: Int[np.ndarray, "asked"],
    vectors: Float[np.ndarray, "taxel 3"],
    links: Int[np.ndarray, "taxel"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    moved: float,
) -> Float[np.ndarray, "asked 3"]:
    """Vectors in the world: points where `moved` is 1, directions where it is 0."""
    result = np.empty((len(taxels), 3))
    for a in range(len(taxels)):
        i = taxels[a]
        T = T_world_link[links[i]]
        for r in range(3):
            result[a, r] = moved * T[r, 3] + (
                T[r, 0] * vectors[i, 0]
                + T[r, 1] * vectors[i, 1]
                + T[r, 2] * vectors[i, 2]
            )
    return result


@compiled
@no_type_check
def to_link(
    T_world_link: Float[np.ndarray, "4 4"],
    p_world: Float[np.ndarray, "3"],
    out: Float[np.ndarray, "3"],
) -> None:
    """Write a point in the world in the frame of a link [m]."""
    for c in range(3):
        total = 0.0
        for r in range(3):
            total += (p_world[r] - T_world_link[r, 3]) * T_world_link[r, c]
        out[c] = total


@compiled
@no_type_check
def distance_to(
    T_world_link: Float[np.ndarray, "4 4"],
    p_link: Float[np.ndarray, "3"],
    p_world: Float[np.ndarray, "3"],
) -> float:
    """How far a point fixed to a link is from one in the world [m]."""
    squared = 0.0
    for r in range(3):
        T = T_world_link[r]
        here = T[0] * p_link[0] + T[1] * p_link[1] + T[2] * p_link[2] + T[3]
        squared += (p_world[r] - here) ** 2
    return np.sqrt(squared)


@compiled
@no_type_check
def distance(one: Float[np.ndarray, "3"], other: Float[np.ndarray, "3"]) -> float:
    """How far two points are from each other [m]."""
    squared = 0.0
    for r in range(3):
        squared += (one[r] - other[r]) ** 2
    return np.sqrt(squared)


@compiled
@no_type_check
def box_of(points: Float[np.ndarray, "point 3"], box: Float[np.ndarray, "2 3"]) -> None:
    """Write the least and the greatest coordinates of some points."""
    for r in range(3):
        low, high = np.inf, -np.inf
        for a in range(len(points)):
            low, high = min(low, points[a, r]), max(high, points[a, r])
        box[0, r], box[1, r] = low, high


@compiled
@no_type_check
def box_gap(one: Float[np.ndarray, "2 3"], other: Float[np.ndarray, "2 3"]) -> float:
    """How far two boxes are apart along an axis; no points in them are nearer."""
    gap = 0.0
    for r in range(3):
        gap = max(gap, one[0, r] - other[1, r], other[0, r] - one[1, r])
    return gap


@compiled
@no_type_check
def point_gap(point: Float[np.ndarray, "3"], box: Float[np.ndarray, "2 3"]) -> float:
    """How far a point is from a box along an axis."""
    gap = 0.0
    for r in range(3):
        gap = max(gap, box[0, r] - point[r], point[r] - box[1, r])
    return gap
