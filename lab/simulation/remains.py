"""Extract what the tables need of a clip besides its readings."""

import numpy as np
from jaxtyping import Float

from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.scene.scene import TrueTouchSeries
from eskin.skin import MountedSkin, Skin

READINGS = 10
"""Number of readings before contact."""
EDGES = np.array([1.0, 2, 3, 5, 8, 12, 20, 30, 50, 80, 130, np.inf])  # [kPa]
PERIOD = 0.02  # [s]
CM, CM2 = 100.0, 1e4


def build_true_series(
    clip: SimulatedClip, truth: TrueTouchSeries | None, mounted: MountedSkin
) -> Float[np.ndarray, "reading 5"]:
    """Return force [N], area [cm2] and centroid in the link's frame [cm]."""
    series = np.zeros((len(clip.q), 5))
    series[:, 2:] = np.nan
    if truth is None:
        return series
    T = mounted.kinematics.poses(clip.q)[:, mounted.robot.link_index(truth.link)]
    away = truth.centroid - T[:, :3, 3]
    p_link = np.einsum("tji,tj->ti", T[:, :3, :3], away)
    series[:, 0], series[:, 1] = truth.force, truth.area * CM2
    series[:, 2:] = np.where(truth.force[:, None] > 0, p_link * CM, np.nan)
    return series


def compute_rest_statistics(
    clip: SimulatedClip, rest: Float[np.ndarray, "taxel"], skin: Skin
) -> Float[np.ndarray, "quantity"]:
    """Return mean, SD, maximum and missing share of counts by patch before contact.

    The number of readings is fixed, because it would otherwise depend on the touch.
    """
    patches = np.unique(skin.patch_index)
    onset = min((truth.onset for truth in clip.truths), default=np.inf)
    if onset < (READINGS + 2) * PERIOD:
        return np.full(4 * len(patches), np.nan)
    received = clip.received[:READINGS]
    above = np.where(received & np.isfinite(rest), clip.counts[:READINGS] - rest, 0.0)
    found = []
    for patch in patches:
        own = above[:, skin.patch_index == patch]
        missing = 1.0 - received[:, skin.patch_index == patch].mean()
        found += [own.mean(), own.std(), own.max(), missing]
    return np.array(found)


def compute_histogram(
    pressure: Float[np.ndarray, "reading taxel"],
) -> Float[np.ndarray, "bin"]:
    """Return the histogram of the pressures of all taxels and readings."""
    felt = pressure[pressure >= EDGES[0]]
    return np.histogram(felt, EDGES)[0].astype(np.float64)
