"""This module unrolls regions of a link's surface into the plane, and maps both ways.

A flat or round region is unrolled exactly. Any other is unrolled by libigl: a
least-squares conformal map (Lévy et al. 2002), made as rigid as possible (Liu et al.
2008).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from shapely import Polygon

from eskin.design.surface import LinkSurface, PointLocator
from eskin.registry import find_package
from eskin.skin import Plane, Surface, SurfacePoints, Tube
from eskin.skin.surfaces import Points, Unrolled, fit_plane, fit_tube
from eskin.transforms import exp_so3, make_transform

igl = find_package("igl", "libigl", "design", "skin design")

FIT_DISTANCE = 1e-4
"""Largest distance of a vertex from the plane or tube that replaces its mesh [m]."""
FIT_ANGLE = 0.2
"""Largest angle of its normal [rad]."""
MIN_MEAN_NORMAL = 0.3
"""Smallest length of the mean normal of a curved region that is unrolled in one."""
MAX_FLATTENED = 50_000
"""Largest number of triangles that are unrolled together: time grows faster."""
ITERATIONS = 40
"""Number of iterations of the unrolling."""
MAX_FLIPPED = 1e-4
MAX_OVERLAP = 2e-3
"""Largest fractions of the area of triangles that are turned over, or overlap."""
INSIDE = 1e-7
"""Distance up to which a point lies in an unrolled region [m]."""


@final
@dataclass(frozen=True, eq=False)
class UnrolledMesh(Surface):
    """An unrolled mesh is a region of a link's surface with its image in the plane."""

    vertices: Points
    """Positions of the vertices in the link's frame [m]."""
    normals: Points
    """Outward unit normals of the vertices."""
    faces: Int[np.ndarray, "face 3"]
    """Indices into `vertices`."""
    flat: Unrolled
    """Unrolled coordinates (s, t) of the vertices [m]."""

    @property
    def T_link_surface(self) -> Float[np.ndarray, "4 4"]:  # type: ignore[override]  # noqa: N802
        """Return the identity: the surface's own frame is the link's."""
        return np.eye(4)

    @cached_property
    def on_link(self) -> PointLocator:
        """Return the locator of points on the link."""
        return PointLocator(self.vertices, self.faces)

    @cached_property
    def in_plane(self) -> PointLocator:
        """Return the locator of points in the plane."""
        return PointLocator(lift(self.flat), self.faces)

    @cached_property
    def jacobians(self) -> Float[np.ndarray, "face 3 2"]:
        """Return the derivative of the position by (s, t) in every triangle."""
        edges = self.vertices[self.faces[:, 1:]] - self.vertices[self.faces[:, :1]]
        flat = self.flat[self.faces[:, 1:]] - self.flat[self.faces[:, :1]]
        return np.swapaxes(np.linalg.inv(flat) @ edges, 1, 2)

    def wrap(self, unrolled: Unrolled) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] on the surface.

        A point outside the region is laid on the nearest point of its boundary.
        """
        face, weights, _ = self.in_plane.locate(lift(unrolled))
        corners = self.faces[face]
        normals = np.einsum("pk,pki->pi", weights, self.normals[corners])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        along = self.jacobians[face, :, 0]
        tangents = along - np.sum(along * normals, axis=1, keepdims=True) * normals
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        first, second = np.moveaxis(self.jacobians[face], 2, 0)
        return SurfacePoints(
            positions=np.einsum("pk,pki->pi", weights, self.vertices[corners]),
            normals=normals,
            tangents=tangents,
            area_scale=np.linalg.norm(np.cross(first, second), axis=1),
        )

    def unroll(self, positions: Points) -> Unrolled:
        """Return the unrolled coordinates (s, t) [m] of the nearest surface points."""
        face, weights, _ = self.on_link.locate(positions)
        return np.einsum("pk,pki->pi", weights, self.flat[self.faces[face]])

    def fit_errors(
        self, positions: Points, normals: Points
    ) -> Float[np.ndarray, "point"]:
        """Return the distances of points [m] plus the errors of normals [rad]."""
        face, weights, distance = self.on_link.locate(positions)
        own = np.einsum("pk,pki->pi", weights, self.normals[self.faces[face]])
        own /= np.linalg.norm(own, axis=1, keepdims=True)
        return distance + np.linalg.norm(own - normals, axis=1)


@dataclass(frozen=True, eq=False)
class FlatRegion:
    """A flat region is a region of a link's surface, unrolled."""

    surface: Surface
    """Map between (s, t) and the link."""
    flat: Unrolled
    """Unrolled coordinates (s, t) of the vertices [m]."""
    faces: Int[np.ndarray, "face 3"]
    """Indices into `flat`, without triangles across the seam of a tube."""
    area: float
    """Area on the surface [m2]."""

    @cached_property
    def in_plane(self) -> PointLocator:
        """Return the locator of points in the plane."""
        if isinstance(self.surface, UnrolledMesh):
            return self.surface.in_plane
        return PointLocator(lift(self.flat), self.faces)

    def contains(self, unrolled: Unrolled) -> Bool[np.ndarray, "point"]:
        """Return which points (s, t) [m] lie in the region."""
        return self.in_plane.locate(lift(unrolled))[2] < INSIDE


def lift(unrolled: Unrolled) -> Points:
    """Return points (s, t) as points in space, at height 0."""
    return np.column_stack([unrolled, np.zeros(len(unrolled))])


def unroll_region(
    surface: LinkSurface,
    region: Int[np.ndarray, "region"],
    iterations: int = ITERATIONS,
) -> FlatRegion | None:
    """Unroll the triangles of a region, which are connected.

    Args:
        surface: the surface.
        region: indices of its triangles.
        iterations: number of iterations in which a curved region becomes rigid.

    Returns:
        The unrolled region; None where it cannot be unrolled without an overlap, or has
        so many triangles that it is cut first.
    """
    # Where only corners of triangles meet, the region is cut.
    faces, used = igl.split_nonmanifold(surface.faces[region])
    faces = faces.astype(np.int64)
    vertices = surface.vertices[used]
    normals = igl.per_vertex_normals(
        vertices, faces, igl.PER_VERTEX_NORMALS_WEIGHTING_TYPE_ANGLE
    )
    area = float(igl.doublearea(vertices, faces).sum() / 2)
    found = fit_exactly(vertices, normals)
    if found is not None:
        flat = found.unroll(vertices)
        width = np.ptp(flat[faces][..., 0], axis=1)
        seam = np.pi * found.radius if isinstance(found, Tube) else np.inf
        return FlatRegion(found, flat, faces[width < seam], area)
    if len(faces) > MAX_FLATTENED:
        return None
    flat = flatten(vertices, faces, iterations)
    if flat is None:
        return None
    mesh = UnrolledMesh(vertices, normals, faces, flat)
    return FlatRegion(mesh, flat, faces, area)


def fit_exactly(vertices: Points, normals: Points) -> Plane | Tube | None:
    """Fit a plane, else a tube, within `FIT_DISTANCE`; None where neither fits."""
    for fit in (fit_plane, fit_tube):
        surface = fit(vertices, normals)
        if surface is None:
            continue
        wrapped = surface.wrap(surface.unroll(vertices))
        distance = np.linalg.norm(wrapped.positions - vertices, axis=1)
        cosine = np.sum(wrapped.normals * normals, axis=1)
        if distance.max() < FIT_DISTANCE and cosine.min() > np.cos(FIT_ANGLE):
            return surface
    return None


def flatten(
    vertices: Points, faces: Int[np.ndarray, "face 3"], iterations: int
) -> Unrolled | None:
    """Compute the unrolled coordinates [m] of the vertices of a mesh with a boundary.

    Args:
        vertices: positions of the vertices [m].
        faces: indices into `vertices`.
        iterations: number of iterations of the unrolling.

    Returns:
        The coordinates; None where the mesh is closed, curved nearly all round or has
        a handle, or where its image overlaps itself.
    """
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    doubled = np.cross(b - a, c - a)
    size = np.linalg.norm(doubled, axis=1).sum()
    if np.linalg.norm(doubled.sum(axis=0)) < MIN_MEAN_NORMAL * size:
        return None
    loops = igl.boundary_loop_all(faces)
    if not loops or igl.euler_characteristic(faces) != 2 - len(loops):
        return None
    longest = np.argmax([compute_perimeter(vertices, loop) for loop in loops])
    outer = np.array(loops[longest])
    flat = compute_rigid_map(vertices, faces, outer, iterations)
    if flat is None or is_overlapping(flat, faces, loops, outer):
        return None
    return flat


def compute_rigid_map(
    vertices: Points,
    faces: Int[np.ndarray, "face 3"],
    outer: Int[np.ndarray, "corner"],
    iterations: int,
) -> Unrolled | None:
    """Compute a map that is as rigid as possible, beginning with a conformal one.

    Args:
        vertices: positions of the vertices [m].
        faces: indices into `vertices`.
        outer: vertices around the mesh.
        iterations: number of iterations.

    Returns:
        The unrolled coordinates [m]; None where triangles are too thin for a solution.
    """
    gaps = np.linalg.norm(vertices[outer] - vertices[outer[0]], axis=1)
    ends = outer[[0, np.argmax(gaps)]]
    flat, _ = igl.lscm(vertices, faces, ends, np.array([[0.0, 0.0], [gaps.max(), 0.0]]))
    size = np.abs(compute_signed_areas(flat, faces)).sum()
    if not size > 0:
        return None
    flat = flat * np.sqrt(igl.doublearea(vertices, faces).sum() / size)
    data = igl.ARAPData()
    data.max_iter = iterations
    pinned = ends[:1].astype(np.int32)
    try:
        igl.arap_precomputation(vertices, faces, 2, pinned, data)
        return igl.arap_solve(flat[pinned], data, flat)
    except RuntimeError:
        return None


def is_overlapping(
    flat: Unrolled,
    faces: Int[np.ndarray, "face 3"],
    loops: list[list[int]],
    outer: Int[np.ndarray, "corner"],
) -> bool:
    """Return whether an unrolled mesh overlaps itself, but for slivers.

    Args:
        flat: unrolled coordinates of the vertices [m].
        faces: indices into `flat`.
        loops: vertices around the mesh and around each of its holes.
        outer: vertices around the mesh.
    """
    areas = compute_signed_areas(flat, faces) / 2
    total = np.abs(areas).sum()
    if not np.isfinite(total) or -areas[areas < 0].sum() > MAX_FLIPPED * total:
        return True
    # Triangles that do not overlap fill the outline without its holes.
    around = Polygon(flat[outer]).buffer(0.0).area
    holes = [loop for loop in loops if len(loop) != len(outer) or loop[0] not in outer]
    within = sum(Polygon(flat[loop]).buffer(0.0).area for loop in holes)
    return bool(abs(around - within - total) > MAX_OVERLAP * total)


def compute_perimeter(vertices: Points, loop: list[int]) -> float:
    """Return the length of a closed line of vertices [m]."""
    line = vertices[loop]
    return float(np.linalg.norm(line - np.roll(line, 1, axis=0), axis=1).sum())


def compute_signed_areas(
    flat: Unrolled, faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "face"]:
    """Return twice the signed areas of triangles in the plane [m2]."""
    a, b, c = np.moveaxis(flat[faces], 1, 0)
    first = b - a
    second = c - a
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def turn_region(region: FlatRegion, angle: float, origin: Unrolled) -> FlatRegion:
    """Return a region with its unrolled coordinates rotated and shifted.

    Args:
        region: the region.
        angle: angle by which the axes of (s, t) turn [rad]; 0 for a tube.
        origin: point that becomes (0, 0), in the former coordinates [m].
    """
    rotation = np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    )
    flat = (region.flat - origin) @ rotation.T
    match region.surface:
        case UnrolledMesh() as mesh:
            surface = replace(mesh, flat=flat)
        case Tube() as tube:
            turn = exp_so3(np.array([0.0, 0.0, origin[0, 0] / tube.radius]))
            shift = np.array([0.0, 0.0, origin[0, 1]])
            surface = replace(
                tube, T_link_surface=tube.T_link_surface @ make_transform(turn, shift)
            )
        case plane:
            shift = np.append(origin[0], 0.0)
            turn = make_transform(exp_so3(np.array([0.0, 0.0, angle])), shift)
            surface = Plane(plane.T_link_surface @ turn)
    return replace(region, surface=surface, flat=flat)
