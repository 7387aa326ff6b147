"""This module joins the shapes of a link into one closed surface, and measures it."""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import manifold3d
import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from eskin.errors import RobotError
from eskin.registry import find_package
from eskin.robot import Cylinder, Geom, Link, Sphere, TriangleMesh, build_geom_mesh
from eskin.skin import MountedSkin

igl = find_package("igl", "libigl", "design", "skin design")

SAGITTA = 5e-5
"""Largest distance of a circle from the sides of its polygon [m]."""
MANY_TRIANGLES = 20_000
"""Number of triangles above which a surface is simplified."""
SIMPLIFIED = 2e-4
"""Largest distance of a surface from the same one before it is simplified [m]."""
MAX_TRIANGLES = 2_000_000
"""Largest number of small triangles of all links."""
SEGMENTS = (24, 192)
"""Smallest and largest number of corners of a circle."""
MAX_BODIES = 1000
"""Number of bodies of a mesh from which it is taken as a single broken one."""
MIN_BODY_VOLUME = 1e-9
"""Volume below which a body of a mesh is left out [m3]."""
MIN_OPEN_AREA = 1e-4
"""Area below which bodies that are not closed are left out [m2]."""
MAX_OFFSET = 3e-4
"""Largest distance of skin from the shapes of a link that was repaired [m]."""
WRAP_CELLS = 80
"""Number of cells of the grid along the longest side of a body that is wrapped."""


@dataclass(frozen=True, eq=False)
class LinkSurface:
    """A link's surface is a closed manifold mesh."""

    link: str
    """Name of the link."""
    vertices: Float[np.ndarray, "vertex 3"]
    """Positions of the vertices in the link's frame [m]."""
    faces: Int[np.ndarray, "face 3"]
    """Indices into `vertices`, counter-clockwise from outside."""
    warnings: tuple[str, ...] = ()
    """What was repaired, one line each."""

    @property
    def corners(self) -> Float[np.ndarray, "face 3 3"]:
        """Return the corners of every triangle [m]."""
        return self.vertices[self.faces]

    @cached_property
    def doubled_normals(self) -> Float[np.ndarray, "face 3"]:
        """Return outward normals of triangles, as long as twice their areas [m2]."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.cross(b - a, c - a)

    @property
    def area(self) -> float:
        """Return the area [m2]."""
        return float(np.linalg.norm(self.doubled_normals, axis=1).sum() / 2)

    def describe_size(self) -> str:
        """Return the lengths along x, y and z [m]."""
        size = np.ptp(self.vertices, axis=0)
        return f"{' x '.join(f'{side:.3g}' for side in size)} m"

    def count_refined(self, max_edge: float) -> float:
        """Estimate the number of triangles whose edges have at most a length [m]."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        around = sum(np.linalg.norm(e, axis=1).sum() for e in (b - a, c - b, a - c))
        equilateral = np.sqrt(3) / 4 * max_edge**2
        return len(self.faces) + around / max_edge + self.area / equilateral

    def sum_at_vertices(
        self, values: Float[np.ndarray, "face *more"]
    ) -> Float[np.ndarray, "vertex *more"]:
        """Return at each vertex the sum over the triangles that hold it."""
        sums = np.zeros((len(self.vertices), *values.shape[1:]))
        for corner in self.faces.T:
            np.add.at(sums, corner, values)
        return sums


@final
class PointLocator:
    """A locator finds the nearest triangles of a mesh.

    Attributes:
        vertices: positions of the vertices [m].
        faces: indices into `vertices`.
    """

    def __init__(
        self, vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
    ) -> None:
        """Build a tree of the triangles."""
        self.vertices = vertices
        self.faces = faces
        self.tree = igl.AABB()
        self.tree.init(vertices, faces)

    def locate(
        self, points: Float[np.ndarray, "point 3"]
    ) -> tuple[
        Int[np.ndarray, "point"],
        Float[np.ndarray, "point 3"],
        Float[np.ndarray, "point"],
    ]:
        """Return the nearest triangle, weights of its corners, and distance [m]."""
        square, face, nearest = self.tree.squared_distance(
            self.vertices, self.faces, np.ascontiguousarray(points)
        )
        a, b, c = (
            np.ascontiguousarray(self.vertices[self.faces[face, i]]) for i in range(3)
        )
        weights = igl.barycentric_coordinates(np.ascontiguousarray(nearest), a, b, c)
        # A triangle without area has no such coordinates.
        weights = np.where(np.isfinite(weights), np.clip(weights, 0.0, 1.0), 1.0)
        weights /= weights.sum(axis=1, keepdims=True)
        return face.astype(np.int64), weights, np.sqrt(np.maximum(square, 0.0))


def build_link_surface(link: Link, max_edge: float | None = None) -> LinkSurface:
    """Join all bodies of a link into one closed surface.

    Duplicate vertices are merged, and small bodies left out. With a warning, holes of a
    body are closed, and a body with non-manifold edges is wrapped: it is replaced by
    the surface on which its winding number is one half (Jacobson et al. 2013).

    Args:
        link: the link.
        max_edge: approximate length of the edges [m]; None for the shapes' own.

    Raises:
        RobotError: The link has no shape, none that encloses a volume, or one that is
            too large.
    """
    coarse, fine = build_two_surfaces(link, max_edge)
    return coarse if fine is None else fine


def build_two_surfaces(
    link: Link, max_edge: float | None, room: int = MAX_TRIANGLES
) -> tuple[LinkSurface, LinkSurface | None]:
    """Build the surface of a link, and the same one of small triangles.

    Other arguments and errors are as in `build_link_surface`.

    Args:
        link: the link.
        max_edge: approximate length of the edges [m].
        room: largest number of small triangles.
    """
    if not link.geoms:
        raise RobotError(
            f"link '{link.name}' has no surface: its URDF gives it no <collision>; "
            "choose another link"
        )
    warnings: list[str] = []
    bodies = [
        body
        for geom in link.geoms
        for body in close_bodies(build_round_mesh(geom), link.name, warnings)
    ]
    joined = manifold3d.Manifold.batch_boolean(bodies, manifold3d.OpType.Add)
    if joined.is_empty():
        raise RobotError(
            f"link '{link.name}' has no body of {1e9 * MIN_BODY_VOLUME:g} mm3 or more; "
            "choose another link, or correct its mesh"
        )
    if joined.num_tri() > MANY_TRIANGLES:
        joined = joined.simplify(SIMPLIFIED)
    coarse = to_surface(joined, link.name, warnings)
    if max_edge is None:
        return coarse, None
    count = coarse.count_refined(max_edge)
    if count > room:
        raise RobotError(
            f"link '{link.name}' is {coarse.describe_size()} large: its surface is "
            f"{count:.3g} triangles of {1e3 * max_edge:.3g} mm; allowed: {room:,} of "
            f"{MAX_TRIANGLES:,} on all links; scale its shape if its lengths are not "
            "metres, choose fewer links, or a lower density"
        )
    return coarse, to_surface(joined.refine_to_length(max_edge), link.name, warnings)


def to_surface(
    body: manifold3d.Manifold, link: str, warnings: list[str]
) -> LinkSurface:
    """Return the surface of a body."""
    mesh = body.to_mesh64()
    return LinkSurface(
        link,
        np.array(mesh.vert_properties[:, :3], dtype=np.float64),
        np.array(mesh.tri_verts, dtype=np.int64),
        tuple(warnings),
    )


def build_round_mesh(geom: Geom) -> TriangleMesh:
    """Build the mesh of a geom, with circles of as many corners as they need."""
    radius = geom.shape.radius if isinstance(geom.shape, Cylinder | Sphere) else SAGITTA
    half_angle = np.arccos(1 - min(SAGITTA / radius, 1.0))
    return build_geom_mesh(geom, int(np.clip(np.ceil(np.pi / half_angle), *SEGMENTS)))


def close_bodies(
    shape: TriangleMesh, link: str, warnings: list[str]
) -> list[manifold3d.Manifold]:
    """Return the closed bodies of a mesh; append what was repaired to the warnings."""
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=True)
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    labels = trimesh.graph.connected_component_labels(
        mesh.face_adjacency, node_count=len(mesh.faces)
    )
    # So many are triangles without common edges rather than bodies.
    soup = labels.max(initial=0) >= MAX_BODIES
    is_whole = soup or labels.max(initial=0) == 0
    parts = [mesh] if is_whole else mesh.split(only_watertight=False)
    closed = []
    capped = []
    broken = [mesh] if soup else []
    for part in () if soup else parts:
        if (body := to_manifold(part)) is not None:
            closed.append(body)
        elif (body := to_manifold(cap_holes(part))) is not None:
            capped.append(body)
        else:
            broken.append(part)
    joined = trimesh.util.concatenate(broken) if broken else trimesh.Trimesh()
    assert isinstance(joined, trimesh.Trimesh)
    wrapped = wrap_mesh(joined) if joined.area > MIN_OPEN_AREA else None
    for count, done in (
        (len(capped), "have holes; closed them"),
        (len(broken), "are broken; " + ("wrapped" if wrapped else "left out")),
    ):
        if count:
            text = f"link '{link}': {count} of {len(parts)} bodies {done}"
            warnings.append(f"{text}, and no skin lies where the surface is not theirs")
    found = [*closed, *capped, *([] if wrapped is None else [wrapped])]
    return [body for body in found if body.volume() > MIN_BODY_VOLUME]


def cap_holes(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Close every hole of a mesh by triangles to the middle of its border."""
    vertices = np.asarray(mesh.vertices)
    faces = np.asarray(mesh.faces, np.int64)
    if not igl.is_edge_manifold(faces)[0]:
        return mesh
    loops = igl.boundary_loop_all(faces)
    middles = [vertices[loop].mean(axis=0) for loop in loops]
    fans = [
        np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), number)])
        for number, loop in enumerate(loops, len(vertices))
    ]
    return trimesh.Trimesh(
        np.vstack([vertices, *middles]), np.vstack([faces, *fans]), process=False
    )


def find_invented_vertices(
    link: Link, surface: LinkSurface
) -> Bool[np.ndarray, "vertex"]:
    """Find vertices of triangles that lie off the shapes of a link, as over a hole.

    Args:
        link: the link.
        surface: its surface.
    """
    meshes = [build_round_mesh(geom) for geom in link.geoms]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    shapes = PointLocator(
        np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces)
    )
    invented = shapes.locate(surface.vertices)[2] > MAX_OFFSET
    middles = shapes.locate(surface.corners.mean(axis=1))[2] > MAX_OFFSET
    invented[surface.faces[middles]] = True
    return invented


def to_manifold(mesh: trimesh.Trimesh) -> manifold3d.Manifold | None:
    """Return a mesh as a manifold of positive volume; None where it is not closed."""
    if not mesh.is_watertight:
        mesh = mesh.copy()
        trimesh.repair.fill_holes(mesh)
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_normals(mesh)
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.uint64)
    body = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces))
    if body.status() != manifold3d.Error.NoError:
        return None
    if body.volume() < 0:
        body = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces[:, ::-1].copy()))
    return body


def wrap_mesh(mesh: trimesh.Trimesh) -> manifold3d.Manifold | None:
    """Return a closed surface around a broken mesh; None where it encloses nothing."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    step = float((high - low).max()) / WRAP_CELLS
    counts = np.ceil((high - low) / step).astype(np.int64) + 5
    axes = [low[i] + step * (np.arange(counts[i]) - 2) for i in range(3)]
    # libigl's grids run along x first.
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    winding = igl.FastWindingNumberBVH()
    winding.init(vertices, faces)
    outside = 0.5 - winding.winding_number(points)
    found = igl.marching_cubes(outside, points, *counts.tolist(), 0.0)
    wrapped = trimesh.Trimesh(found[0], found[1], process=True)
    if not len(wrapped.faces):
        return None
    snapped = snap_vertices(np.asarray(wrapped.vertices), vertices, faces, step)
    body = to_manifold(trimesh.Trimesh(snapped, wrapped.faces, process=False))
    if body is None:
        body = to_manifold(wrapped)
    return body if body is not None and body.volume() > MIN_BODY_VOLUME else None


def snap_vertices(
    points: Float[np.ndarray, "point 3"],
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    reach: float,
) -> Float[np.ndarray, "point 3"]:
    """Move points onto a mesh where it is within reach [m]."""
    square, _, nearest = igl.point_mesh_squared_distance(points, vertices, faces)
    return np.where((square < reach**2)[:, None], nearest, points)


igl = find_package("igl", "libigl", "design", "skin design")

Points = Float[np.ndarray, "point 3"]

ON_CORNER = 1e-3
"""Weight of a corner above which a point is in a triangle, not on its border."""
NO_INDEX = np.zeros(0, dtype=np.int64)


@final
class SurfaceDistance:
    """Computes lengths of shortest paths along the surface of a link.

    They are the geometric distances of Jiang et al. 2025 (section IV-A5, Fig. 5).

    The paths are exact on the triangles (Mitchell et al. 1987, in libigl), so the only
    error is that of the mesh itself. Each source costs about 0.1 s on 5,000 triangles,
    and more than in proportion on more.
    """

    def __init__(self, surface: LinkSurface, points: Points) -> None:
        """Insert points into a surface.

        Args:
            surface: the surface, best one of few triangles.
            points: points near it [m]; each is replaced by its nearest point.
        """
        self.vertices, self.faces, self.index = insert_points(surface, points)
        self.bodies = igl.vertex_components(self.faces)

    def between(
        self, sources: Int[np.ndarray, "source"], targets: Int[np.ndarray, "target"]
    ) -> Float[np.ndarray, "source target"]:
        """Return the distance from each source to each target [m].

        Args:
            sources: indices into the points that were given.
            targets: indices into them.

        Returns:
            The distances, infinite between separate bodies.
        """
        distances = np.empty((len(sources), len(targets)))
        ends = self.index[targets]
        for row, source in enumerate(self.index[sources]):
            found = igl.exact_geodesic(
                self.vertices, self.faces, np.array([source]), NO_INDEX, ends, NO_INDEX
            )
            same_body = self.bodies[ends] == self.bodies[source]
            distances[row] = np.where(same_body, found, np.inf)
            distances[row, ends == source] = 0.0
        return distances


def insert_points(
    surface: LinkSurface, points: Points
) -> tuple[
    Float[np.ndarray, "vertex 3"], Int[np.ndarray, "face 3"], Int[np.ndarray, "point"]
]:
    """Make points vertices of a mesh, by cutting the triangles that hold them.

    A point on a border of two triangles is moved into one of them, by a thousandth of
    its size.

    Returns:
        The vertices [m], the triangles, and the vertex of every point.
    """
    vertices = surface.vertices
    faces = surface.faces
    index = np.full(len(points), -1)
    waiting = np.arange(len(points))
    while len(waiting):
        face, weights, _ = PointLocator(vertices, faces).locate(points[waiting])
        at_corner = weights.max(axis=1) > 1 - ON_CORNER
        corner = faces[face, np.argmax(weights, axis=1)]
        index[waiting[at_corner]] = corner[at_corner]
        # Each triangle takes one point a round.
        own, first = np.unique(face[~at_corner], return_index=True)
        chosen = np.flatnonzero(~at_corner)[first]
        inner = np.maximum(weights[chosen], ON_CORNER)
        inner /= inner.sum(axis=1, keepdims=True)
        added = np.einsum("pk,pki->pi", inner, vertices[faces[own]])
        new = len(vertices) + np.arange(len(chosen))
        index[waiting[chosen]] = new
        a, b, c = faces[own].T
        vertices = np.concatenate([vertices, added])
        faces = np.concatenate(
            [
                np.delete(faces, own, axis=0),
                np.column_stack([a, b, new]),
                np.column_stack([b, c, new]),
                np.column_stack([c, a, new]),
            ]
        )
        waiting = waiting[index[waiting] < 0]
    return vertices, faces, index


def compute_kinematic_distances(
    mounted: MountedSkin,
    q: Float[np.ndarray, "joint"],
    sources: Int[np.ndarray, "source"],
    targets: Int[np.ndarray, "target"],
) -> Float[np.ndarray, "source target"]:
    """Return the straight-line distances between taxels at joint values q [m].

    They are the kinematic distances of Jiang et al. 2025 (section IV-A5, Fig. 5).
    """
    return cdist(
        mounted.place_taxels(q, sources)[0], mounted.place_taxels(q, targets)[0]
    )
