"""This module finds which parts of a link's surface may carry skin."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from eskin.design.surface import LinkSurface, PointLocator
from eskin.extras import find_package
from eskin.robot import Joint, Kinematics, Robot
from eskin.robot.surface import compute_triangle_normals
from eskin.transforms import apply, invert

igl = find_package("igl", "libigl", "design", "skin design")

Points = Float[np.ndarray, "point 3"]
Vector = tuple[float, float, float]

DIRECTIONS = 96
"""Number of directions from which a point is looked at."""
MIN_COSINE = 0.1
"""Smallest cosine of such a direction with the normal."""
LIFT = 2e-4
"""Height above the surface from which is looked [m]."""
ABOVE = 0.9
"""Cosine above which the offset from a triangle points along its normal."""
SWEEP_STEP = 0.2
"""Largest step of a joint in a sweep from its lower to its upper limit [rad]."""
SLIDE_STEPS = 9
"""Number of positions of a prismatic joint in a sweep."""


class Zone(ABC):
    """A zone is a part of space in the frame of one link."""

    link: str

    @abstractmethod
    def contains(self, points: Points) -> Bool[np.ndarray, "point"]:
        """Return which points [m] lie in the zone."""


@final
@dataclass(frozen=True)
class LinkZone(Zone):
    """A link zone is the whole link."""

    link: str

    def contains(self, points: Points) -> Bool[np.ndarray, "point"]:
        """Return True for every point."""
        return np.ones(len(points), dtype=bool)


@final
@dataclass(frozen=True)
class BoxZone(Zone):
    """A box zone is aligned with the axes of the link."""

    link: str
    low: Vector
    """Smallest x, y and z [m]."""
    high: Vector
    """Largest x, y and z [m]."""

    def contains(self, points: Points) -> Bool[np.ndarray, "point"]:
        """Return which points [m] lie in the box."""
        return np.all((points >= self.low) & (points <= self.high), axis=1)


@final
@dataclass(frozen=True)
class BallZone(Zone):
    """A ball zone is all within a radius of a point."""

    link: str
    point: Vector
    """Centre [m]."""
    radius: float
    """Radius [m]."""

    def contains(self, points: Points) -> Bool[np.ndarray, "point"]:
        """Return which points [m] lie in the ball."""
        return np.linalg.norm(points - np.array(self.point), axis=1) <= self.radius


@final
@dataclass(frozen=True)
class PaintedZone(Zone):
    """A painted zone is all that lies in any of some balls."""

    link: str
    balls: tuple[BallZone, ...]
    """Balls, all on the same link."""

    def contains(self, points: Points) -> Bool[np.ndarray, "point"]:
        """Return which points [m] lie in a ball."""
        found = np.zeros(len(points), dtype=bool)
        for ball in self.balls:
            found |= ball.contains(points)
        return found


def compute_exposure(
    surface: LinkSurface, obstacle: LinkSurface
) -> Float[np.ndarray, "vertex"]:
    """Compute the fraction of the directions above each vertex that are free.

    The fraction is 1 on a convex surface, and 0 inside a closed cavity. It is computed
    at the triangles, and averaged by their areas.

    Args:
        surface: surface whose vertices are looked at.
        obstacle: the same surface, of fewer triangles.
    """
    corners = surface.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-30)[:, None]
    origins = corners.mean(axis=1) + LIFT * normals
    directions = build_directions(DIRECTIONS)
    face, direction = np.nonzero(normals @ directions.T > MIN_COSINE)
    mesh = trimesh.Trimesh(obstacle.vertices, obstacle.faces, process=False)
    blocked = mesh.ray.intersects_any(origins[face], directions[direction])
    tried = np.bincount(face, minlength=len(corners))
    free = np.bincount(face[~blocked], minlength=len(corners)) / np.maximum(tried, 1)
    around, total = np.zeros((2, len(surface.vertices)))
    for corner in surface.faces.T:
        np.add.at(around, corner, areas * free)
        np.add.at(total, corner, areas)
    return around / np.maximum(total, 1e-30)


def build_directions(count: int) -> Float[np.ndarray, "direction 3"]:
    """Build unit vectors that are spread evenly, on a spiral (Vogel 1979)."""
    index = np.arange(count) + 0.5
    angle, z = np.pi * (1 + np.sqrt(5)) * index, 1 - 2 * index / count
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z])


def find_swept_vertices(
    robot: Robot,
    fine: Mapping[str, LinkSurface],
    coarse: Mapping[str, LinkSurface],
    clearance: float,
) -> dict[str, Bool[np.ndarray, "vertex"]]:
    """Find the vertices that come close to another link.

    Links on both sides of a joint are compared while that joint moves from its lower
    to its upper limit, in steps of `SWEEP_STEP`; all others with the joints at 0.

    Args:
        robot: the robot.
        fine: surfaces of the links that are to carry skin, by their names.
        coarse: surfaces of all links that have one, of fewer triangles.
        clearance: distance below which a link is close [m].

    Returns:
        For each link in `fine` a mask of its vertices.
    """
    swept = {name: np.zeros(len(own.vertices), bool) for name, own in fine.items()}
    obstacles = {name: Obstacle(other) for name, other in coarse.items()}
    for name, other, T_other_own in iterate_relative_poses(robot, coarse):
        for a, b, T_b_a in (
            (name, other, T_other_own),
            (other, name, invert(T_other_own)),
        ):
            if a in fine:
                left = np.flatnonzero(~swept[a])
                points = apply(T_b_a, fine[a].vertices[left])
                swept[a][left] = obstacles[b].is_close(points, clearance)
    return swept


@final
class Obstacle:
    """An obstacle tells which points are near or inside a closed surface."""

    def __init__(self, surface: LinkSurface) -> None:
        """Build the trees of a surface."""
        self.locator = PointLocator(surface.vertices, surface.faces)
        self.winding = igl.FastWindingNumberBVH()
        self.winding.init(surface.vertices, surface.faces)
        self.normals = compute_triangle_normals(surface.corners)
        self.low = surface.vertices.min(axis=0)
        self.high = surface.vertices.max(axis=0)

    def is_close(self, points: Points, clearance: float) -> Bool[np.ndarray, "point"]:
        """Return which points are inside, or within a clearance [m] of the surface."""
        beyond = np.maximum(self.low - points, points - self.high).max(axis=1)
        close = np.zeros(len(points), dtype=bool)
        near = np.flatnonzero(beyond < clearance)
        if len(near) == 0:
            return close
        face, weights, distance = self.locator.locate(points[near])
        close[near] = distance < clearance
        corners = self.locator.vertices[self.locator.faces[face]]
        offset = points[near] - np.einsum("pk,pki->pi", weights, corners)
        # Straight above its nearest triangle a point is outside.
        above = np.sum(offset * self.normals[face], axis=1) > ABOVE * distance
        left = near[~above & (distance >= clearance)]
        if len(left):
            inside = self.winding.winding_number(np.ascontiguousarray(points[left]))
            close[left] = inside > 0.5
        return close


def iterate_relative_poses(
    robot: Robot, links: Mapping[str, LinkSurface]
) -> Iterator[tuple[str, str, Float[np.ndarray, "4 4"]]]:
    """Yield pairs of links and the pose T_second_first, in every sampled position."""
    kinematics = Kinematics(robot)
    rest = np.clip(0.0, robot.lower, robot.upper)
    index = {name: robot.link_index(name) for name in links}
    names = list(links)
    T = kinematics.poses(rest)
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            yield first, second, invert(T[index[second]]) @ T[index[first]]
    groups = group_rigid_links(robot)
    for number, joint in enumerate(robot.actuated_joints):
        sweep = sample_joint(joint)
        values = np.tile(rest, (len(sweep), 1))
        values[:, number] = sweep
        poses = kinematics.poses(values)
        parents = [n for n in names if groups[n] == groups[joint.parent]]
        children = [n for n in names if groups[n] == groups[joint.child]]
        for first in parents:
            for second in children:
                for T in poses:
                    yield first, second, invert(T[index[second]]) @ T[index[first]]


def sample_joint(joint: Joint) -> Float[np.ndarray, "sample"]:
    """Return values of a joint [rad] or [m], at most those of a full turn."""
    if joint.kind == "prismatic":
        return np.linspace(joint.lower, joint.upper, SLIDE_STEPS)
    low = joint.lower if np.isfinite(joint.lower) else -np.pi
    span = min(joint.upper - low, 2 * np.pi)
    return low + np.linspace(0.0, span, int(np.ceil(span / SWEEP_STEP)) + 1)


def group_rigid_links(robot: Robot) -> dict[str, str]:
    """Return for every link the first link of those that are fixed to it."""
    parent = {j.child: j.parent for j in robot.joints if j.kind == "fixed"}
    groups = {}
    for name in robot.link_names:
        root = name
        while root in parent:
            root = parent[root]
        groups[name] = root
    return groups
