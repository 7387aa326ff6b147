"""Where each taxel goes in an image of the skin."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from eskin.skin import Skin

PITCH = 0.008
"""Height of a pixel of the unrolled arm [m]: about the distance of taxels."""

ROUND = 48
"""Pixels round a link."""


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
    """The links one above the other, each unrolled about its longest axis.

    A column is an angle, a row a height. Where several taxels meet in a pixel, it
    shows the last of them.
    """
    rows, columns = np.zeros((2, skin.count), np.int64)
    height = 0
    links = np.array(skin.link_names)[skin.patch_index]
    for link in dict.fromkeys(skin.link_names):
        here = np.flatnonzero(links == link)
        points = skin.positions[here] - skin.positions[here].mean(axis=0)
        # Axes by spread, the widest first; flat links have none across.
        axes = np.linalg.svd(points, full_matrices=True)[2]
        along, x, y = (points @ axes.T).T
        angle = np.arctan2(y, x) / (2 * np.pi) + 0.5
        columns[here] = np.minimum((angle * ROUND).astype(np.int64), ROUND - 1)
        level = ((along - along.min()) / PITCH).astype(np.int64)
        rows[here] = height + level
        height += int(level.max()) + 1
    return Image((height, ROUND, 1), rows * ROUND + columns)
