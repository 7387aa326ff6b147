"""This module finds which parts of a link's surface may carry skin."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from eskin.design.surface import LinkSurface, PointLocator
from eskin.progress import track_progress
from eskin.registry import find_package
from eskin.robot import Joint, Kinematics, Robot
from eskin.robot.triangles import compute_triangle_normals
from eskin.transforms import apply, invert

igl = find_package("igl", "libigl", "design", "skin design")

Points = Float[np.ndarray, "point 3"]
Vector = tuple[float, float, float]

DIRECTIONS = 96
"""Number of directions from which a point is looked at."""
FACES_AT_ONCE = 20_000
"""Number of triangles that are looked at once, which bounds the memory."""
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
STRETCH = 1.5
"""Range of sampled positions over the joint's; positions beyond are at its limits."""


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
    areas = np.linalg.norm(surface.doubled_normals, axis=1)
    normals = surface.doubled_normals / np.maximum(areas, 1e-30)[:, None]
    origins = surface.corners.mean(axis=1) + LIFT * normals
    directions = build_directions(DIRECTIONS)
    mesh = trimesh.Trimesh(obstacle.vertices, obstacle.faces, process=False)
    free = np.zeros(len(areas))
    for start in range(0, len(areas), FACES_AT_ONCE):
        part = slice(start, start + FACES_AT_ONCE)
        seen = normals[part] @ directions.T > MIN_COSINE
        face, direction = np.nonzero(seen)
        blocked = mesh.ray.intersects_any(origins[part][face], directions[direction])
        count = np.bincount(face[~blocked], minlength=len(seen))
        free[part] = count / np.maximum(seen.sum(axis=1), 1)
    total = surface.sum_at_vertices(areas)
    return surface.sum_at_vertices(areas * free) / np.maximum(total, 1e-30)


def build_directions(count: int) -> Float[np.ndarray, "direction 3"]:
    """Build unit vectors that are spread evenly, on a spiral (Vogel 1979)."""
    index = np.arange(count) + 0.5
    angle = np.pi * (1 + np.sqrt(5)) * index
    z = 1 - 2 * index / count
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z])


RelativePose = tuple[str, str, Float[np.ndarray, "4 4"]]
"""Names of two links, and the pose T_second_first."""


def find_close_points(
    points: Mapping[str, Points],
    surfaces: Mapping[str, LinkSurface],
    poses: Iterable[RelativePose],
    clearance: float,
) -> dict[str, Bool[np.ndarray, "point"]]:
    """Find the points that come close to another link in some poses.

    Args:
        points: points of links in their frames, by the names of the links [m].
        surfaces: surfaces of the links that may come close, by their names.
        poses: poses of pairs of links.
        clearance: distance below which a link is close [m].

    Returns:
        For each link in `points` a mask of its points.
    """
    close = {name: np.zeros(len(own), bool) for name, own in points.items()}
    boxes = {name: BoundingBox(own) for name, own in points.items() if len(own)}
    obstacles = {name: Obstacle(other) for name, other in surfaces.items()}
    for name, other, T_other_own in poses:
        for a, b, T_b_a in (
            (name, other, T_other_own),
            (other, name, invert(T_other_own)),
        ):
            if a not in boxes or not boxes[a].reaches(
                obstacles[b].box, T_b_a, clearance
            ):
                continue
            left = np.flatnonzero(~close[a])
            placed = apply(T_b_a, points[a][left])
            close[a][left] = obstacles[b].is_close(placed, clearance)
    return close


@final
class BoundingBox:
    """A bounding box holds points, along the axes of their frame."""

    def __init__(self, points: Points) -> None:
        """Find the box of some points [m]."""
        self.low, self.high = points.min(axis=0), points.max(axis=0)

    def reaches(
        self, other: "BoundingBox", T: Float[np.ndarray, "4 4"], clearance: float
    ) -> bool:
        """Return False only where all points are further from another box than this.

        Args:
            other: box in another frame.
            T: pose of this box's frame in the other's.
            clearance: distance [m].
        """
        centre = T[:3, :3] @ (self.low + self.high) / 2 + T[:3, 3]
        half = np.abs(T[:3, :3]) @ (self.high - self.low) / 2
        apart = np.maximum(other.low - centre, centre - other.high) - half
        return bool(apart.max() < clearance)


@final
class Obstacle:
    """An obstacle tells which points are near or inside a closed surface."""

    def __init__(self, surface: LinkSurface) -> None:
        """Build the trees of a surface."""
        self.locator = PointLocator(surface.vertices, surface.faces)
        self.winding = igl.FastWindingNumberBVH()
        self.winding.init(surface.vertices, surface.faces)
        self.normals = compute_triangle_normals(surface.corners)
        self.box = BoundingBox(surface.vertices)

    def is_close(self, points: Points, clearance: float) -> Bool[np.ndarray, "point"]:
        """Return which points are inside, or within a clearance [m] of the surface."""
        low, high = self.box.low, self.box.high
        beyond = np.maximum(low - points, points - high).max(axis=1)
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
    robot: Robot, links: Sequence[str]
) -> Iterator[RelativePose]:
    """Yield the poses of pairs of links while one joint moves at a time.

    Links on both sides of a joint are compared while that joint moves from its lower
    to its upper limit, in steps of `SWEEP_STEP`; all others with the joints at 0.
    """
    kinematics = Kinematics(robot)
    rest = np.clip(0.0, robot.lower, robot.upper)
    index = {name: robot.link_index(name) for name in links}
    T = kinematics.poses(rest)
    for first, second in combinations(links, 2):
        yield first, second, invert(T[index[second]]) @ T[index[first]]
    groups = group_rigid_links(robot)
    joints = robot.actuated_joints
    moving = enumerate(joints)
    for number, joint in track_progress(moving, "joints moved", len(joints)):
        sweep = sample_joint(joint)
        values = np.tile(rest, (len(sweep), 1))
        values[:, number] = sweep
        poses = kinematics.poses(values)
        parents = [n for n in links if groups[n] == groups[joint.parent]]
        children = [n for n in links if groups[n] == groups[joint.child]]
        for first in parents:
            for second in children:
                for T in poses:
                    yield first, second, invert(T[index[second]]) @ T[index[first]]


def iterate_combined_poses(
    robot: Robot, links: Sequence[str], count: int
) -> Iterator[RelativePose]:
    """Yield the poses of pairs of links in poses of all joints at once.

    Links that a single joint connects are left out: a sweep has their pose.
    """
    index = {name: robot.link_index(name) for name in links}
    groups = group_rigid_links(robot)
    beside = {frozenset((groups[j.parent], groups[j.child])) for j in robot.joints}
    pairs = [
        (first, second)
        for first, second in combinations(links, 2)
        if groups[first] != groups[second]
        and frozenset((groups[first], groups[second])) not in beside
    ]
    if not pairs or count == 0:
        return
    poses = Kinematics(robot).poses(sample_positions(robot, count))
    for T in track_progress(poses, "poses", len(poses)):
        for first, second in pairs:
            yield first, second, invert(T[index[second]]) @ T[index[first]]


def sample_positions(robot: Robot, count: int) -> Float[np.ndarray, "sample joint"]:
    """Return positions of all joints that fill the space between their limits.

    They are points of a Halton sequence (Owen 2017), stretched so that each joint is at
    one of its limits in a third of them, where links usually meet. The first of more
    samples are those of fewer.
    """
    from scipy.stats import qmc  # It takes half a second, and not all need it.

    joints = robot.actuated_joints
    ranges = [(sample[0], sample[-1]) for sample in map(sample_joint, joints)]
    low, high = np.array(ranges, np.float64).reshape(-1, 2).T
    unit = qmc.Halton(len(joints), scramble=True, rng=0).random(count)
    return low + (high - low) * np.clip(0.5 + STRETCH * (unit - 0.5), 0.0, 1.0)


def sample_joint(joint: Joint) -> Float[np.ndarray, "sample"]:
    """Return values of a joint [rad] or [m], over a full turn at most."""
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
