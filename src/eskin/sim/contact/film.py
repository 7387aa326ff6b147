"""How the film over the taxels spreads pressure to their neighbours."""

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.contact.contact_kernels import leak
from eskin.skin import Skin

__all__ = ["grid_neighbours", "leak_share", "spread"]


def leak_share(
    sigma: float, areas: Float[np.ndarray, "taxel"]
) -> Float[np.ndarray, "taxel"]:
    """Share beta of its load that an evenly loaded taxel gives to each side.

    Args:
        sigma: deviation of the film's spread, a Gaussian [m].
        areas: of the taxels; square ones [m2].
    """
    return sigma / np.sqrt(2 * np.pi * areas)


def grid_neighbours(skin: Skin) -> Int[np.ndarray, "taxel 4"]:
    """Taxels beside each one in its patch's grid, -1 where there is none.

    In order: the column before, the column after, the row before, the row after.
    """
    rows, columns = skin.rows + 1, skin.columns + 1
    shape = (len(skin.patches), rows.max(initial=0) + 2, columns.max(initial=0) + 2)
    grid = np.full(shape, -1, dtype=np.int64)
    grid[skin.patch_index, rows, columns] = np.arange(skin.count)
    sides = ((0, -1), (0, 1), (-1, 0), (1, 0))
    found = [grid[skin.patch_index, rows + r, columns + c] for r, c in sides]
    return np.stack(found, axis=1)


def spread(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    neighbours: Int[np.ndarray, "taxel 4"],
    beta: float | Float[np.ndarray, "taxel"],
) -> tuple[Float[np.ndarray, "time more"], Int[np.ndarray, "more"]]:
    """Pressures after the film [kPa], and the taxels that they are of, ascending.

    Args:
        pressure: of the active taxels [kPa].
        taxels: the active ones, as indices of the skin.
        neighbours: as `grid_neighbours` gives them.
        beta: share given to each side, one for all taxels of the skin or one each;
            what goes beyond the edge of a patch is lost.
    """
    reached = np.unique(np.append(neighbours[taxels], taxels))
    reached = reached[reached >= 0]
    column_of = np.zeros(len(neighbours), dtype=np.int64)
    column_of[reached] = np.arange(len(reached))
    shares = np.broadcast_to(np.asarray(beta, dtype=float), len(neighbours))[taxels]
    return leak(pressure, column_of, taxels, neighbours, shares, len(reached)), reached
