"""This module tells which taxels are at rest when they have their first data."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.touch.taxels import TaxelPlaces

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
Counts = Int[np.ndarray, "taxel"]

LOW_RANK = 0.1
"""Quantile of the counts above rest at which the lowest taxels of a patch lie: dead
ones may lie below."""
EVEN = 0.5
"""Ratio of this quantile to the median from which all taxels have drifted alike: under
a hand they differ more."""
AT_REST_SIGMAS = 4.0
"""Largest distance from rest of an untouched taxel, in units of its noise."""


def find_known_rest(
    counts: Counts,
    use: Flags,
    taxels: np.ndarray,
    constants: np.ndarray,
    places: TaxelPlaces,
) -> tuple[Values, Flags]:
    """Return the rest of each taxel after drift, and where it is plausible.

    A hand may lie on a skin that is switched on. Its taxels lie above their rest, the
    others at it. The rest of a whole patch also drifts, by about the same for all
    taxels, and is another one where a patch was replaced.

    Rest is plausible where the counts lie at it, or above it by the margin from which a
    taxel may be touched, together with those of a neighbour. A taxel that is neither
    has an offset of its own.

    Args:
        counts: counts of the taxels.
        use: which of them were received and are not faulty.
        taxels: (taxel) `TAXEL`, whose `known_rest` is what is known, NaN for nothing.
        constants: (taxel) `TAXEL_CONSTANTS`.
        places: places of the taxels.
    """
    rest = taxels["known_rest"].copy()
    margin = taxels["margin"]
    adjacency = places.adjacency
    known = np.zeros(len(rest), bool)
    use = use & np.isfinite(rest)
    for patch in range(len(places.patches.sizes)):
        members = places.patches.members(patch)
        seen = members[use[members]]
        if len(seen):
            drift = find_drift(counts[seen] - rest[seen], margin[seen])
            rest[seen] += drift or 0.0
            known[seen] = drift is not None
    above = counts - rest
    pressed = known & (above > margin)
    for i in np.flatnonzero(pressed):
        near = adjacency.neighbours[adjacency.starts[i] : adjacency.starts[i + 1]]
        known[i] = pressed[near].any()
    return rest, known & (pressed | (np.abs(above) <= constants["near_rest"]))


def find_drift(
    above: Float[np.ndarray, "some"], margin: Float[np.ndarray, "some"]
) -> float | None:
    """Return the common drift of a patch [counts]; None for another rest.

    `above` are counts above the calibrated rest, `margin` those from which a taxel may
    be touched.
    """
    low, middle = np.quantile(above, (LOW_RANK, 0.5))
    limit = float(np.median(margin))
    if low < -limit:
        return None
    if low > limit:
        return None if low >= EVEN * middle else 0.0
    return float(np.median(above[above <= low + limit]))
