"""Capacitive taxels feel a body before it touches them, beside it and as it leaves."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

from eskin.sim.sensor.build import SensorBuild
from eskin.skin import Skin

TOUCHING = 1.0
"""Pressure from which a taxel counts as fully covered by what touches it [kPa]."""

REACHES = 3.0
"""Distance, by the reach, beyond which nothing is felt."""

TINY = 1e-4
"""Smallest signal that matters, over the signal of a body that touches."""


def add_proximity(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    build: SensorBuild,
    skin: Skin,
) -> tuple[Float[np.ndarray, "time more"], Int[np.ndarray, "more"]]:
    """Add the apparent pressure of bodies close to a capacitive skin but not on it.

    A body that will touch is felt earlier, one that has touched later, and both beside
    the place of contact. The whole series must be known. Only capacitive builds of a
    family feel anything. Pressure is in [kPa].

    Returns:
        The pressure of all taxels that feel anything [kPa], and these taxels.
    """
    flaws = build.flaws
    if flaws is None or not flaws.proximity or not pressure.any():
        return pressure, taxels
    near, cover = compute_cover(pressure, taxels, flaws.proximity_reach, skin)
    growth, fall = (build.electronics.step / each for each in flaws.proximity_times)
    felt = extend_in_time(cover, growth, fall)
    felt *= flaws.proximity * build.velostat.half_pressure
    more = np.union1d(taxels, near)
    apparent = np.zeros((len(pressure), len(more)))
    apparent[:, np.searchsorted(more, near)] = felt
    columns = np.searchsorted(more, taxels)
    apparent[:, columns] = np.maximum(apparent[:, columns], pressure)
    return apparent, more


def compute_cover(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    reach: float,
    skin: Skin,
) -> tuple[Int[np.ndarray, "near"], Float[np.ndarray, "time near"]]:
    """Compute how far taxels are covered by what touches them or their neighbours.

    Returns:
        Taxels within reach of the active ones on their patches, and the cover of each
        at each step, from 0 to 1.
    """
    touching = np.minimum(pressure / TOUCHING, 1.0)
    found = []
    covers = []
    for patch in np.unique(skin.patch_index[taxels]):
        own = skin.patch_index[taxels] == patch
        every = np.flatnonzero(skin.patch_index == patch)
        distances = cdist(skin.positions[taxels[own]], skin.positions[every])
        weights = np.exp(-0.5 * (distances / reach) ** 2)
        reached = distances.min(axis=0) <= REACHES * reach
        found.append(every[reached])
        covers.append(np.minimum(touching[:, own] @ weights[:, reached], 1.0))
    return np.concatenate(found), np.concatenate(covers, axis=1)


def extend_in_time(
    cover: Float[np.ndarray, "time near"], growth: float, fall: float
) -> Float[np.ndarray, "time near"]:
    """Let a signal grow exponentially before each value and fall after it.

    `growth` and `fall` are rates [1/step].
    """
    steps = np.arange(len(cover))[:, None]
    ln = np.log(np.maximum(cover, TINY))
    early = np.maximum.accumulate((ln - growth * steps)[::-1])[::-1] + growth * steps
    late = np.maximum.accumulate(ln + fall * steps) - fall * steps
    extended = np.exp(np.maximum(early, late))
    return np.where(extended > TINY * (1 + 1e-9), extended, 0.0)
