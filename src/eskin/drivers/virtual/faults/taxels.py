"""Taxels, rows, columns and patches that measure wrong."""

from typing import final

import numpy as np
from jaxtyping import Int

from eskin.drivers.virtual.faults.fault import TaxelFault

LARGEST = 2**16 - 1
"""That fits a count."""


@final
class Noisy(TaxelFault):
    """Counts with normal noise, whose deviation is the amount [counts]."""

    default, most = 200.0, float(LARGEST)

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Counts with noise."""
        noise = np.rint(self.rng.normal(0.0, self.order.amount, len(counts)))
        return np.clip(counts + noise.astype(counts.dtype), 0, LARGEST)


@final
class Stuck(TaxelFault):
    """The amount, whatever is felt [counts]."""

    default, most = 2000.0, float(LARGEST)

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """The same for all."""
        return np.full_like(counts, round(self.order.amount))


@final
class Dead(TaxelFault):
    """Nothing, whatever is felt."""

    def disturb(self, counts: Int[np.ndarray, "part"]) -> Int[np.ndarray, "part"]:
        """Zeros."""
        return np.zeros_like(counts)
