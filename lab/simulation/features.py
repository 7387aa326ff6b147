"""Compute fifteen plain features of a clip, as a simple recogniser would."""

import numpy as np
from jaxtyping import Float
from scipy.signal import find_peaks

NAMES = (
    "seconds",
    "peak force",
    "mean force",
    "impulse",
    "peak pressure",
    "most taxels",
    "union of taxels",
    "most over union",
    "peaks",
    "gaps",
    "rise",
    "fall",
    "path",
    "displacement",
    "seconds a taxel",
)
ON = 1.0  # [kPa]
PERIOD = 0.02  # [s]


def clip_features(
    pressure: Float[np.ndarray, "reading taxel"],
    positions: Float[np.ndarray, "taxel 3"],
    areas: Float[np.ndarray, "taxel"],
) -> Float[np.ndarray, "feature"]:
    """Return the features named in `NAMES`.

    Args:
        pressure: pressure of every reading of the clip [kPa].
        positions: positions of the taxels in their links' frames [m].
        areas: areas of the taxels [m2].
    """
    felt = np.flatnonzero((pressure >= ON).any(axis=0))
    pressure, positions, areas = pressure[:, felt], positions[felt], areas[felt]
    active = pressure >= ON
    loaded = np.where(active, pressure, 0.0)
    force = loaded @ (areas * 1e3)
    touched = np.flatnonzero(force > 0)
    if not len(touched):
        return np.zeros(len(NAMES))
    first, last = touched[0], touched[-1] + 1
    span = force[first:last]
    top = int(force.argmax())
    taxels = active.sum(axis=1)
    union = len(felt)
    centres = (loaded[touched] * areas * 1e3) @ positions / force[touched][:, None]
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    return np.array(
        [
            (last - first) * PERIOD,
            force.max(),
            span.mean(),
            force.sum() * PERIOD,
            pressure.max(),
            taxels.max(),
            union,
            taxels.max() / union,
            count_peaks(force),
            np.count_nonzero(np.diff((span > 0).astype(int)) == -1),
            (top - first) * PERIOD,
            (last - top) * PERIOD,
            steps.sum(),
            np.linalg.norm(centres[-1] - centres[0]),
            active.sum(axis=0).mean() * PERIOD,
        ]
    )


def count_peaks(force: Float[np.ndarray, "reading"]) -> int:
    """Count the peaks whose prominence is a quarter of the maximum."""
    padded = np.concatenate([[0.0], force, [0.0]])
    return len(find_peaks(padded, prominence=0.25 * force.max())[0])
