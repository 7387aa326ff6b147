"""This module lays a ready-made matrix of taxels on a link, wrapped on its surface."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from eskin.design.design import build_surfaces, find_allowed_vertices
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
from eskin.robot import Robot
from eskin.skin import Patch, Skin, TaxelGrid, build_skin

PLACES = 24
"""Number of places that are tried where none is given."""
GOOD = 0.01
"""Relative error of distances below which no better place is looked for."""
DETOUR = 2.2
"""Largest length of a path over the middles of triangles over that of the shortest."""
MAX_LEAN = -0.64
"""Least cosine of a normal with that at the middle, where what lies all round cannot be
unrolled."""
ALONG = 0.3
"""Smallest sine of the angle of an axis to the normal for the columns to follow it."""


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
    """A placement is one way to lay a matrix on a link."""

    mesh: UnrolledMesh
    """Map to the link, with the middle of the matrix at (0, 0)."""
    outside: int
    """Number of taxels whose cells do not lie on the allowed surface."""
    distortion: float
    """Largest relative error of the distance of neighbouring taxels."""

    @property
    def rank(self) -> tuple[int, float]:
        """What is less of a better placement."""
        return self.outside, self.distortion


def place_matrix(robot: Robot, spec: MatrixSpec) -> tuple[Skin, float]:
    """Lay a matrix on a link, as a skin of one patch.

    Returns:
        The skin, and the largest relative error of the distance of its neighbours.

    Raises:
        RobotError: The robot lacks the link, or it has no shape.
        SkinError: The matrix has no room there.
    """
    limits = DesignLimits(min_spacing=0.0, clearance=spec.clearance)
    region = RegionSpec(LinkZone(spec.link), spec.pitch**-2)
    whole = DesignSpec(spec.name, (region,), limits=limits)
    robot.link_index(spec.link)
    fine, coarse, _ = build_surfaces(robot, whole)
    surface = fine[spec.link]
    allowed = find_allowed_vertices(robot, whole, fine, coarse)[spec.link]
    usable = np.asarray(allowed[surface.faces].all(axis=1))
    grid = TaxelGrid(spec.rows, spec.columns, spec.pitch, spec.pitch)
    best = None
    for found in iterate_placements(surface, usable, grid, spec):
        if best is None or found.rank < best.rank:
            best = found
        if best.rank < (0, GOOD):
            break
    if best is None or best.outside or best.distortion > spec.max_distortion:
        raise SkinError(describe_misfit(best, surface, spec))
    patch = Patch(spec.name, spec.link, 1, spec.rows, spec.columns)
    skin = build_skin(spec.name, [(patch, grid, best.mesh)])
    if spec.flip:
        order = np.arange(skin.count).reshape(spec.rows, spec.columns)[:, ::-1].ravel()
        names = ("positions", "normals", "areas", "tangents")
        skin = replace(skin, **{name: getattr(skin, name)[order] for name in names})
    return skin, best.distortion


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


def iterate_placements(
    surface: LinkSurface,
    usable: np.ndarray,
    grid: TaxelGrid,
    spec: MatrixSpec,
) -> Iterator[Placement]:
    """Yield the placements of a matrix, those nearest to the middle of the link first.

    Args:
        surface: surface of the link, of small triangles.
        usable: whether skin may lie on each of them.
        grid: cells of the matrix.
        spec: the matrix.
    """
    if spec.at is not None:
        middles = np.array([spec.at])
    else:
        points = thin_vertices(surface, float(np.sqrt(surface.area / PLACES)))[:, :3]
        away = np.linalg.norm(points - surface.vertices.mean(axis=0), axis=1)
        middles = points[np.argsort(away)[:PLACES]]
    locator = PointLocator(surface.vertices, surface.faces)
    faces = locator.locate(middles)[0]
    adjacency = find_adjacency(surface, DesignLimits.max_bend)
    turns = (0.0, np.pi / 2) if spec.turn is None else (spec.turn,)
    places = list(zip(faces.tolist(), middles, strict=True))
    for face, middle in track_progress(places, "places tried", len(places)):
        around = find_faces_around(surface, adjacency, usable, face, grid)
        region = unroll_region(surface, around) if len(around) else None
        if region is None and len(around):
            lean = surface.doubled_normals[around] @ surface.doubled_normals[face]
            sizes = np.linalg.norm(surface.doubled_normals, axis=1)
            faces = around[lean > MAX_LEAN * sizes[around] * sizes[face]]
            region = unroll_region(surface, faces)
        if region is not None:
            for turn in turns:
                yield place_grid(region, middle, turn, grid)


def find_faces_around(
    surface: LinkSurface,
    adjacency: Int[np.ndarray, "pair 2"],
    usable: np.ndarray,
    face: int,
    grid: TaxelGrid,
) -> Int[np.ndarray, "face"]:
    """Find the usable triangles on which a matrix around one of them may lie."""
    if not usable[face]:
        return np.zeros(0, dtype=np.int64)
    middles = surface.corners.mean(axis=1)
    pairs = adjacency[usable[adjacency].all(axis=1)]
    lengths = np.linalg.norm(middles[pairs[:, 0]] - middles[pairs[:, 1]], axis=1)
    graph = coo_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=(len(middles),) * 2)
    sides = np.array([grid.rows * grid.row_pitch, grid.columns * grid.column_pitch])
    reach = float(np.linalg.norm(sides / 2) + grid.row_pitch)
    far = dijkstra(graph.tocsr(), False, indices=face, limit=DETOUR * reach)
    away = np.linalg.norm(middles - middles[face], axis=1)
    return np.flatnonzero(np.isfinite(far) & (away < reach))


def place_grid(
    region: FlatRegion, middle: Float[np.ndarray, "3"], turn: float, grid: TaxelGrid
) -> Placement:
    """Lay a grid on an unrolled region.

    Args:
        region: the region.
        middle: place of the middle of the grid [m].
        turn: angle of its columns, as in `MatrixSpec` [rad].
        grid: the grid.
    """
    points = region.surface.wrap(region.flat)
    mesh = UnrolledMesh(points.positions, points.normals, region.faces, region.flat)
    origin = mesh.unroll(middle[None])
    first = mesh.wrap(origin)
    axis = np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(np.cross(first.normals[0], axis)) < ALONG:
        axis = axis[::-1]
    across = np.cross(first.normals[0], first.tangents[0])
    angle = turn + np.arctan2(across @ axis, first.tangents[0] @ axis)
    cosine, sine = np.cos(angle), np.sin(angle)
    flat = (region.flat - origin) @ np.array([[cosine, -sine], [sine, cosine]])
    mesh = replace(mesh, flat=flat)
    placed = FlatRegion(mesh, flat, region.faces, region.area)
    cells = grid.unrolled()[:, None] + MARGIN * grid.row_pitch * build_cell_points()
    inside = placed.contains(cells.reshape(-1, 2)).reshape(len(cells), -1).all(axis=1)
    present = np.ones((grid.rows, grid.columns), dtype=bool)
    errors = measure_distortion(mesh, present, grid.row_pitch)
    worst = max((float(np.abs(error).max()) for *_, error in errors), default=0.0)
    return Placement(mesh, int(np.count_nonzero(~inside)), worst)


def describe_misfit(
    best: Placement | None, surface: LinkSurface, spec: MatrixSpec
) -> str:
    """Describe why a matrix has no room on a link, and the remedies."""
    width, height = 1e3 * spec.pitch * spec.columns, 1e3 * spec.pitch * spec.rows
    what = (
        f"a matrix of {width:.0f} x {height:.0f} mm does not lie on link "
        f"'{spec.link}', which is {surface.describe_size()} large"
    )
    if best is None:
        why = "its middle is on an edge, hidden, or within the clearance of a link"
    elif best.outside:
        count = spec.rows * spec.columns
        why = f"at best {best.outside} of its {count} taxels hang over"
    else:
        why = (
            f"at best distances are wrong by {100 * best.distortion:.0f} %, allowed "
            f"are {100 * spec.max_distortion:.0f} % (--distortion)"
        )
    return (
        f"{what}: {why}; try another --at or --turn, a smaller --clearance, another "
        "link, or a smaller matrix"
    )
