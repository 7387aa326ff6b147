"""How much room each taxel has between its neighbours in row and column."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.skin.skin import Skin

__all__ = ["Spacing", "measure_spacing"]


@dataclass(frozen=True, eq=False)
class Spacing:
    """What the cells beside each taxel say about it."""

    cell_areas: Float[np.ndarray, "taxel"]
    """Distance to the next in the row times that in the column [m2]; else NaN."""

    neighbour_normals: Float[np.ndarray, "taxel 3"]
    """Sum of the normals of the cells beside it; zero where there are none."""


def measure_spacing(skin: Skin) -> Spacing:
    """Measure the room of every taxel."""
    steps = np.full((2, skin.count), np.inf)
    normals = np.zeros((skin.count, 3))
    for row_step, column_step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside = neighbour(skin, row_step, column_step)
        known = np.flatnonzero(beside >= 0)
        other = beside[known]
        axis = abs(row_step)
        gap = np.linalg.norm(skin.positions[known] - skin.positions[other], axis=1)
        steps[axis, known] = np.minimum(steps[axis, known], gap)
        normals[known] += skin.normals[other]
    # Where only one direction is known, the cell is taken for a square.
    first = np.where(np.isfinite(steps[0]), steps[0], steps[1])
    second = np.where(np.isfinite(steps[1]), steps[1], steps[0])
    areas = first * second
    return Spacing(np.where(np.isfinite(areas) & (areas > 0), areas, np.nan), normals)


def neighbour(skin: Skin, row_step: int, column_step: int) -> Int[np.ndarray, "taxel"]:
    """The taxel that many rows and columns on in the same patch, or -1."""
    if skin.count == 0:
        return np.zeros(0, dtype=np.int64)
    width = int(skin.columns.max()) + 3
    height = int(skin.rows.max()) + 3

    def keys(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return (skin.patch_index * height + rows + 1) * width + columns + 1

    own = keys(skin.rows, skin.columns)
    order = np.argsort(own, kind="stable")
    wanted = keys(skin.rows + row_step, skin.columns + column_step)
    place = np.minimum(np.searchsorted(own[order], wanted), skin.count - 1)
    found = order[place]
    return np.where(own[found] == wanted, found, -1)
