"""This module finds the nearest of many triangles, and what they enclose."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

Points = Float[np.ndarray, "point 3"]
Triangles = Float[np.ndarray, "face 3 3"]

PAIRS_AT_ONCE = 200_000
"""Largest number of pairs of points and triangles that are processed at once."""
CHILDREN = 4
"""Number of nodes of a tree that are joined to one."""
SLACK = 0.05
"""Largest relative error of distances that need not be exact."""
FAR = 2.0
"""Distance from triangles over their radius from which they count as one."""
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class TreeLevel:
    """A level holds nodes, each of `CHILDREN` neighbours of the level below.

    The nodes of the lowest level are the triangles.
    """

    low: Float[np.ndarray, "node 3"]
    """Smallest coordinates of the triangles of each node [m]."""
    high: Float[np.ndarray, "node 3"]
    """Largest coordinates [m]."""
    largest: Int[np.ndarray, "node"]
    """Triangle with the longest side."""
    vector_area: Float[np.ndarray, "node 3"]
    """Sum of the triangles' outward normals times their areas [m2]."""
    area: Float[np.ndarray, "node"]
    """Sum of their areas [m2]."""
    moment: Float[np.ndarray, "node 3"]
    """Sum of their centres times their areas [m3]."""

    @cached_property
    def centre(self) -> Float[np.ndarray, "node 3"]:
        """Return the middles of the triangles, by their areas [m]."""
        return self.moment / np.maximum(self.area, TINY)[:, None]

    @cached_property
    def reach(self) -> Float[np.ndarray, "node"]:
        """Return the squares of the distances from which a node counts as one [m2]."""
        beyond = np.maximum(self.high - self.centre, self.centre - self.low)
        return FAR**2 * dot(beyond, beyond)

    def join(self, lengths: Float[np.ndarray, "face"]) -> "TreeLevel":
        """Return the level above, by the longest sides of all triangles [m]."""
        first = np.arange(0, len(self.low), CHILDREN)
        order = np.lexsort(
            [lengths[self.largest], np.arange(len(self.low)) // CHILDREN]
        )
        last = np.append(first[1:], len(self.low)) - 1
        return TreeLevel(
            np.minimum.reduceat(self.low, first),
            np.maximum.reduceat(self.high, first),
            self.largest[order[last]],
            np.add.reduceat(self.vector_area, first),
            np.add.reduceat(self.area, first),
            np.add.reduceat(self.moment, first),
        )


Visit = Callable[[int, Int[np.ndarray, "pair"], Int[np.ndarray, "pair"]], np.ndarray]


@final
class TriangleTree:
    """A tree of boxes around triangles, by which few are compared with each point.

    Triangles are neighbours where their centres are (Morton 1966).

    Attributes:
        corners: corners of the triangles, in the order of the tree [m].
        levels: levels of the tree, the triangles first.
    """

    def __init__(self, corners: Triangles) -> None:
        """Build the tree; its memory is some 300 bytes for each triangle."""
        centres = corners.mean(axis=1)
        # Ranks in place of coordinates: one triangle far away spoils no order.
        ranks = np.argsort(np.argsort(centres, axis=0), axis=0)
        code = np.zeros(len(corners), dtype=np.int64)
        for bit in range(int(len(corners)).bit_length()):
            for axis in range(3):
                code |= (ranks[:, axis] >> bit & 1) << (3 * bit + axis)
        order = np.argsort(code)
        self.corners = corners[order]
        centres = centres[order]
        a, b, c = np.moveaxis(self.corners, 1, 0)
        lengths = np.max([np.sum(e**2, axis=1) for e in (b - a, c - b, a - c)], axis=0)
        vector_area = np.cross(b - a, c - a) / 2
        area = np.linalg.norm(vector_area, axis=1)
        level = TreeLevel(
            self.corners.min(axis=1),
            self.corners.max(axis=1),
            np.arange(len(corners)),
            vector_area,
            area,
            centres * area[:, None],
        )
        self.levels = [level]
        while len(level.low) > CHILDREN:
            level = level.join(lengths)
            self.levels.append(level)

    def descend(self, count: int, visit: Visit) -> None:
        """Visit pairs of points and nodes, a part at a time, from the top on.

        Args:
            count: number of points.
            visit: function of the level and the indices of points and of nodes, which
                returns the pairs whose children are visited too.
        """
        top = len(self.levels[-1].low)
        waiting = [
            (
                len(self.levels) - 1,
                np.repeat(np.arange(count), top),
                np.tile(np.arange(top), count),
            )
        ]
        while waiting:
            level, point, node = waiting.pop()
            if len(point) > PAIRS_AT_ONCE:
                half = len(point) // 2
                waiting.append((level, point[half:], node[half:]))
                waiting.append((level, point[:half], node[:half]))
                continue
            into = visit(level, point, node)
            if level and into.any():
                below = (CHILDREN * node[into, None] + np.arange(CHILDREN)).ravel()
                own = np.repeat(point[into], CHILDREN)
                real = below < len(self.levels[level - 1].low)
                waiting.append((level - 1, own[real], below[real]))

    def find_nearest(
        self, points: Points, exact_to: float = np.inf
    ) -> tuple[Triangles, Points]:
        """Return the nearest triangle of each point, and the nearest point on it.

        Args:
            points: the points [m].
            exact_to: distance beyond which one is taken that is not further than the
                nearest by more than `SLACK` [m]. To the middle of a ball all triangles
                are nearly as near.
        """
        face = np.zeros(len(points), dtype=np.int64)
        nearest = np.zeros_like(points)
        best = np.full(len(points), np.inf)
        wanted = best.copy()

        def visit(level: int, point: np.ndarray, node: np.ndarray) -> np.ndarray:
            own = self.levels[level]
            beyond = np.maximum(own.low[node] - points[point], 0.0)
            beyond += np.maximum(points[point] - own.high[node], 0.0)
            least = dot(beyond, beyond)
            near = np.flatnonzero(least < wanted[point])
            # The largest triangle of a node bounds the distance from above.
            tried = point[near]
            triangle = own.largest[node[near]]
            found = find_nearest_points(self.corners[triangle], points[tried])
            square = np.sum((points[tried] - found) ** 2, axis=-1)
            np.minimum.at(best, tried, square)
            won = square == best[tried]
            face[tried[won]] = triangle[won]
            nearest[tried[won]] = found[won]
            loose = best > exact_to**2
            wanted[:] = np.where(loose, best / (1 + SLACK) ** 2, best)
            return least < wanted[point]

        self.descend(len(points), visit)
        return self.corners[face], nearest

    def compute_winding_numbers(self, points: Points) -> Float[np.ndarray, "point"]:
        """Compute the winding number of each point: 1 inside a closed mesh, 0 outside.

        It is the sum of the solid angles (Van Oosterom and Strackee 1983), which holds
        for overlapping meshes and degrades smoothly at holes (Jacobson et al. 2013).
        From afar, triangles count as one (Barill et al. 2018), to within 0.05.
        """
        angle = np.zeros(len(points))

        def visit(level: int, point: np.ndarray, node: np.ndarray) -> np.ndarray:
            own = self.levels[level]
            if level == 0:
                solid = compute_solid_angles(self.corners[node], points[point])
                angle[:] += np.bincount(point, solid, len(points))
                return np.zeros(len(point), dtype=bool)
            offset = own.centre[node] - points[point]
            square = dot(offset, offset)
            far = square > own.reach[node]
            flux = dot(offset[far], own.vector_area[node[far]])
            solid = flux / square[far] ** 1.5
            angle[:] += np.bincount(point[far], solid, len(points))
            return ~far

        self.descend(len(points), visit)
        return angle / (4 * np.pi)


def compute_solid_angles(
    corners: Triangles, points: Points
) -> Float[np.ndarray, "pair"]:
    """Compute the solid angle of a triangle at each point [sr]."""
    a, b, c = np.moveaxis(corners - points[:, None], 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    volume = dot(a, np.cross(b, c))
    cosine = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return 2 * np.arctan2(volume, cosine)


def find_nearest_points(corners: Triangles, points: Points) -> Points:
    """Return the nearest point on a triangle to each point."""
    normals = compute_triangle_normals(corners)
    height = dot(points - corners[:, 0], normals)
    flat = points - height[:, None] * normals
    over = np.any(normals != 0, axis=-1) & are_inside_edges(corners, normals, flat)
    best = np.where(over[:, None], flat, 0.0)
    shortest = np.where(over, height**2, np.inf)
    for i in range(3):
        start, end = corners[:, i], corners[:, (i + 1) % 3]
        edge = end - start
        square = np.maximum(dot(edge, edge), TINY)
        along = np.clip(dot(points - start, edge) / square, 0.0, 1.0)
        on_edge = start + along[:, None] * edge
        length = np.sum((points - on_edge) ** 2, axis=-1)
        closer = length < shortest
        best = np.where(closer[:, None], on_edge, best)
        shortest = np.where(closer, length, shortest)
    return best


def are_inside_edges(
    corners: Triangles, normals: Points, flat: Points
) -> Bool[np.ndarray, "pair"]:
    """Return whether points in the planes of triangles lie inside the triangles."""
    inside = np.ones(len(flat), dtype=bool)
    for i in range(3):
        start, end = corners[:, i], corners[:, (i + 1) % 3]
        inside &= dot(np.cross(end - start, flat - start), normals) >= 0
    return inside


def compute_triangle_normals(corners: Triangles) -> Float[np.ndarray, "face 3"]:
    """Compute unit normals, which are zero for triangles without area."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def dot(
    a: Float[np.ndarray, "*#batch 3"], b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*out"]:
    """Return the inner product over the last axis."""
    return np.einsum("...i,...i->...", a, b)
