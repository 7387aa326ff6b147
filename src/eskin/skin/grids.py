"""Flat grids of taxels on a table, for skins whose shape is not known or not round."""

import numpy as np

from eskin.skin.layout import Grid, join_patches
from eskin.skin.skin import Kind, Patch, Skin
from eskin.skin.surface import Plane

__all__ = ["grid_skin"]


def grid_skin(
    rows: int,
    columns: int,
    pitch: float = 0.010,
    kind: Kind = "pressure",
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
    grid = Grid(rows, columns, pitch, pitch)
    return join_patches(name, [(patch, grid, Plane(np.eye(4)))], calibrated)
