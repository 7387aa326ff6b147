"""This module finds which taxels are neighbours, and groups them by row, column and patch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from eskin.skin.skin import Skin

MICROMETRE = 1e-6
NEAREST = 3


@dataclass(frozen=True, eq=False)
class Adjacency:
    """Neighbours on the same link, which stay neighbours however the robot moves.

    The neighbours of taxel i are `neighbours[starts[i] : starts[i + 1]]`, ascending.
    """

    starts: Int[np.ndarray, "taxel_and_one"]
    """Where the neighbours of each taxel start; the last entry ends the last."""

    neighbours: Int[np.ndarray, "pair"]
    """Indices of neighbouring taxels."""

    reach: Float[np.ndarray, "taxel"]
    """How far each taxel reaches [m]; two are neighbours within the larger reach."""

    link_index: Int[np.ndarray, "taxel"]
    """Which link each taxel is on, numbered in order of appearance."""

    @classmethod
    def of(cls, skin: Skin, factor: float = 1.6, least: float = 0.0) -> "Adjacency":
        """Neighbours within `factor` times the local spacing, and `least` [m] anyway.

        Coordinates are rounded to 1 um, so that equal distances are equal.
        """
        points = np.round(skin.positions, 6)
        links = link_index(skin)
        reach = np.maximum(factor * spacing(skin), least) + MICROMETRE
        pairs = [pairs_within(points, reach, links == n) for n in np.unique(links)]
        source, target = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
        order = np.lexsort((target, source))
        starts = np.searchsorted(source[order], np.arange(skin.count + 1))
        return cls(
            starts.astype(np.int32), target[order].astype(np.int32), reach, links
        )


def link_index(skin: Skin) -> Int[np.ndarray, "taxel"]:
    """Number the links of the skin's taxels in order of appearance in the patches."""
    names = list(dict.fromkeys(skin.link_names))
    numbers = np.array([names.index(name) for name in skin.link_names], np.int32)
    return numbers[np.asarray(skin.patch_index)]


def spacing(skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Distance from each taxel to its third nearest in the same patch [m].

    On a rectangular grid that is the longer of the two pitches. A patch of fewer taxels
    takes the farthest, and a lone taxel the side of the square of its area.
    """
    points = np.round(skin.positions, 6)
    result = np.sqrt(np.asarray(skin.areas, np.float64))
    for patch in range(len(skin.patches)):
        members = np.flatnonzero(np.asarray(skin.patch_index) == patch)
        count = min(NEAREST, len(members) - 1)
        if count > 0:
            distances, _ = KDTree(points[members]).query(points[members], count + 1)
            result[members] = distances[:, count]
    return result


def pairs_within(
    points: Float[np.ndarray, "taxel 3"],
    reach: Float[np.ndarray, "taxel"],
    members: np.ndarray,
) -> Int[np.ndarray, "2 pair"]:
    """Ordered pairs of members within the larger reach of the two."""
    chosen = np.flatnonzero(members)
    tree = KDTree(points[chosen])
    pairs = tree.query_pairs(reach[chosen].max(), output_type="ndarray")
    a, b = chosen[pairs[:, 0]], chosen[pairs[:, 1]]
    near = np.linalg.norm(points[a] - points[b], axis=1) <= np.maximum(
        reach[a], reach[b]
    )
    a, b = a[near], b[near]
    return np.stack([np.concatenate([a, b]), np.concatenate([b, a])])


@dataclass(frozen=True, eq=False)
class Lines:
    """Each taxel belongs to one line; a line is a row, a column or a whole patch."""

    line_index: Int[np.ndarray, "taxel"]
    """The line of each taxel."""

    sizes: Int[np.ndarray, "line"]
    """Taxels of each line."""

    patches: Int[np.ndarray, "line"]
    """The patch of each line."""

    numbers: Int[np.ndarray, "line"]
    """Its row or column number; for a patch that of the patch."""

    @classmethod
    def of(cls, skin: Skin, numbers: Int[np.ndarray, "taxel"]) -> "Lines":
        """Group the taxels of each patch by a number: rows, columns or patch."""
        keys = np.stack([np.asarray(skin.patch_index), np.asarray(numbers)])
        kinds, index, sizes = np.unique(
            keys, axis=1, return_inverse=True, return_counts=True
        )
        return cls(index.reshape(-1), sizes, kinds[0], kinds[1])

    def all_of(self, flags: Bool[np.ndarray, "taxel"]) -> Bool[np.ndarray, "line"]:
        """Lines all of whose taxels are flagged."""
        return self.share_of(flags) == 1.0

    def share_of(self, flags: Bool[np.ndarray, "taxel"]) -> Float[np.ndarray, "line"]:
        """Share of each line's taxels that are flagged."""
        marked = np.bincount(self.line_index, flags, minlength=len(self.sizes))
        return marked / self.sizes
