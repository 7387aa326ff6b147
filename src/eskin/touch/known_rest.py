"""This module tells which taxels are at rest when they have their first data."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration import Calibration

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


@final
class KnownRest:
    """The counts of a skin at rest, as a calibration or earlier scans tell them.

    A hand may lie on a skin that is switched on. Its taxels lie above their rest, the
    others at it. The rest of a whole patch also drifts, by about the same for all
    taxels, and is another one where a patch was replaced.
    """

    def __init__(self, skin: Skin, calibration: Calibration) -> None:
        """Store rest and noise; a noise that is not known is taken as one count."""
        unknown = np.full(skin.count, np.nan)
        self.rest = unknown if calibration.rest is None else calibration.rest
        noise = np.ones(skin.count) if calibration.noise is None else calibration.noise
        self.near = AT_REST_SIGMAS * noise
        index = np.asarray(skin.patch_index)
        self.members = [np.flatnonzero(index == n) for n in range(len(skin.patches))]

    def compare(
        self, counts: Counts, use: Flags, margin: Values, adjacency: Adjacency
    ) -> tuple[Values, Flags]:
        """Return the rest of each taxel after drift, and where it is plausible.

        It is plausible where the counts lie at it, or above it by `margin`, from which
        a taxel may be touched, together with those of a neighbour. A taxel that is
        neither has an offset of its own. Taxels without `use` were not received or are
        faulty; NaN is no known rest.
        """
        rest = self.rest.copy()
        known = np.zeros(len(rest), bool)
        use = use & np.isfinite(rest)
        for members in self.members:
            seen = members[use[members]]
            if len(seen):
                drift = find_drift(counts[seen] - rest[seen], margin[seen])
                rest[seen] += drift or 0.0
                known[seen] = drift is not None
        above = counts - rest
        pressed = known & (above > margin)
        for i in np.flatnonzero(pressed):
            near = adjacency.neighbours[slice(*adjacency.starts[i : i + 2])]
            known[i] = pressed[near].any()
        return rest, known & (pressed | (np.abs(above) <= self.near))


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
