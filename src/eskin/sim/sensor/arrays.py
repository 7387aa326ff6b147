"""Where live taxels lie in the row-column arrays that read them."""

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.sensor.sensor_kernels import Arrays
from eskin.skin import Skin


def arrays_of(
    live: Int[np.ndarray, "live"], ages: Float[np.ndarray, "taxel"], skin: Skin
) -> Arrays:
    """Lay live taxels out in the arrays of their patches.

    Args:
        live: taxels of the skin that conduct at any time, sorted by patch.
        ages: when each taxel is scanned before its reading is put together [s].
        skin: all taxels.
    """
    patches, starts = np.unique(skin.patch_index[live], return_index=True)
    rows = max(patch.rows for patch in skin.patches)
    columns = max(patch.columns for patch in skin.patches)
    taxel = np.full((len(patches), rows, columns), -1, dtype=np.int64)
    for index, patch in enumerate(patches):
        inside = np.flatnonzero(skin.patch_index == patch)
        taxel[index, skin.rows[inside], skin.columns[inside]] = inside
    return Arrays(
        starts=np.append(starts, len(live)),
        patch=patches,
        row=skin.rows[live],
        column=skin.columns[live],
        age=ages[live],
        taxel=taxel,
        rows=np.array([skin.patches[patch].rows for patch in patches], dtype=np.int64),
        columns=np.array(
            [skin.patches[patch].columns for patch in patches], dtype=np.int64
        ),
    )


def scan_ages(
    phase: Float[np.ndarray, "patch"], scan: float, skin: Skin
) -> Float[np.ndarray, "taxel"]:
    """When each taxel is scanned before a reading is put together [s]."""
    rows = np.array([patch.rows for patch in skin.patches])[skin.patch_index]
    return phase[skin.patch_index] + scan * (1.0 - skin.rows / rows)
