"""What differs between two sessions with the same build."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.sensor.build import Build


@dataclass(frozen=True, eq=False)
class Session:
    """One sitting: what has drifted since the build was calibrated."""

    gain: Float[np.ndarray, "taxel"]
    """Factor on the conductance of each taxel."""
    warmer: float
    """Temperature above that of calibration [K]."""


def draw_session(build: Build, rng: np.random.Generator) -> Session:
    """Draw a session of a build."""
    velostat = build.velostat
    mean, deviation = velostat.session_gain
    drift = mean + deviation * rng.standard_normal(len(velostat.gain))
    return Session(np.exp(drift), velostat.temperature * float(rng.standard_normal()))
