"""Where each taxel goes in an image of the skin."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.skin import Skin

PITCH = 0.008
"""Height of a pixel of the unrolled arm [m]: about the distance of taxels."""

ROUND = 48
"""Pixels round a link; the first and the last are neighbours."""

AS_GOOD = 0.01
"""Directions are as good as an axis where their mean squared cosines with the normals
differ by less."""


@dataclass(frozen=True, eq=False)
class Image:
    """A place in an image for each taxel."""

    shape: tuple[int, int, int]
    """Rows, columns and channels."""

    place: Int[np.ndarray, "taxel"]
    """The pixel of each taxel, counted through the channels, columns and rows."""


def patch_image(skin: Skin) -> Image:
    """Each patch in a channel of its own, by row and column, padded to the largest."""
    rows = max(patch.rows for patch in skin.patches)
    columns = max(patch.columns for patch in skin.patches)
    channels = len(skin.patches)
    place = (skin.rows * columns + skin.columns) * channels + skin.patch_index
    return Image((rows, columns, channels), place.astype(np.int64))


def unrolled_image(skin: Skin) -> Image:
    """The links one above the other, each unrolled about its axis.

    A column is an angle, a row a height. Several taxels may meet in a pixel.
    """
    rows, columns = np.zeros((2, skin.count), np.int64)
    height = 0
    links = np.array(skin.link_names)[skin.patch_index]
    for link in dict.fromkeys(skin.link_names):
        here = np.flatnonzero(links == link)
        along, angle = round_axis(skin.positions[here], skin.normals[here])
        columns[here] = (angle / (2 * np.pi) * ROUND).astype(np.int64) % ROUND
        level = ((along - along.min()) / PITCH).astype(np.int64)
        rows[here] = height + level
        height += int(level.max()) + 1
    return Image((height, ROUND, 1), rows * ROUND + columns)


def round_axis(
    positions: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> tuple[Float[np.ndarray, "part"], Float[np.ndarray, "part"]]:
    """Height [m] along the axis of a link's skin, and angle round it from 0 to 2 pi.

    The axis lies as far behind the skin as is right for a round one of this width whose
    normals spread as these do, or at most twice its width (root mean square), since
    that of a flat one would lie infinitely far away.
    """
    points = positions - positions.mean(axis=0)
    along, *across = np.linalg.svd(axis_of(points, normals)[None])[2]
    xy, n = points @ np.transpose(across), normals @ np.transpose(across)
    spread = max(n.var(axis=0).sum(), 0.25)
    x, y = (xy + n.mean(axis=0) * np.sqrt(xy.var(axis=0).sum() / spread)).T
    return points @ along, np.arctan2(y, x) % (2 * np.pi)


def axis_of(
    points: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> Float[np.ndarray, "3"]:
    """The direction to which the normals are most perpendicular.

    Where several are as good, as on a flat skin, the one along which the points, whose
    mean is zero, lie farthest apart.
    """
    cosines, directions = np.linalg.eigh(normals.T @ normals / len(normals))
    free = directions[:, cosines < cosines[0] + AS_GOOD]
    return free @ np.linalg.eigh(free.T @ points.T @ points @ free)[1][:, -1]
