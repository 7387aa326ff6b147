"""Laying a grid of taxels on a surface, and patches together into a skin."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from eskin.skin.skin import Patch, Skin
from eskin.skin.surface import Surface, Wrapped

__all__ = ["Grid", "join_patches", "without_corners"]


@dataclass(frozen=True, eq=False)
class Grid:
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


def without_corners(
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


def join_patches(
    name: str, laid: list[tuple[Patch, Grid, Surface]], calibrated: bool = True
) -> Skin:
    """Lay each grid on its surface and count the taxels patch by patch, row by row."""
    cells = [grid.cells() for _, grid, _ in laid]
    wraps: list[Wrapped] = [surface.wrap(grid.unrolled()) for _, grid, surface in laid]
    areas = [
        grid.areas() * wrapped.stretch
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
