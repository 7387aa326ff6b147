"""What is left of a clip when its readings are thrown away."""

import numpy as np
from jaxtyping import Float

from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.scene.scene import TrueTouchSeries
from eskin.skin import MountedSkin, Skin

READINGS = 10
"""Readings before contact that are looked at."""
EDGES = np.array([1.0, 2, 3, 5, 8, 12, 20, 30, 50, 80, 130, np.inf])  # [kPa]
PERIOD = 0.02  # [s]
CM, CM2 = 100.0, 1e4


def truth_of(
    clip: SimulatedClip, truth: TrueTouchSeries | None, mounted: MountedSkin
) -> Float[np.ndarray, "reading 5"]:
    """Force [N], area [cm2] and centroid in the link's frame [cm] of one touch."""
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


def before_of(
    clip: SimulatedClip, rest: Float[np.ndarray, "taxel"], skin: Skin
) -> Float[np.ndarray, "quantity"]:
    """Counts of each patch before any contact: mean, deviation, largest, unheard.

    Always of as many readings: how many there are would tell how long a touch lasts.
    """
    patches = np.unique(skin.patch_index)
    onset = min((truth.onset for truth in clip.truths), default=np.inf)
    if onset < (READINGS + 2) * PERIOD:
        return np.full(4 * len(patches), np.nan)
    heard = clip.received[:READINGS]
    above = np.where(heard & np.isfinite(rest), clip.counts[:READINGS] - rest, 0.0)
    found = []
    for patch in patches:
        own = above[:, skin.patch_index == patch]
        unheard = 1.0 - heard[:, skin.patch_index == patch].mean()
        found += [own.mean(), own.std(), own.max(), unheard]
    return np.array(found)


def histogram_of(
    pressure: Float[np.ndarray, "reading taxel"],
) -> Float[np.ndarray, "bin"]:
    """How often each range of pressures was read, at any taxel and reading."""
    felt = pressure[pressure >= EDGES[0]]
    return np.histogram(felt, EDGES)[0].astype(np.float64)
