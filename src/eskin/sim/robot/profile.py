"""Moves from rest to rest at trapezoidal speed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Profile:
    """How far a move has come through time."""

    length: float
    """Of the whole way [rad]."""
    speed: float
    """Where it is fastest [rad/s]."""
    acceleration: float
    """[rad/s2]"""

    @property
    def ramp(self) -> float:
        """Time to reach full speed [s]."""
        return self.speed / self.acceleration

    @property
    def duration(self) -> float:
        """From rest to rest [s]."""
        return self.length / self.speed + self.ramp

    def at(self, time: Float[np.ndarray, "time"]) -> Float[np.ndarray, "time"]:
        """Way travelled since the start; at rest before and after [rad]."""
        t = np.clip(time, 0.0, self.duration)
        left = self.duration - t
        rising = self.acceleration * t**2 / 2
        falling = self.length - self.acceleration * left**2 / 2
        cruising = self.speed * (t - self.ramp / 2)
        slow = np.where(t < self.duration / 2, rising, falling)
        return np.where(np.minimum(t, left) < self.ramp, slow, cruising)


def profile_of(length: float, speed: float, acceleration: float) -> Profile:
    """The fastest move over a length [rad] within a speed and an acceleration."""
    reached = min(speed, float(np.sqrt(length * acceleration)))
    return Profile(length, reached, acceleration)
