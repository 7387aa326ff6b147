"""This module finds the scans of a patch that no touch can cause."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.touch.faults import FaultDetector
from eskin.touch.outage_kernels import (
    REFUSED,
    RESTARTED,
    MovedScan,
    OutageContext,
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

    def __init__(self, faults: FaultDetector, tare_samples: int) -> None:
        """Start before the first scan of the skin that a fault detector is for.

        Rest is known after a tare of so many samples.
        """
        patches = faults.grouper.patches
        self.patch_index = patches.group_index
        self.context = OutageContext(
            *(faults.contact, faults.full_scale, tare_samples),
            *(patches.order, patches.starts, np.zeros(len(faults.contact))),
            build_patch_state(len(patches.sizes)),
        )
        self.first: int | None = None

    def push(
        self, scan: Scan, baselines: np.ndarray, noise: Values
    ) -> tuple[Flags | None, Int[np.ndarray, "some"]]:
        """Check the next scan.

        Args:
            scan: next scan.
            baselines: (taxel) `BASELINE`.
            noise: counts above rest up to which they may be noise.

        Returns:
            Which taxels count as not received, None where there are none; and those
            that restart.
        """
        self.first = scan.stamp if self.first is None else self.first
        rest, sample_count = baselines["baseline"], baselines["sample_count"]
        now = (scan.stamp - self.first) / NS_PER_S
        moved = MovedScan(scan.counts, scan.received, rest, sample_count, noise, now)
        if check_patches(moved, self.context):
            return None, NO_TAXELS
        outcome = self.context.state["outcome"][self.patch_index]
        refused = outcome == REFUSED
        return refused if refused.any() else None, np.flatnonzero(outcome == RESTARTED)
