"""The last two seconds of one sequence, as its logits need them."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.live.head import HeadWeights, head_memory
from eskin.live.head_kernels import classify
from eskin.live.pool import LONG_AGO
from eskin.model import SLOT_NS


@final
class Window:
    """Rings of slots of 20 ms, in which each reading changes what hangs on it.

    Readings that share a slot give their maximum; slots that are passed over hold
    none. What comes out is what the heads give for the whole window.
    """

    def __init__(self, weights: HeadWeights, slots: int) -> None:
        """Start empty."""
        self.weights = weights
        self.memory = head_memory(weights, slots)
        self.now = LONG_AGO

    def push(
        self, stamp: int, features: Float[np.ndarray, "channel"]
    ) -> Float[np.ndarray, "class"]:
        """Logits of the window that ends with a reading.

        Args:
            stamp: of the reading, later than the one before [ns since the epoch].
            features: of the reading.
        """
        before, self.now = self.now, stamp // SLOT_NS
        logits = np.empty_like(self.weights.classify_bias)
        classify(features, before, self.now, self.weights, self.memory, logits)
        return logits
