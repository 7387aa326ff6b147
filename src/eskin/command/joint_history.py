"""Where joints were in the last seconds."""

from bisect import bisect_right
from collections import deque
from typing import final

import numpy as np
from jaxtyping import Float


@final
class JointHistory:
    """Keeps the latest joint positions; between two, a line."""

    def __init__(
        self, stamp: int, q: Float[np.ndarray, "joint"], size: int = 250
    ) -> None:
        """Begin with positions [rad] at a time; keep `size` of them."""
        self.stamps = deque([stamp], size)
        self.positions = deque([np.array(q, np.float64)], size)

    def add(self, stamp: int, q: Float[np.ndarray, "joint"]) -> None:
        """Positions at a time later than the last [ns since the epoch]."""
        if stamp > self.stamps[-1]:
            self.stamps.append(stamp)
            self.positions.append(np.array(q, np.float64))

    def at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Positions at a time [rad]; outside of what is kept, the nearest."""
        if stamp >= self.stamps[-1]:
            return self.positions[-1]
        place = bisect_right(self.stamps, stamp)
        if place == 0:
            return self.positions[0]
        before, after = self.stamps[place - 1], self.stamps[place]
        q, q_after = self.positions[place - 1], self.positions[place]
        return q + (q_after - q) * ((stamp - before) / (after - before))
