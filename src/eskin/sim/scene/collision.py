"""The collision model measures distances between the links of a robot.

Links are solid cylinders. Distances are lower bounds: enclosing capsules decide most
pairs, and only those that may be close are measured on the cylinders themselves.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.robot import Cylinder, Robot
from eskin.sim.scene.kernels import (
    CylinderArrays,
    compute_clearances,
    compute_point_distances,
)


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

    def compute_clearance(
        self, T_world_link: Float[np.ndarray, "pose link 4 4"], enough: float
    ) -> Float[np.ndarray, "pose 2"]:
        """Return the least distance of links and the least height over the table [m].

        Distances beyond `enough` [m] are only lower bounds.
        """
        T = np.ascontiguousarray(T_world_link)
        return compute_clearances(
            self.cylinders, self.pairs, self.table_cylinders, T, enough
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
        return np.minimum(found, points[:, 2])


def build_collision_model(robot: Robot) -> CollisionModel:
    """Build the collision model of a robot.

    Raises:
        ValueError: a collision geometry is not a cylinder.
    """
    cylinders = build_cylinders(robot)
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.joints}
    names = robot.link_names
    may_collide = np.array(
        [[a != b and frozenset((a, b)) not in joined for b in names] for a in names]
    )
    links = cylinders.links
    pairs = np.argwhere(np.triu(may_collide[links][:, links]))
    return CollisionModel(
        cylinders=cylinders,
        pairs=pairs.astype(np.int64).reshape(-1, 2),
        table_cylinders=np.flatnonzero(~np.isin(links, find_base_links(robot))),
        unjoined=tuple(np.flatnonzero(row[links]) for row in may_collide),
        other_cylinders=tuple(np.flatnonzero(links != i) for i in range(len(names))),
    )


def find_base_links(robot: Robot) -> list[int]:
    """Find the root link and its children, which stand on the table."""
    children = {joint.child for joint in robot.joints}
    (root,) = (name for name in robot.link_names if name not in children)
    first = [joint.child for joint in robot.joints if joint.parent == root]
    return [robot.link_index(name) for name in (root, *first)]


def build_cylinders(robot: Robot) -> CylinderArrays:
    """Return all collision geometry as cylinders in the frames of their links."""
    links, centres, axes, radii, halves = [], [], [], [], []
    for index, link in enumerate(robot.links):
        for body in link.geoms:
            if not isinstance(body.shape, Cylinder):
                raise ValueError(
                    f"link '{link.name}' of robot '{robot.name}' has a "
                    f"{type(body.shape).__name__}; touches are simulated on robots of "
                    "cylinders; describe its collision geoms as such"
                )
            links.append(index)
            centres.append(body.T_link_shape[:3, 3])
            axes.append(body.T_link_shape[:3, 2])
            radii.append(body.shape.radius)
            halves.append(body.shape.length / 2)
    return CylinderArrays(
        np.array(links, dtype=np.int64),
        np.array(centres, dtype=np.float64).reshape(-1, 3),
        np.array(axes, dtype=np.float64).reshape(-1, 3),
        np.array(radii, dtype=np.float64),
        np.array(halves, dtype=np.float64),
    )
