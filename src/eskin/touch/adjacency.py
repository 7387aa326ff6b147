"""This module finds neighbouring taxels, and groups taxels by row, column and patch."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import SkinError
from eskin.near import iterate_near_pairs, measure_nearest
from eskin.skin import Skin

MICROMETRE = 1e-6
SPACING_RANK = 3
"""Rank of the neighbour whose distance is the local spacing."""
MAX_PAIRS = 8_000_000
"""Largest number of pairs within the largest reach of a link, in both orders; the
preset skins have 20 to 30 a taxel."""


class Adjacency(NamedTuple):
    """An adjacency holds the neighbours of each taxel on its own link, in any pose.

    The neighbours of taxel i are `neighbours[starts[i] : starts[i + 1]]`, ascending.
    """

    starts: Int[np.ndarray, "taxel_and_one"]
    """Index of each taxel's first neighbour; the last entry ends the last taxel."""
    neighbours: Int[np.ndarray, "pair"]
    """Indices of neighbouring taxels."""
    reach: Float[np.ndarray, "taxel"]
    """Reach of each taxel [m]; two are neighbours within the larger of their two."""

    @classmethod
    @lru_cache(maxsize=4)
    def build(
        cls, skin: Skin, factor: float = 1.6, min_reach: float = 0.0
    ) -> "Adjacency":
        """Connect taxels within `factor` times the local spacing or `min_reach` [m].

        Coordinates are rounded to 1 um, so that equal distances are equal. All that use
        one skin share the result; none of them changes it.
        """
        points = np.round(skin.positions, 6)
        names = list(dict.fromkeys(skin.link_names))
        numbers = np.array([names.index(name) for name in skin.link_names], np.int32)
        links = numbers[np.asarray(skin.patch_index)]
        reach = np.maximum(factor * compute_spacing(skin), min_reach) + MICROMETRE
        pairs = [find_pairs(points, reach, links == n) for n in np.unique(links)]
        source, target = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
        order = np.lexsort((target, source))
        starts = np.searchsorted(source[order], np.arange(skin.count + 1))
        return cls(starts.astype(np.int32), target[order].astype(np.int32), reach)


def compute_spacing(skin: Skin) -> Float[np.ndarray, "taxel"]:
    """Return the distance from each taxel to the third nearest of its patch [m].

    On a rectangular grid that is the larger of the two pitches. In a smaller patch it
    is the farthest taxel; for a single taxel the square root of its area.
    """
    points = np.round(skin.positions, 6)
    result = np.sqrt(np.asarray(skin.areas, np.float64))
    for patch in range(len(skin.patches)):
        members = np.flatnonzero(np.asarray(skin.patch_index) == patch)
        if len(members) > 1:
            result[members] = measure_nearest(points[members], SPACING_RANK)
    return result


def find_pairs(
    points: Float[np.ndarray, "taxel 3"],
    reach: Float[np.ndarray, "taxel"],
    is_member: np.ndarray,
) -> Int[np.ndarray, "2 pair"]:
    """Find the pairs of members within the larger reach of the two, in both orders."""
    members = np.flatnonzero(is_member)
    largest = reach[members].max()
    found = []
    count = 0
    for one, other, squared in iterate_near_pairs(points[members], largest):
        count += len(one)
        if count > MAX_PAIRS:
            raise SkinError(
                f"{len(members)} taxels of one link have over {MAX_PAIRS:,} neighbours "
                f"within {1e3 * largest:.3g} mm; allowed are {MAX_PAIRS:,}; use a "
                "coarser skin"
            )
        a = members[one]
        b = members[other]
        kept = np.sqrt(squared) <= np.maximum(reach[a], reach[b])
        found.append(np.stack([a[kept], b[kept]]))
    return np.concatenate(found, axis=1)


class TaxelGroups(NamedTuple):
    """A grouping assigns each taxel to one row, one column or one whole patch.

    The taxels of group n are `order[starts[n] : starts[n + 1]]`, ascending.
    """

    group_index: Int[np.ndarray, "taxel"]
    """Group of each taxel."""
    sizes: Int[np.ndarray, "group"]
    patches: Int[np.ndarray, "group"]
    numbers: Int[np.ndarray, "group"]
    """Row or column number of each group; for a patch its index."""
    order: Int[np.ndarray, "taxel"]
    starts: Int[np.ndarray, "group_and_one"]

    @classmethod
    def build(cls, skin: Skin, numbers: Int[np.ndarray, "taxel"]) -> "TaxelGroups":
        """Group the taxels of each patch by a number, such as their row."""
        keys = np.stack([np.asarray(skin.patch_index), np.asarray(numbers)])
        kinds, index, sizes = np.unique(
            keys, axis=1, return_inverse=True, return_counts=True
        )
        index = index.reshape(-1)
        order = np.argsort(index, kind="stable")
        starts = np.append(0, np.cumsum(sizes))
        return cls(index, sizes, kinds[0].copy(), kinds[1].copy(), order, starts)

    def members(self, group: int) -> Int[np.ndarray, "some"]:
        """Return the taxels of a group, ascending."""
        return self.order[self.starts[group] : self.starts[group + 1]]

    def flagged_share(
        self, flags: Bool[np.ndarray, "taxel"]
    ) -> Float[np.ndarray, "group"]:
        """Return the share of each group's taxels that are flagged."""
        return self.flagged_count(flags) / self.sizes

    def flagged_count(
        self, flags: Bool[np.ndarray, "taxel"]
    ) -> Int[np.ndarray, "group"]:
        """Return the number of each group's taxels that are flagged."""
        return np.bincount(self.group_index[flags], minlength=len(self.sizes))
