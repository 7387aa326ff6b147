"""The collision model measures distances between the links of a robot.

Links are solid cylinders; any other shape is cut into slabs along its longest axis, and
a cylinder encloses each of them. Distances are lower bounds: enclosing capsules decide
most pairs, and only those that may be close are measured on the cylinders themselves.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.robot import Cylinder, Geom, Kinematics, Robot, build_geom_mesh
from eskin.sim.scene.kernels import (
    CylinderArrays,
    compute_clearances,
    compute_point_distances,
)
from eskin.transforms import apply


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """A collision model holds the cylinders of a robot and which pairs may collide."""

    cylinders: CylinderArrays
    """All cylinders of the robot."""
    pairs: Int[np.ndarray, "pair 2"]
    """Pairs of cylinders of links that share no joint."""
    table_cylinders: Int[np.ndarray, "free"]
    """Cylinders that may hit the table."""
    unjoined: tuple[Int[np.ndarray, "_"], ...]
    """For each link, the cylinders of links that share no joint with it."""
    other_cylinders: tuple[Int[np.ndarray, "_"], ...]
    """For each link, the cylinders of all other links."""
    ground: float = 0.0
    """Height of the table, or of the floor, in the world frame [m]."""

    def compute_clearance(
        self, T_world_link: Float[np.ndarray, "pose link 4 4"], exact_within: float
    ) -> Float[np.ndarray, "pose 2"]:
        """Return the least distance of links and the least height over the table [m].

        Distances beyond `exact_within` [m] are only lower bounds.
        """
        T = np.ascontiguousarray(T_world_link)
        return compute_clearances(
            self.cylinders, self.pairs, self.table_cylinders, T, exact_within
        )

    def compute_free_distance(
        self,
        T_world_link: Float[np.ndarray, "link 4 4"],
        points: Float[np.ndarray, "point 3"],
        link: int,
    ) -> Float[np.ndarray, "point"]:
        """Return the distance of world points from other links and the table [m]."""
        found, _ = compute_point_distances(
            self.cylinders, T_world_link, points, self.other_cylinders[link]
        )
        return np.minimum(found, points[:, 2] - self.ground)


def build_collision_model(robot: Robot, min_distance: float) -> CollisionModel:
    """Build the collision model of a robot.

    A robot of which a link reaches below its base stands on its lowest point, and may
    touch the ground. Of links that are no cylinders, those that are close with all
    joints at 0 are taken for parts that belong together. `min_distance` is the distance
    below which links are close [m].
    """
    cylinders = build_cylinders(robot)
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.joints}
    names = robot.link_names
    may_collide = np.array(
        [[a != b and frozenset((a, b)) not in joined for b in names] for a in names]
    )
    links = cylinders.links
    pairs = np.argwhere(np.triu(may_collide[links][:, links]))
    pairs = pairs.astype(np.int64).reshape(-1, 2)
    # The root link and its children stand on the table.
    (root,) = set(names) - {joint.child for joint in robot.joints}
    first = [joint.child for joint in robot.joints if joint.parent == root]
    based = [robot.link_index(name) for name in (root, *first)]
    free = np.flatnonzero(~np.isin(links, based))
    ground = 0.0
    shapes = [body.shape for link in robot.links for body in link.geoms]
    if not all(isinstance(shape, Cylinder) for shape in shapes):
        rest = np.clip(np.zeros(len(robot.joint_names)), robot.lower, robot.upper)
        T = np.ascontiguousarray(Kinematics(robot).poses(rest))
        height = min(
            float(apply(T[index], build_geom_mesh(body).vertices)[:, 2].min())
            for index, link in enumerate(robot.links)
            for body in link.geoms
        )
        if height < -BELOW:
            free = free[:0]
            ground = height
        gaps = [
            compute_clearances(cylinders, pair[None], free, T[None], min_distance)[0, 0]
            for pair in pairs
        ]
        close = {tuple(links[pair]) for pair in pairs[np.array(gaps) < min_distance]}
        kept = [tuple(links[pair]) not in close for pair in pairs]
        pairs = pairs[np.array(kept, dtype=bool)]
    return CollisionModel(
        cylinders=cylinders,
        pairs=pairs,
        table_cylinders=free,
        unjoined=tuple(np.flatnonzero(row[links]) for row in may_collide),
        other_cylinders=tuple(np.flatnonzero(links != i) for i in range(len(names))),
        ground=ground,
    )


BELOW = 0.05
"""Depth of a link below the base from which on a robot stands on its links [m]."""
SLAB = 0.06
"""Largest length of a slab of a link that is no cylinder [m]."""


def build_cylinders(robot: Robot) -> CylinderArrays:
    """Return all collision geometry as cylinders in the frames of their links."""
    rows = [
        (index, *each)
        for index, link in enumerate(robot.links)
        for body in link.geoms
        for each in enclose_geom(body)
    ]
    links, centres, axes, radii, halves = zip(*rows, strict=True) if rows else [()] * 5
    return CylinderArrays(
        np.array(links, dtype=np.int64),
        np.array(centres, dtype=np.float64).reshape(-1, 3),
        np.array(axes, dtype=np.float64).reshape(-1, 3),
        np.array(radii, dtype=np.float64),
        np.array(halves, dtype=np.float64),
    )


EnclosingCylinder = tuple[np.ndarray, np.ndarray, float, float]


def enclose_geom(body: Geom) -> list[EnclosingCylinder]:
    """Return cylinders around a shape: centre, axis, radius and half length [m].

    A cylinder is its own. Any other shape is cut into slabs across one of its principal
    axes, the one that leaves the least volume of cylinders.
    """
    if isinstance(body.shape, Cylinder):
        T = body.T_link_shape
        shape = body.shape
        return [(T[:3, 3], T[:3, 2], shape.radius, shape.length / 2)]
    mesh = build_geom_mesh(body)
    corners = mesh.vertices[mesh.faces]
    # Long triangles have no vertex in the slabs that they cross.
    parts = np.linspace(0.0, 1.0, EDGE_POINTS, endpoint=False)
    ends = np.roll(corners, -1, axis=1)
    points = np.concatenate([corners + p * (ends - corners) for p in parts])
    points = points.reshape(-1, 3)
    axes = np.linalg.eigh(np.cov(points.T))[1].T
    found = [cut_into_cylinders(points, axis) for axis in axes]
    return min(found, key=lambda slabs: sum(r * r * half for *_, r, half in slabs))


EDGE_POINTS = 8
"""Number of points along an edge by which a shape is enclosed."""


def cut_into_cylinders(
    points: Float[np.ndarray, "point 3"], axis: Float[np.ndarray, "3"]
) -> list[EnclosingCylinder]:
    """Return cylinders along an axis that enclose the points of each slab."""
    height = points @ axis
    low, high = float(height.min()), float(height.max())
    count = max(int(np.ceil((high - low) / SLAB)), 1)
    number = np.minimum(
        ((height - low) / max(high - low, 1e-9) * count).astype(int), count - 1
    )
    found = []
    for slab in range(count):
        inside = points[number == slab]
        if not len(inside):
            continue
        across = inside - (inside @ axis)[:, None] * axis
        middle = (across.min(axis=0) + across.max(axis=0)) / 2
        middle -= (middle @ axis) * axis
        radius = float(np.linalg.norm(across - middle, axis=1).max())
        step = (high - low) / count
        centre = middle + (low + (slab + 0.5) * step) * axis
        found.append((centre, axis, radius, step / 2))
    return found
