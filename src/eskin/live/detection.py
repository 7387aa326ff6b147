"""What the recogniser says of a touch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.recording import DetectionRecord


@dataclass(frozen=True, eq=False)
class Detection:
    """What was said of one touch: said once, and never withdrawn."""

    stamp: int
    """When it was said: the stamp of the latest reading [ns since the epoch]."""

    touch: int
    """Id of the touch."""

    gesture: str
    """One of the model's vocabulary, or `unknown`."""

    confidence: float
    """Calibrated probability of the gesture; of the likeliest where it is unknown."""

    onset: int
    """First contact [ns since the epoch]."""

    end: int
    """Latest contact by `stamp` [ns since the epoch]."""

    link: str
    """Link of the most loaded taxel at `end`."""

    patch: str
    """Patch of that taxel."""

    p_world: Float[np.ndarray, "3"]
    """Force-weighted centre of the strongest contact at `end` [m]."""

    n_world: Float[np.ndarray, "3"]
    """Mean outward normal of that contact."""

    direction_world: Float[np.ndarray, "3"]
    """Unit vector of travel at `end`, with the robot's own motion taken out; zero where
    the touch stayed in its place."""

    peak_force: float
    """Greatest force until `stamp` [N]."""

    likeliest: str = ""
    """Likeliest gesture of a touch that is unknown, perhaps `none`; empty where it is
    known."""

    def record(self) -> DetectionRecord:
        """As a recording keeps it."""
        return DetectionRecord(
            stamp=self.stamp,
            gesture=self.gesture,
            confidence=self.confidence,
            onset=self.onset,
            end=self.end,
            link=self.link,
            patch=self.patch,
            p_world=vector(self.p_world),
            n_world=vector(self.n_world),
            direction_world=vector(self.direction_world),
            peak_force=self.peak_force,
        )


def vector(array: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """As plain numbers."""
    x, y, z = array.tolist()
    return x, y, z
