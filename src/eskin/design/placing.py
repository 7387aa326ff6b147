"""This module lays a ready-made matrix of taxels on a link, wrapped on its surface."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from eskin.design.design import (
    EDGE,
    LEAST_EDGE,
    MOST_EDGE,
    build_surfaces,
    find_allowed_vertices,
)
from eskin.design.painting import thin_vertices
from eskin.design.patches import (
    MARGIN,
    build_cell_points,
    find_adjacency,
    measure_distortion,
)
from eskin.design.spec import DesignLimits, DesignSpec, RegionSpec
from eskin.design.surface import LinkSurface, PointLocator
from eskin.design.unroll import FlatRegion, UnrolledMesh, unroll_region
from eskin.design.zones import LinkZone, Vector
from eskin.errors import SkinError
from eskin.progress import track_progress
from eskin.robot import Link, Robot, build_geom_mesh
from eskin.skin import Patch, Skin, TaxelGrid, build_skin

PLACES = 24
"""Number of places that are tried where none is given."""
GOOD = 0.01
"""Relative error of distances below which no better place is looked for."""
DETOUR = 2.2
"""Largest ratio of a path over the middles of triangles to the shortest path."""
MAX_LEAN = -0.64
"""Least cosine of a normal with that at the middle, where what lies all round cannot be
unrolled."""
ALONG = 0.3
"""Smallest sine of the angle of an axis to the normal for the columns to follow it."""
TRIANGLES = 10_000
"""Number of small triangles of a link, about. It does not depend on the matrix, so a
place that was found holds for every pitch."""
ITERATIONS = 10
"""Number of iterations of the unrolling; more change distances by less than 0.1 %."""
NEAR = 1.03
"""Ratio below which two pitches are not told apart while the largest is looked for."""
MM = 1e-3
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class MatrixSpec:
    """A specification describes a matrix, and where it is to lie."""

    link: str
    rows: int
    columns: int
    pitch: float
    """Distance of neighbouring taxels [m]."""
    name: str
    """Id of the patch."""
    at: Vector | None = None
    """Place of its middle, near the surface, in the link's frame [m]; None chooses."""
    turn: float | None = None
    """Angle from the link's x axis, or its z axis where x is along the normal, to the
    direction of the columns, counter-clockwise from outside [rad]; None chooses 0 or a
    right angle."""
    flip: bool = False
    """Whether columns are counted from the other side, as of a matrix turned over."""
    max_distortion: float = DesignLimits.max_distortion
    """Largest relative error of the distance of neighbouring taxels."""
    clearance: float = DesignLimits.clearance
    """Smallest distance from other links while one joint moves [m]."""


@dataclass(frozen=True, eq=False)
class Placement:
    """A placement is one way to lay a matrix on a link, with no taxel over an edge."""

    mesh: UnrolledMesh
    """Map to the link, with the middle of the matrix at (0, 0)."""
    distortion: float
    """Largest relative error of the distance of neighbouring taxels."""


@dataclass(frozen=True, eq=False)
class Site:
    """A site is the surface of a link, prepared before a matrix is laid."""

    surface: LinkSurface
    """Surface of small triangles."""
    usable: Bool[np.ndarray, "face"]
    """Whether skin may lie on each of them."""
    middles: Float[np.ndarray, "face 3"]
    """Their middles [m]."""
    paths: csr_array
    """Lengths of the lines between the middles of usable neighbours [m]."""
    reach: float
    """Length of the edges of the triangles, about [m]."""

    @cached_property
    def locator(self) -> PointLocator:
        """Return the locator of points on the surface."""
        return PointLocator(self.surface.vertices, self.surface.faces)

    @cached_property
    def places(self) -> Float[np.ndarray, "place 3"]:
        """Return places on the link, those nearest to its middle first [m]."""
        spacing = float(np.sqrt(self.surface.area / PLACES))
        points = thin_vertices(self.surface, spacing)[:, :3]
        away = np.linalg.norm(points - self.surface.vertices.mean(axis=0), axis=1)
        return points[np.argsort(away)[:PLACES]]


def place_matrix(robot: Robot, spec: MatrixSpec) -> tuple[Skin, float]:
    """Lay a matrix on a link, as a skin of one patch.

    Returns:
        The skin, and the largest relative error of the distance of its neighbours.

    Raises:
        RobotError: The robot lacks the link, or it has no shape.
        SkinError: The matrix has no room there; the message says at which pitch it has.
    """
    site = build_site(robot, spec)
    best = find_placement(site, spec)
    if best is None or best.distortion > spec.max_distortion:
        raise SkinError(describe_misfit(best, site, spec))
    patch = Patch(spec.name, spec.link, 1, spec.rows, spec.columns)
    skin = build_skin(spec.name, [(patch, build_grid(spec), best.mesh)])
    if spec.flip:
        order = np.arange(skin.count).reshape(spec.rows, spec.columns)[:, ::-1].ravel()
        names = ("positions", "normals", "areas", "tangents")
        skin = replace(skin, **{name: getattr(skin, name)[order] for name in names})
    return skin, best.distortion


def build_site(robot: Robot, spec: MatrixSpec) -> Site:
    """Build the surface of a link, and find where skin may lie on it.

    What was repaired on any link, or is no obstacle, is told.
    """
    link = robot.links[robot.link_index(spec.link)]
    edge = choose_edge(link)
    limits = DesignLimits(min_spacing=0.0, clearance=spec.clearance)
    region = RegionSpec(LinkZone(spec.link), (EDGE / edge) ** 2)
    whole = DesignSpec(spec.name, (region,), limits=limits)
    fine, coarse, warnings = build_surfaces(robot, whole)
    for warning in warnings:
        logger.warning("%s", warning)
    surface = fine[spec.link]
    allowed = find_allowed_vertices(robot, whole, fine, coarse)[spec.link]
    usable = np.asarray(allowed[surface.faces].all(axis=1))
    middles = surface.corners.mean(axis=1)
    pairs = find_adjacency(surface, limits.max_bend)
    first, second = pairs[usable[pairs].all(axis=1)].T
    lengths = np.linalg.norm(middles[first] - middles[second], axis=1)
    paths = coo_array((lengths, (first, second)), shape=(len(middles),) * 2).tocsr()
    return Site(surface, usable, middles, paths, edge)


def choose_edge(link: Link) -> float:
    """Choose the length of the edges of a link's small triangles, by its size [m]."""
    if not link.geoms:
        return MOST_EDGE
    shapes = [build_geom_mesh(geom).vertices for geom in link.geoms]
    x, y, z = np.ptp(np.concatenate(shapes), axis=0)
    triangle = 2 * (x * y + y * z + z * x) / TRIANGLES
    return float(np.clip(np.sqrt(triangle * 4 / np.sqrt(3)), LEAST_EDGE, MOST_EDGE))


def build_grid(spec: MatrixSpec) -> TaxelGrid:
    """Build the flat layout of a matrix."""
    return TaxelGrid(spec.rows, spec.columns, spec.pitch, spec.pitch)


def add_patch(skin: Skin, added: Skin) -> Skin:
    """Return a skin with the one patch of another, in place of any of its id."""
    (patch,) = added.patches
    keep = [n for n, one in enumerate(skin.patches) if one.id != patch.id]
    kept = [skin.patches[n] for n in keep]
    own = np.isin(skin.patch_index, keep)
    addresses = {one.address for one in kept}
    free = next(n for n in range(1, len(kept) + 2) if n not in addresses)
    index = np.searchsorted(keep, skin.patch_index[own])
    names = ("rows", "columns", "positions", "normals", "areas", "tangents")
    return replace(
        skin,
        patches=(*kept, replace(patch, address=free)),
        patch_index=np.append(index, np.full(added.count, len(keep))),
        **{
            name: np.concatenate([getattr(skin, name)[own], getattr(added, name)])
            for name in names
        },
    )


def find_placement(site: Site, spec: MatrixSpec) -> Placement | None:
    """Find the place where a matrix is distorted least; None where none has room."""
    places = site.places if spec.at is None else np.array([spec.at])
    best = None
    for place in track_progress(places, "places tried", len(places)):
        found = lay_matrix(site, place, spec)
        if found is not None and (best is None or found.distortion < best.distortion):
            best = found
        if best is not None and best.distortion < GOOD:
            break
    return best


def lay_matrix(
    site: Site, place: Float[np.ndarray, "3"], spec: MatrixSpec
) -> Placement | None:
    """Lay a matrix around a place [m], turned as it is distorted least.

    Returns:
        The placement; None where a taxel does not lie on the usable surface.
    """
    face = int(site.locator.locate(place[None])[0][0])
    around = find_faces_around(site, face, spec)
    area = np.linalg.norm(site.surface.doubled_normals[around], axis=1).sum() / 2
    scale = MARGIN * (1 - spec.max_distortion)
    if area < spec.rows * spec.columns * (scale * spec.pitch) ** 2:
        return None
    region = unroll_region(site.surface, around, ITERATIONS)
    if region is None:
        lean = site.surface.doubled_normals[around] @ site.surface.doubled_normals[face]
        sizes = np.linalg.norm(site.surface.doubled_normals, axis=1)
        faces = around[lean > MAX_LEAN * sizes[around] * sizes[face]]
        region = unroll_region(site.surface, faces, ITERATIONS)
    if region is None:
        return None
    turns = (0.0, np.pi / 2) if spec.turn is None else (spec.turn,)
    found = lay_grid(region, place, turns, build_grid(spec))
    return min(found, key=lambda each: each.distortion, default=None)


def find_faces_around(
    site: Site, face: int, spec: MatrixSpec
) -> Int[np.ndarray, "face"]:
    """Find the usable triangles on which a matrix around one of them may lie."""
    if not site.usable[face]:
        return np.zeros(0, dtype=np.int64)
    diagonal = spec.pitch * float(np.hypot(spec.rows, spec.columns))
    reach = diagonal / 2 + max(spec.pitch, site.reach)
    far = dijkstra(site.paths, False, indices=face, limit=DETOUR * reach)
    away = np.linalg.norm(site.middles - site.middles[face], axis=1)
    return np.flatnonzero(np.isfinite(far) & (away < reach))


def lay_grid(
    region: FlatRegion,
    middle: Float[np.ndarray, "3"],
    turns: Sequence[float],
    grid: TaxelGrid,
) -> Iterator[Placement]:
    """Lay a grid on an unrolled region, and yield the placements without overhang.

    Args:
        region: the region.
        middle: place of the middle of the grid [m].
        turns: angles of its columns that are tried, as in `MatrixSpec` [rad].
        grid: the grid.
    """
    points = region.surface.wrap(region.flat)
    mesh = UnrolledMesh(points.positions, points.normals, region.faces, region.flat)
    whole = FlatRegion(mesh, mesh.flat, mesh.faces, region.area)
    origin = mesh.unroll(middle[None])
    first = mesh.wrap(origin)
    axis = np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(np.cross(first.normals[0], axis)) < ALONG:
        axis = axis[::-1]
    across = np.cross(first.normals[0], first.tangents[0])
    zero = np.arctan2(across @ axis, first.tangents[0] @ axis)
    cells = grid.unrolled()[:, None] + MARGIN * grid.row_pitch * build_cell_points()
    present = np.ones((grid.rows, grid.columns), dtype=bool)
    for turn in turns:
        cosine = np.cos(turn + zero)
        sine = np.sin(turn + zero)
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        if not whole.contains(origin + cells.reshape(-1, 2) @ rotation.T).all():
            continue
        turned = replace(mesh, flat=(mesh.flat - origin) @ rotation)
        errors = measure_distortion(turned, present, grid.row_pitch)
        worst = max((float(np.abs(error).max()) for *_, error in errors), default=0.0)
        yield Placement(turned, worst)


def find_fitting_pitch(site: Site, spec: MatrixSpec) -> float | None:
    """Find a smaller pitch at which a matrix has room, the largest but for `NEAR` [mm].

    Returns:
        The pitch, in tenths, or in hundredths below 2 mm; None where a tenth of the
        pitch has no room either.
    """
    parts = 10 if spec.pitch >= 2 * MM else 100
    most = int(np.ceil(spec.pitch / MM * parts))
    least = most // 10
    largest = least
    places = site.places if spec.at is None else np.array([spec.at])
    for place in track_progress(places, "places measured", len(places)):
        # A place is looked at closely only where it has room for more than the others.
        low = largest
        high = most
        tried = int(NEAR * low) + 1
        while tried < high:
            found = lay_matrix(site, place, replace(spec, pitch=MM * (tried / parts)))
            if found is not None and found.distortion <= spec.max_distortion:
                low = tried
            elif low == largest:
                break
            else:
                high = tried
            tried = max(int(np.sqrt(low * high)), int(NEAR * low) + 1)
        largest = low
    return largest / parts if largest > least else None


def describe_misfit(best: Placement | None, site: Site, spec: MatrixSpec) -> str:
    """Describe why a matrix has no room on a link, and the remedies."""
    width = spec.pitch / MM * spec.columns
    height = spec.pitch / MM * spec.rows
    what = (
        f"a matrix of {width:.0f} x {height:.0f} mm does not lie on link "
        f"'{spec.link}', which is {site.surface.describe_size()} large"
    )
    why = (
        "taxels hang over, are hidden, bent too far, or within the clearance of a link"
    )
    if best is not None:
        why = (
            f"distances are wrong by {100 * best.distortion:.0f} %, allowed are "
            f"{100 * spec.max_distortion:.0f} % (--distortion)"
        )
    pitch = find_fitting_pitch(site, spec)
    fits = "no pitch fits" if pitch is None else f"--pitch-mm {pitch:g} fits"
    return (
        f"{what}: {why}; {fits}; or try another --at or --turn, a smaller --clearance, "
        "another link, or fewer rows and columns"
    )
