"""This module cuts a region of a link's surface into patches with a grid of taxels."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import MultiPoint, get_coordinates, minimum_rotated_rectangle

from eskin.design.spec import DesignLimits
from eskin.design.surface import LinkSurface
from eskin.design.unroll import FlatRegion, turn_region, unroll_region
from eskin.design.zones import Zone
from eskin.progress import show_progress
from eskin.registry import find_package
from eskin.skin import Surface, TaxelGrid, Tube

igl = find_package("igl", "libigl", "design", "skin design")

PHASES = 4
"""Number of positions of a grid that are tried, along each axis."""
STEPS = 8
"""Number of pieces in which the distance of two neighbours is measured."""
MAX_SKIPPED = 0.04
"""Largest fraction of the cells that is left out where they are too distorted."""
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Steps in rows and columns to the neighbours whose distances are measured."""
MARGIN = 0.98
"""Size of the square of a cell that lies in its region, over the cell's."""
MAX_DENSITY_ERROR = 0.09
"""Largest relative error of the area of a patch, and so of its density."""
CELLS_AT_ONCE = 50_000
"""Number of cells that are compared with a region at once."""
CELL_POINTS = 4
"""Number of points along a side of a cell that must lie in its region."""

Mask = Bool[np.ndarray, "row column"]


@dataclass(frozen=True, eq=False)
class PatchLayout:
    """A layout holds a patch's taxels in the plane, and their map to the link."""

    surface: Surface
    """Map between the plane and the link; (0, 0) is the centre of the grid."""
    grid: TaxelGrid
    """Cells of the taxels."""
    distortion: float
    """Largest relative error of the unrolled distance of neighbouring taxels."""


@dataclass(frozen=True, eq=False)
class RegionTask:
    """A task says which part of a surface is to be covered, and how."""

    surface: LinkSurface
    """Surface of the link."""
    adjacency: Int[np.ndarray, "pair 2"]
    """Pairs of triangles across an edge over which a patch may be bent."""
    pitch: float
    """Distance of neighbouring taxels [m]."""
    limits: DesignLimits
    """Limits of the whole skin."""
    keep_outs: tuple[Zone, ...]
    """Zones of the link without skin."""
    random: np.random.Generator
    """Source of the phases of the grids."""


def find_adjacency(surface: LinkSurface, max_bend: float) -> Int[np.ndarray, "pair 2"]:
    """Return pairs of triangles that meet at an edge of at most an angle [rad]."""
    faces = surface.faces
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    # A closed manifold surface has every edge twice.
    pairs = (order // 3).reshape(-1, 2)
    length = np.linalg.norm(surface.doubled_normals, axis=1, keepdims=True)
    normals = surface.doubled_normals / np.maximum(length, 1e-30)
    cosine = np.sum(normals[pairs[:, 0]] * normals[pairs[:, 1]], axis=1)
    # Triangles without area have no angle.
    thin = (length[pairs, 0] < 1e-13).any(axis=1)
    return pairs[(cosine >= np.cos(max_bend)) | thin]


def lay_patches(
    task: RegionTask, faces: Int[np.ndarray, "allowed"]
) -> Iterator[PatchLayout]:
    """Yield the patches that cover some triangles, from the largest piece on.

    A piece that cannot be unrolled within the limit of distortion is cut in two.
    """
    least = task.limits.min_taxels * task.pitch**2
    waiting = split_connected(task, faces)
    with show_progress("triangles covered", len(faces)) as update:
        while waiting:
            update(len(faces) - sum(map(len, waiting)))
            piece = waiting.pop(0)
            if compute_area(task.surface, piece) < least:
                continue
            layouts = lay_piece(task, piece)
            if layouts is None:
                waiting = [
                    part
                    for half in bisect(task, piece)
                    for part in split_connected(task, half)
                ] + waiting
            else:
                yield from layouts


def split_connected(
    task: RegionTask, faces: Int[np.ndarray, "part"]
) -> list[Int[np.ndarray, "piece"]]:
    """Return the connected pieces of some triangles, the largest first."""
    number = np.full(len(task.surface.faces), -1)
    number[faces] = np.arange(len(faces))
    pairs = number[task.adjacency]
    pairs = pairs[(pairs >= 0).all(axis=1)]
    graph = coo_array(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(faces),) * 2
    )
    count, labels = connected_components(graph, directed=False)
    order = np.argsort(labels, kind="stable")
    pieces = np.split(
        faces[order], np.cumsum(np.bincount(labels, minlength=count))[:-1]
    )
    return sorted(pieces, key=lambda piece: -compute_area(task.surface, piece))


def compute_area(surface: LinkSurface, faces: Int[np.ndarray, "part"]) -> float:
    """Return the area of some triangles [m2]."""
    if len(faces) == 0:
        return 0.0
    return float(igl.doublearea(surface.vertices, surface.faces[faces]).sum() / 2)


def lay_piece(
    task: RegionTask, piece: Int[np.ndarray, "piece"]
) -> list[PatchLayout] | None:
    """Lay a grid of taxels on a connected piece; None where it must be cut first."""
    region = unroll_region(task.surface, piece)
    if region is None:
        return None
    region, present = place_grid(task, region)
    cells = np.argwhere(present)
    if len(cells) < task.limits.min_taxels:
        return []
    errors = measure_distortion(region.surface, present, task.pitch)
    bad = mark_distorted(errors, present.shape, task.limits.max_distortion)
    if np.count_nonzero(bad & present) > MAX_SKIPPED * len(cells):
        return None
    layouts = list(cut_into_boards(task, region, present & ~bad))
    dense = any(measure_stretch(p) > MAX_DENSITY_ERROR for p in layouts)
    return None if dense else layouts


def measure_stretch(layout: PatchLayout) -> float:
    """Return the relative error of a patch's area in the plane."""
    scale = layout.surface.wrap(layout.grid.unrolled()).area_scale
    return abs(float(scale.mean()) - 1.0)


def place_grid(task: RegionTask, region: FlatRegion) -> tuple[FlatRegion, Mask]:
    """Turn and shift a region so that a grid centred on (0, 0) has most taxels.

    Returns:
        The region in the coordinates of the grid, and the cells that lie in it.
    """
    box = minimum_rotated_rectangle(MultiPoint(region.flat[np.unique(region.faces)]))
    side = np.diff(get_coordinates(box)[:3], axis=0) if box.area > 0 else None
    angle = 0.0
    if side is not None and not isinstance(region.surface, Tube):
        longest = side[np.argmax(np.linalg.norm(side, axis=1))]
        # Rows follow each other along the longer side.
        angle = float(np.arctan2(longest[1], longest[0]) - np.pi / 2)
    region = turn_region(region, angle, np.zeros((1, 2)))
    used = region.flat[np.unique(region.faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    counts = np.maximum(np.floor((high - low) / task.pitch).astype(int) + 1, 1)
    middle = (low + high) / 2
    jitter = task.random.random(2)
    phases = (np.argwhere(np.ones((PHASES, PHASES))) + jitter) / PHASES - 0.5
    origins = middle + task.pitch * phases
    present = find_cells(task, region, counts + 1, origins)
    best = int(np.argmax(present.sum(axis=(1, 2))))
    return turn_region(region, 0.0, origins[best : best + 1]), present[best]


def find_cells(
    task: RegionTask,
    region: FlatRegion,
    counts: Int[np.ndarray, "2"],
    origins: Float[np.ndarray, "grid 2"],
) -> Bool[np.ndarray, "grid row column"]:
    """Return the cells of grids around some centres that lie in a region.

    A cell lies in the region where its middle does, and points along its sides.

    Args:
        task: task with the pitch and the keep-out zones.
        region: the region.
        counts: number of columns and of rows.
        origins: centres of the grids, in the coordinates of the region [m].
    """
    columns, rows = counts.tolist()
    centres = compute_centres(rows, columns, task.pitch)
    offsets = MARGIN * task.pitch * build_cell_points()
    zones = [zone for zone in task.keep_outs if zone.link == task.surface.link]
    found = np.zeros((len(origins), rows * columns), dtype=bool)
    for row, origin in zip(found, origins, strict=True):
        for start in range(0, len(centres), CELLS_AT_ONCE):
            part = slice(start, start + CELLS_AT_ONCE)
            flat = (origin + centres[part, None] + offsets).reshape(-1, 2)
            inside = region.contains(flat)
            if zones and inside.any():
                places = region.surface.wrap(flat[inside]).positions
                blocked = np.any([zone.contains(places) for zone in zones], axis=0)
                inside[np.flatnonzero(inside)[blocked]] = False
            row[part] = inside.reshape(-1, len(offsets)).all(axis=1)
    return found.reshape(-1, rows, columns)


def build_cell_points() -> Float[np.ndarray, "point 2"]:
    """Return the middle of a cell of side 1, and points along its sides."""
    side = np.linspace(-0.5, 0.5, CELL_POINTS)
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    border = points[np.abs(points).max(axis=1) == 0.5]
    return np.concatenate([np.zeros((1, 2)), border])


def compute_centres(
    rows: int, columns: int, pitch: float
) -> Float[np.ndarray, "cell 2"]:
    """Return the centres (s, t) of all cells of a grid centred on (0, 0) [m]."""
    return TaxelGrid(rows, columns, pitch, pitch).unrolled()


def measure_distortion(
    surface: Surface, present: Mask, pitch: float
) -> list[tuple[Int[np.ndarray, "edge 2"], Int[np.ndarray, "edge 2"], np.ndarray]]:
    """Measure the lines between neighbouring cells on the surface.

    Returns:
        For each direction the cells at both ends, and the relative error of the
        unrolled length of each line.
    """
    rows, columns = present.shape
    centres = compute_centres(rows, columns, pitch).reshape(rows, columns, 2)
    found = []
    for step in NEIGHBOURS:
        first = np.argwhere(present)
        second = first + step
        inside = ((second >= 0) & (second < present.shape)).all(axis=1)
        first = first[inside]
        second = second[inside]
        both = present[tuple(second.T)]
        first = first[both]
        second = second[both]
        if len(first) == 0:
            continue
        a = centres[tuple(first.T)]
        b = centres[tuple(second.T)]
        part = np.linspace(0.0, 1.0, STEPS + 1)[None, :, None]
        line = surface.wrap((a[:, None] + part * (b - a)[:, None]).reshape(-1, 2))
        points = line.positions.reshape(len(first), STEPS + 1, 3)
        length = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
        flat = np.linalg.norm(b - a, axis=1)
        found.append((first, second, length / flat - 1.0))
    return found


def mark_distorted(
    errors: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    shape: tuple[int, int],
    limit: float,
) -> Mask:
    """Mark the cells that have a distorted neighbour and are themselves distorted.

    Of each line that is too long or too short, the cell with more such lines is marked,
    until none is left.
    """
    pairs = [
        np.column_stack([first, second])[np.abs(error) > limit]
        for first, second, error in errors
    ]
    lines = np.concatenate([np.zeros((0, 4), dtype=int), *pairs])
    bad = np.zeros(shape, dtype=bool)
    while len(lines):
        counts = np.zeros(shape, dtype=int)
        np.add.at(counts, tuple(lines[:, :2].T), 1)
        np.add.at(counts, tuple(lines[:, 2:].T), 1)
        worst = np.unravel_index(np.argmax(counts), shape)
        bad[worst] = True
        holds = (lines[:, :2] == worst).all(axis=1) | (lines[:, 2:] == worst).all(
            axis=1
        )
        lines = lines[~holds]
    return bad


def cut_into_boards(
    task: RegionTask, region: FlatRegion, present: Mask
) -> Iterator[PatchLayout]:
    """Cut a grid into patches that a board can read, with lines that can be routed."""
    limits = task.limits
    used = np.argwhere(present)
    if len(used) == 0:
        return
    low, high = used.min(axis=0).tolist(), (used.max(axis=0) + 1).tolist()
    row_cuts = divide(low[0], high[0], limits.max_rows)
    column_cuts = divide(low[1], high[1], limits.max_columns)
    for top, bottom in row_cuts:
        for left, right in column_cuts:
            block = np.zeros_like(present)
            block[top:bottom, left:right] = present[top:bottom, left:right]
            for patch in iterate_routable(block, limits.min_taxels):
                yield build_layout(region, patch, task.pitch)


def divide(low: int, high: int, max_length: int) -> list[tuple[int, int]]:
    """Divide a range into the fewest parts of at most some length, of even lengths."""
    parts = ceil((high - low) / max_length)
    ends = np.linspace(low, high, parts + 1).round().astype(int).tolist()
    return list(zip(ends[:-1], ends[1:], strict=True))


def iterate_routable(block: Mask, least: int) -> Iterator[Mask]:
    """Yield parts of a block in which all rows and all columns cross.

    Every row of a part is one run of cells that holds the same column, and every column
    one that holds the same row, so that lines to one connector need not cross. No row
    or column has a single cell.

    Args:
        block: mask of the cells.
        least: smallest number of cells of a part.
    """
    left = block.copy()
    while left.sum() >= least:
        labels, _ = label(left)  # type: ignore[misc]
        sizes = np.bincount(labels.ravel())[1:]
        piece = labels == 1 + int(np.argmax(sizes))
        if piece.sum() < least:
            return
        part = find_crossing_part(piece)
        if part.sum() >= least:
            yield part
            left &= ~part
        else:
            left &= ~piece


def find_crossing_part(piece: Mask) -> Mask:
    """Return the largest part, for the best of some crossings, that can be routed."""
    cells = np.argwhere(piece)
    middle = np.median(cells, axis=0)
    order = np.argsort(np.abs(cells - middle).sum(axis=1), kind="stable")
    best = np.zeros_like(piece)
    for row, column in cells[order[:: max(1, len(order) // 24)]]:
        part = drop_thin_lines(keep_crossing(piece, int(row), int(column)))
        if part.sum() > best.sum():
            best = part
    return best


def keep_crossing(piece: Mask, row: int, column: int) -> Mask:
    """Keep the runs of the rows through a column, and of the columns through a row."""
    part = piece
    while True:
        kept = keep_runs(keep_runs(part, column).T, row).T
        if (kept == part).all():
            return part
        part = kept


def drop_thin_lines(part: Mask) -> Mask:
    """Drop rows and columns of a single cell, until none is left."""
    while True:
        rows, columns = part.sum(axis=1) > 1, part.sum(axis=0) > 1
        kept = part & rows[:, None] & columns[None]
        if (kept == part).all():
            return part
        part = kept


def keep_runs(piece: Mask, column: int) -> Mask:
    """Keep in every row the run of cells that holds a column."""
    right = np.cumprod(piece[:, column:], axis=1).astype(bool)
    left = np.cumprod(piece[:, column::-1], axis=1).astype(bool)[:, ::-1]
    return np.concatenate([left[:, :-1], right], axis=1)


def build_layout(region: FlatRegion, part: Mask, pitch: float) -> PatchLayout:
    """Build the layout of some cells of a region's grid."""
    rows, columns = np.flatnonzero(part.any(axis=1)), np.flatnonzero(part.any(axis=0))
    present = part[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    middle = np.array([columns[0] + columns[-1], rows[0] + rows[-1]]) / 2
    origin = pitch * (middle - (np.array(part.shape[::-1]) - 1) / 2)
    surface = turn_region(region, 0.0, origin[None]).surface
    errors = measure_distortion(surface, present, pitch)
    worst = max((float(np.abs(error).max()) for *_, error in errors), default=0.0)
    grid = TaxelGrid(len(rows), len(columns), pitch, pitch, present=present)
    return PatchLayout(surface, grid, worst)


def bisect(
    task: RegionTask, piece: Int[np.ndarray, "piece"]
) -> list[Int[np.ndarray, "half"]]:
    """Cut a piece in two by the plane that leaves both halves flattest.

    Planes through the middle are tried, across the principal axes of the triangles and
    of their normals. The flatness of a half is the length of its mean normal.
    """
    doubled = task.surface.doubled_normals[piece]
    weights = np.maximum(np.linalg.norm(doubled, axis=1), 1e-30)
    centres = task.surface.vertices[task.surface.faces[piece]].mean(axis=1)
    centres = centres - np.average(centres, axis=0, weights=weights)
    unit = doubled / weights[:, None]
    axes = [
        *np.linalg.eigh((centres * weights[:, None]).T @ centres)[1].T,
        *np.linalg.eigh((unit * weights[:, None]).T @ unit)[1].T,
    ]
    best = None
    least = np.inf
    size = np.sqrt(weights.sum())
    for axis in axes:
        height = centres @ axis
        order = np.argsort(height, kind="stable")
        half = np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)
        above = height > height[order[min(half, len(order) - 1)]]
        if not 0 < above.sum() < len(above):
            continue
        curved = sum(
            weights[side].sum() - np.linalg.norm(doubled[side].sum(axis=0))
            for side in (above, ~above)
        )
        # Of planes that leave the same curvature, the one across the longer side.
        cost = curved / weights.sum() - 0.05 * np.std(height) / size
        if cost < least:
            best = above
            least = cost
    if best is None:
        return []
    return [piece[best], piece[~best]]
