"""This module finds the scans of a patch that no touch can cause."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.faults import FaultDetector
from eskin.touch.outage_kernels import (
    REFUSED,
    RESTARTED,
    MovedScan,
    MoveLimits,
    build_patch_state,
    check_patches,
)
from eskin.touch.reading import Scan
from eskin.units import NS_PER_S

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]

NO_TAXELS = np.empty(0, np.int64)


@final
class OutageDetector:
    """A detector finds the scans of a patch that no touch can cause; stateful.

    After a reset of its board, with a loose plug or in a corrupt packet, nearly all
    taxels of a patch move within one scan: to zero or elsewhere below rest, to full
    scale, or anywhere. Such a scan counts as not received, and so do the next ones
    until the counts are near those of the last scan that was used. If nearly all
    taxels move up, a hand may press them: the second such scan is used.

    A patch restarts at such a move before its rest is known, and when it leaves zeros
    that it has sent from the start, soon after it.
    """

    def __init__(self, skin: Skin, faults: FaultDetector) -> None:
        """Start before the first scan; `faults` is the fault detector of the skin."""
        self.patch_index = np.asarray(skin.patch_index)
        self.sizes = np.bincount(self.patch_index, minlength=len(skin.patches))
        self.limits = MoveLimits(faults.contact, faults.full_scale)
        self.state = build_patch_state(skin.count, len(self.sizes))
        self.outcome = np.zeros(len(self.sizes), np.int64)
        self.first: int | None = None

    def push(
        self, scan: Scan, rest: Values, noise: Values, tared: Flags
    ) -> tuple[Flags | None, Int[np.ndarray, "some"]]:
        """Check the next scan.

        Args:
            scan: next scan.
            rest: counts at rest.
            noise: counts above rest up to which they may be noise.
            tared: taxels whose rest is known.

        Returns:
            Which taxels count as not received, None where there are none; and those
            that restart.
        """
        self.first = scan.stamp if self.first is None else self.first
        moved = MovedScan(
            scan.counts,
            scan.received,
            rest,
            noise,
            tared,
            (scan.stamp - self.first) / NS_PER_S,
        )
        if check_patches(
            moved, self.limits, self.sizes, self.patch_index, self.state, self.outcome
        ):
            return None, NO_TAXELS
        outcome = self.outcome[self.patch_index]
        refused = outcome == REFUSED
        return refused if refused.any() else None, np.flatnonzero(outcome == RESTARTED)
