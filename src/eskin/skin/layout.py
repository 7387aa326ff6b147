"""This module lays out patches on surfaces."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, inf, isinf, pi, sqrt

import numpy as np
from jaxtyping import Bool, Float

from eskin.skin.skin import Patch, Skin, TaxelKind
from eskin.skin.surfaces import Plane, Surface, SurfacePoints, Tube
from eskin.transforms import make_transform


@dataclass(frozen=True, eq=False)
class TaxelGrid:
    """Cells of a patch drawn flat, about (s, t) = (0, 0).

    Columns run along s and rows along t. A taper makes a trapezoid: every row keeps
    its number of columns, and they draw together.
    """

    rows: int
    columns: int
    row_pitch: float
    """Distance of rows along t [m]."""

    column_pitch: float
    """Distance of columns along s in the first row [m]."""

    taper: float = 1.0
    """Column pitch of the last row over that of the first."""

    present: Bool[np.ndarray, "row column"] | None = None
    """Cells that hold a taxel; all of them where None."""

    def pitches(self) -> Float[np.ndarray, "row"]:
        """Column pitch of every row [m]."""
        return self.column_pitch * np.linspace(1.0, self.taper, self.rows)

    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of every taxel, row by row."""
        everywhere = np.ones((self.rows, self.columns), dtype=bool)
        rows, columns = np.nonzero(everywhere if self.present is None else self.present)
        return rows, columns

    def unrolled(self) -> Float[np.ndarray, "taxel 2"]:
        """Centre (s, t) of every taxel [m]."""
        rows, columns = self.cells()
        s = (columns - (self.columns - 1) / 2) * self.pitches()[rows]
        t = (rows - (self.rows - 1) / 2) * self.row_pitch
        return np.column_stack([s, t])

    def areas(self) -> Float[np.ndarray, "taxel"]:
        """Area of every taxel's cell, drawn flat [m2]."""
        return self.pitches()[self.cells()[0]] * self.row_pitch


def cut_corners(
    rows: int, columns: int, cuts: tuple[int, int, int, int]
) -> Bool[np.ndarray, "row column"]:
    """A full grid but for a staircase triangle at each corner.

    Args:
        rows: rows of the grid.
        columns: columns of the grid.
        cuts: cells missing along the edge at the first row's first and last column,
            then at the last row's first and last column.
    """
    row, column = np.mgrid[:rows, :columns]
    up, left = rows - 1 - row, columns - 1 - column
    first, first_last, last, last_last = cuts
    return (
        (row + column >= first)
        & (row + left >= first_last)
        & (up + column >= last)
        & (up + left >= last_last)
    )


def build_skin(
    name: str, laid: list[tuple[Patch, TaxelGrid, Surface]], calibrated: bool = True
) -> Skin:
    """Lay each grid on its surface and count the taxels patch by patch, row by row."""
    cells = [grid.cells() for _, grid, _ in laid]
    wraps: list[SurfacePoints] = [
        surface.wrap(grid.unrolled()) for _, grid, surface in laid
    ]
    areas = [
        grid.areas() * wrapped.area_scale
        for (_, grid, _), wrapped in zip(laid, wraps, strict=True)
    ]
    return Skin(
        name=name,
        patches=tuple(patch for patch, _, _ in laid),
        patch_index=np.repeat(np.arange(len(laid)), [len(a) for a in areas]),
        rows=np.concatenate([rows for rows, _ in cells]),
        columns=np.concatenate([columns for _, columns in cells]),
        positions=np.concatenate([wrapped.positions for wrapped in wraps]),
        normals=np.concatenate([wrapped.normals for wrapped in wraps]),
        areas=np.concatenate(areas),
        tangents=np.concatenate([wrapped.tangents for wrapped in wraps]),
        calibrated=calibrated,
    )


Vector = tuple[float, float, float]

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BACK, DOWN = (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)


@dataclass(frozen=True)
class LinkPart:
    """A straight tube or a flat end of a link, which patches are laid on."""

    link: str
    """Link that it is part of."""

    centre: Vector
    """Where the middle of a patch comes to lie, on the axis of a tube [m]."""

    axis: Vector
    """Along a tube; out of a flat end."""

    length: float
    """Of a tube; diameter of a flat end [m]."""

    radius: float = inf
    """Of a tube; infinite where it is flat [m]."""

    @property
    def girth(self) -> float:
        """Once round a tube; diameter of a flat end [m]."""
        return self.length if isinf(self.radius) else 2 * pi * self.radius

    def surface(self, front: Vector, along: float) -> Surface:
        """The part unrolled: s = 0 toward its front, t = 0 so far along [m]."""
        z, x = np.array(self.axis), np.array(front)
        t_axis = np.cross(z, x) if isinf(self.radius) else z
        rotation = np.column_stack([x, np.cross(z, x), z])
        placed = make_transform(rotation, np.array(self.centre) + along * t_axis)
        return Plane(placed) if isinf(self.radius) else Tube(self.radius, placed)


@dataclass(frozen=True)
class PatchOutline:
    """A patch before it has a place: a grid with corners cut off."""

    name: str
    """Id of the patch."""

    part: str
    """Name of the part that it is laid on."""

    front: Vector
    """Direction in the link's frame that the middle of its columns faces; along the
    columns on a flat end."""

    rows: int
    columns: int
    row_pitch: float
    """[m]"""

    column_pitch: float
    """In the first row [m]."""

    cuts: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Cells missing at the corners, as in `cut_corners`."""

    taper: float = 1.0
    """Column pitch of the last row over that of the first."""

    along: float = 0.0
    """Its middle from that of the part, along t [m]."""

    def grid(self) -> TaxelGrid:
        """Its cells."""
        present = cut_corners(self.rows, self.columns, self.cuts)
        pitches = self.row_pitch, self.column_pitch
        return TaxelGrid(self.rows, self.columns, *pitches, self.taper, present)


def scale_density(outline: PatchOutline, factor: float) -> PatchOutline:
    """The same outline with so many times the taxels, as far as whole rows allow."""
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
    """The outline for a part of another size: as dense, with more rows and columns."""
    longer, wider = part.length / drawn_for.length, part.girth / drawn_for.girth
    return replace(
        outline,
        rows=whole(outline.rows * longer),
        columns=whole(outline.columns * wider),
        along=outline.along * longer,
    )


def whole(number: float) -> int:
    """The whole number below, for which there is room."""
    return floor(number + 1e-9)


def build_outline_skin(
    name: str,
    outlines: Sequence[PatchOutline],
    parts: Mapping[str, LinkPart],
    missing: Collection[str] = (),
) -> Skin:
    """Lay every outline on its part; one that is missing leaves its address free.

    Raises:
        ValueError: what should be missing is not there anyhow.
    """
    names = [outline.name for outline in outlines]
    if not set(missing) <= set(names):
        raise ValueError(
            f"no patch {sorted(set(missing) - set(names))} to leave out; the patches: "
            f"{', '.join(names)}"
        )
    laid = []
    for number, outline in enumerate(outlines, 1):
        part, grid = parts[outline.part], outline.grid()
        patch = Patch(outline.name, part.link, number, grid.rows, grid.columns)
        if outline.name not in missing:
            surface = part.surface(outline.front, outline.along)
            laid.append((patch, grid, surface))
    return build_skin(name, laid)


def build_grid_skin(
    rows: int,
    columns: int,
    pitch: float = 0.010,
    kind: TaxelKind = "pressure",
    *,
    name: str = "grid",
    calibrated: bool = False,
) -> Skin:
    """A flat full grid in the plane z = 0 of link `table`, facing up.

    Columns run along x, rows along y; the middle of the grid is the link's origin.

    Args:
        rows: number of rows.
        columns: number of columns.
        pitch: distance of neighbouring taxels [m].
        kind: what the taxels measure.
        name: name of the skin.
        calibrated: False where the pitch or the units are only nominal.
    """
    if rows < 1 or columns < 1 or not pitch > 0:
        raise ValueError(
            f"a grid of {rows} x {columns} taxels with pitch {pitch} m; allowed at "
            "least 1 x 1 and a pitch above 0"
        )
    patch = Patch("grid", "table", 1, rows, columns, kind)
    grid = TaxelGrid(rows, columns, pitch, pitch)
    return build_skin(name, [(patch, grid, Plane(np.eye(4)))], calibrated)
