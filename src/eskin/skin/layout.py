"""This module builds skins from grids of taxels on surfaces."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, inf, isinf, pi, sqrt

import numpy as np
from jaxtyping import Bool, Float

from eskin.skin.skin import Patch, Skin, TaxelKind
from eskin.skin.surfaces import Plane, Surface, Tube
from eskin.transforms import make_transform

Vector = tuple[float, float, float]
X = (1.0, 0.0, 0.0)
Y = (0.0, 1.0, 0.0)
Z = (0.0, 0.0, 1.0)
BACK = (-1.0, 0.0, 0.0)
DOWN = (0.0, 0.0, -1.0)


@dataclass(frozen=True, eq=False)
class TaxelGrid:
    """A grid holds the cells of an unrolled patch, centred on (s, t) = (0, 0).

    Columns are counted along s and rows along t. A taper makes a trapezoid: the column
    pitch changes linearly from row to row, while all rows have as many columns. A mask
    leaves cells out, so a patch may be irregular (Jiang et al. 2025, Fig. 4a).
    """

    rows: int
    columns: int
    row_pitch: float
    """Distance of rows along t [m]."""
    column_pitch: float
    """Distance of columns along s in the first row [m]."""
    taper: float = 1.0
    """Ratio of the column pitch of the last row to the first row's."""
    present: Bool[np.ndarray, "row column"] | None = None
    """Mask of the cells that hold a taxel; None for all of them."""

    def pitches(self) -> Float[np.ndarray, "row"]:
        """Return the column pitch of every row [m]."""
        return self.column_pitch * np.linspace(1.0, self.taper, self.rows)

    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Return row and column of every taxel, row by row."""
        everywhere = np.ones((self.rows, self.columns), dtype=bool)
        rows, columns = np.nonzero(everywhere if self.present is None else self.present)
        return rows, columns

    def unrolled(self) -> Float[np.ndarray, "taxel 2"]:
        """Return the centre (s, t) of every taxel [m]."""
        rows, columns = self.cells()
        s = (columns - (self.columns - 1) / 2) * self.pitches()[rows]
        t = (rows - (self.rows - 1) / 2) * self.row_pitch
        return np.column_stack([s, t])

    def areas(self) -> Float[np.ndarray, "taxel"]:
        """Return the area of every taxel's cell, unrolled [m2]."""
        return self.pitches()[self.cells()[0]] * self.row_pitch


def cut_corners(
    rows: int, columns: int, cuts: tuple[int, int, int, int]
) -> Bool[np.ndarray, "row column"]:
    """Return the mask of a grid without a triangle of cells at each corner.

    `cuts` are the lengths of the triangles [cells] at the first row's first and last
    column, then at the last row's first and last column.
    """
    row, column = np.mgrid[:rows, :columns]
    from_end = rows - 1 - row
    from_right = columns - 1 - column
    corners = (row + column, row + from_right, from_end + column, from_end + from_right)
    return np.all([d >= cut for d, cut in zip(corners, cuts, strict=True)], axis=0)


def build_skin(
    name: str, placed: list[tuple[Patch, TaxelGrid, Surface]], calibrated: bool = True
) -> Skin:
    """Build a skin of patches; its taxels are ordered by patch, row and column.

    Each patch has its grid and the surface that it is laid on; a skin is not calibrated
    where geometry and units are nominal.
    """
    cells = [grid.cells() for _, grid, _ in placed]
    points = [surface.wrap(grid.unrolled()) for _, grid, surface in placed]
    areas = [
        grid.areas() * wrapped.area_scale
        for (_, grid, _), wrapped in zip(placed, points, strict=True)
    ]
    return Skin(
        name=name,
        patches=tuple(patch for patch, _, _ in placed),
        patch_index=np.repeat(np.arange(len(placed)), [len(a) for a in areas]),
        rows=np.concatenate([rows for rows, _ in cells]),
        columns=np.concatenate([columns for _, columns in cells]),
        positions=np.concatenate([wrapped.positions for wrapped in points]),
        normals=np.concatenate([wrapped.normals for wrapped in points]),
        areas=np.concatenate(areas),
        tangents=np.concatenate([wrapped.tangents for wrapped in points]),
        calibrated=calibrated,
    )


def build_grid_skin(
    rows: int,
    columns: int,
    pitch: float = 0.010,
    kind: TaxelKind = "pressure",
    *,
    name: str = "grid",
    calibrated: bool = False,
) -> Skin:
    """Build a skin of one flat, full grid in the plane z = 0 of link `table`.

    Columns are counted along x, rows along y; normals are +z; the centre of the grid is
    the link's origin.

    Args:
        rows: number of rows.
        columns: number of columns.
        pitch: distance of neighbouring taxels [m].
        kind: what the taxels measure.
        name: name of the skin.
        calibrated: False where pitch and units are nominal.
    """
    if rows < 1 or columns < 1 or not pitch > 0:
        raise ValueError(
            f"a grid of {rows} x {columns} taxels with pitch {pitch} m; allowed at "
            "least 1 x 1 and a pitch above 0"
        )
    patch = Patch("grid", "table", 1, rows, columns, kind)
    grid = TaxelGrid(rows, columns, pitch, pitch)
    return build_skin(name, [(patch, grid, Plane(np.eye(4)))], calibrated)


@dataclass(frozen=True)
class LinkPart:
    """A part is a straight tube, or a flat end, of a link on which patches can lie."""

    link: str
    centre: Vector
    """Centre of the part, on the axis of a tube [m]; patches are offset from it."""
    axis: Vector
    """Direction along a tube, or outward from a flat end."""
    length: float
    """Length of a tube, or diameter of a flat end [m]."""
    radius: float = inf
    """Radius of a tube; infinite for a flat end [m]."""

    @property
    def width(self) -> float:
        """Return the circumference of a tube, or the diameter of a flat end [m]."""
        return self.length if isinf(self.radius) else 2 * pi * self.radius

    def surface(self, front: Vector, offset: float) -> Surface:
        """Return the surface with t = 0 at `offset` [m]; for `front` see an outline."""
        z = np.array(self.axis)
        x = np.array(front)
        t_axis = np.cross(z, x) if isinf(self.radius) else z
        rotation = np.column_stack([x, np.cross(z, x), z])
        pose = make_transform(rotation, np.array(self.centre) + offset * t_axis)
        return Plane(pose) if isinf(self.radius) else Tube(self.radius, pose)


@dataclass(frozen=True)
class PatchOutline:
    """An outline describes a patch on a link part: a grid with corners cut off."""

    name: str
    """Id of the patch."""
    part: str
    """Name of the part that it is laid on."""
    front: Vector
    """Direction of s = 0 from the axis of a tube, or of s on a flat end, in the link's
    frame."""
    rows: int
    columns: int
    row_pitch: float
    """Distance of rows [m]."""
    column_pitch: float
    """Distance of columns in the first row [m]."""
    cuts: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Cells missing at the corners, as in `cut_corners`."""
    taper: float = 1.0
    """Ratio of the column pitch of the last row to the first row's."""
    offset: float = 0.0
    """Distance of its middle from the middle of the part, along t [m]."""

    def grid(self) -> TaxelGrid:
        """Return the grid of its taxels."""
        present = cut_corners(self.rows, self.columns, self.cuts)
        pitches = self.row_pitch, self.column_pitch
        return TaxelGrid(self.rows, self.columns, *pitches, self.taper, present)


def scale_density(outline: PatchOutline, factor: float) -> PatchOutline:
    """Return an outline with about `factor` times the taxels, in whole rows."""
    rows = round(outline.rows * sqrt(factor))
    columns = round(outline.rows * outline.columns * factor / rows)
    first, first_last, last, last_last = (
        round(cut * sqrt(factor)) for cut in outline.cuts
    )
    return replace(
        outline,
        rows=rows,
        columns=columns,
        row_pitch=outline.row_pitch * (outline.rows / rows),
        column_pitch=outline.column_pitch * (outline.columns / columns),
        cuts=(first, first_last, last, last_last),
    )


def fit_to_part(
    outline: PatchOutline, drawn_for: LinkPart, part: LinkPart
) -> PatchOutline:
    """Return the outline for a part of another size, with the same pitches."""
    length_ratio = part.length / drawn_for.length
    width_ratio = part.width / drawn_for.width
    # Rounded down, so that the patch fits; exact ratios do not lose a row.
    return replace(
        outline,
        rows=floor(outline.rows * length_ratio + 1e-9),
        columns=floor(outline.columns * width_ratio + 1e-9),
        offset=outline.offset * length_ratio,
    )


def build_outline_skin(
    name: str,
    outlines: Sequence[PatchOutline],
    parts: Mapping[str, LinkPart],
    missing: Collection[str] = (),
) -> Skin:
    """Build a skin of outlines on parts of links.

    Args:
        name: name of the skin.
        outlines: its patches, which get the addresses 1, 2, 3 and so on.
        parts: parts of links, by the names in the outlines.
        missing: patches to leave out; their addresses stay unused.

    Raises:
        ValueError: A patch in `missing` is not among the outlines.
    """
    names = [outline.name for outline in outlines]
    if not set(missing) <= set(names):
        raise ValueError(
            f"no patch {sorted(set(missing) - set(names))} to leave out; the patches: "
            f"{', '.join(names)}"
        )
    placed = []
    for number, outline in enumerate(outlines, 1):
        part = parts[outline.part]
        grid = outline.grid()
        patch = Patch(outline.name, part.link, number, grid.rows, grid.columns)
        if outline.name not in missing:
            placed.append((patch, grid, part.surface(outline.front, outline.offset)))
    return build_skin(name, placed)
