"""This module finds points that are near each other, by a grid of cells.

`scipy.spatial` does so too, but takes 0.2 s and 26 MB to import, a fifth of what a
command takes to start.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from jaxtyping import Float, Int

BLOCK = 1 << 14
"""Number of pairs that are compared at once."""
SAMPLE = 64
"""Number of points by whose neighbours the first size of cells is chosen."""
ROWS = np.array([(x, y, 0) for x, y in product((-1, 0, 1), repeat=2)])
"""Steps from a cell to the middle cells of the nine rows of three around it."""

Pairs = tuple[
    Int[np.ndarray, "pair"], Int[np.ndarray, "pair"], Float[np.ndarray, "pair"]
]
"""Indices of two points each, and the squares of their distances."""


def iterate_near_pairs(
    points: Float[np.ndarray, "point 3"],
    reach: float,
    chosen: Int[np.ndarray, "chosen"] | None = None,
) -> Iterator[Pairs]:
    """Yield the pairs of each chosen point with all others within a reach.

    All pairs of one chosen point come at once, so two chosen points are paired twice.

    Args:
        points: finite points, whose squared distances are finite too.
        reach: largest distance of a pair.
        chosen: indices of the chosen points; all unless given.
    """
    if not len(points):
        return
    chosen = np.arange(len(points)) if chosen is None else chosen
    cells = number_cells(points, reach)
    shape = cells.max(axis=0) + 2
    numbers = np.asarray(np.ravel_multi_index(tuple(cells.T), tuple(shape)))
    order = np.argsort(numbers, kind="stable")
    steps = ROWS @ (shape[1] * shape[2], shape[2], 1)
    middles = numbers[chosen, None] + steps
    first = np.searchsorted(numbers[order], middles - 1, "left")
    counts = np.searchsorted(numbers[order], middles + 1, "right") - first
    totals = counts.sum(axis=1)
    block = np.cumsum(totals) // BLOCK
    for part in np.split(np.arange(len(chosen)), np.flatnonzero(np.diff(block)) + 1):
        one = np.repeat(chosen[part], totals[part])
        other = order[list_ranges(first[part].ravel(), counts[part].ravel())]
        squared = ((points[one] - points[other]) ** 2).sum(axis=1)
        kept = (squared <= reach**2) & (one != other)
        yield one[kept], other[kept], squared[kept]


def number_cells(
    points: Float[np.ndarray, "point 3"], reach: float
) -> Int[np.ndarray, "point 3"]:
    """Return the column, row and layer of each point's cell, from 1.

    Points within reach are in the same cell or in adjacent ones. Empty layers are
    counted once, so that far points need no large numbers.
    """
    # A little larger than the reach, against rounding errors.
    layers = np.floor(points / (reach * (1 + 1e-9)))
    cells = np.empty(points.shape, np.int64)
    for axis in range(3):
        values, place = np.unique(layers[:, axis], return_inverse=True)
        gaps = np.minimum(np.diff(values), 2).astype(np.int64)
        cells[:, axis] = np.concatenate([[1], 1 + np.cumsum(gaps)])[place]
    return cells


def list_ranges(
    first: Int[np.ndarray, "range"], counts: Int[np.ndarray, "range"]
) -> Int[np.ndarray, "number"]:
    """Return the whole numbers of some ranges, one range after the other."""
    ends = np.cumsum(counts)
    return np.arange(counts.sum()) + np.repeat(first - ends + counts, counts)


def find_nearest(points: Float[np.ndarray, "point 3"], count: int) -> Pairs:
    """Return the pairs of each point with the others no farther than its nearest ones.

    All that tie with the last of them are included. Where there are fewer other points,
    all are.

    Args:
        points: finite points.
        count: number of nearest points, which decides how far a point's pairs reach.
    """
    count = min(count, len(points) - 1)
    if count < 1:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    left = np.arange(len(points))
    reach = choose_reach(points, count)
    found = []
    while len(left):
        done = []
        for pairs in iterate_near_pairs(points, reach, left):
            one, other, squared = (each[np.lexsort(pairs[::-2])] for each in pairs)
            begins = np.flatnonzero(np.diff(one, prepend=-1))
            enough = np.diff(begins, append=len(one)) >= count
            last = np.zeros(len(points)) - 1
            last[one[begins[enough]]] = squared[begins[enough] + count - 1]
            kept = squared <= last[one]
            found.append((one[kept], other[kept], squared[kept]))
            done.append(one[begins[enough]])
        left = np.setdiff1d(left, np.concatenate(done), assume_unique=True)
        reach *= 2
    one, other, squared = (np.concatenate(each) for each in zip(*found, strict=True))
    return one, other, squared


def measure_nearest(
    points: Float[np.ndarray, "point 3"], count: int
) -> Float[np.ndarray, "point"]:
    """Return the distance from each point to the last of its nearest others.

    Args:
        points: two finite points or more.
        count: number of nearest others; where there are fewer, all count.
    """
    places, place, copies = np.unique(
        points, axis=0, return_inverse=True, return_counts=True
    )
    # More copies of a place than count would change nothing, and be paired in vain.
    copies = np.minimum(copies, count + 1)
    one, _, squared = find_nearest(np.repeat(places, copies, axis=0), count)
    farthest = np.zeros(copies.sum())
    np.maximum.at(farthest, one, squared)
    return np.sqrt(farthest)[(np.cumsum(copies) - 1)[place.ravel()]]


def choose_reach(points: Float[np.ndarray, "point 3"], count: int) -> float:
    """Return a reach within which the densest points have a number of others."""
    some = points[:: -(-len(points) // SAMPLE)]
    squared = ((some[:, None] - points) ** 2).sum(axis=2)
    least = float(np.partition(squared, count, axis=1)[:, count].min())
    extent = float(np.ptp(points, axis=0).max())
    return max(1.5 * least**0.5, 1e-9 * extent, 1e-150)
