"""Clips drawn at random, for what must be fitted before it can be timed."""

import numpy as np
from jaxtyping import Int

from eskin.learn.baselines import READINGS, SkinWindows
from eskin.skin import MountedSkin

CLASSES = 5
RADII = (0.010, 0.015, 0.020, 0.030, 0.040)
"""Of the touches of each class [m]."""

LENGTHS = (15, 60, 30, 80, 45)
"""Readings that the touches of each class last."""


def random_clips(
    mounted: MountedSkin, count: int, seed: int = 0
) -> tuple[SkinWindows, Int[np.ndarray, "clip"]]:
    """Round touches anywhere, their classes apart by size and length, and noise.

    Enough for timing, not for anything that accuracies are measured on.

    Args:
        mounted: the skin on its robot.
        count: how many clips.
        seed: decides everything that is drawn.
    """
    rng = np.random.default_rng(seed)
    skin, joints = mounted.skin, len(mounted.robot.joint_names)
    links = mounted.taxel_link_index
    labels = np.arange(count) % CLASSES
    pressure = rng.random((count, READINGS, skin.count), np.float32) * np.float32(0.3)
    for clip, label in enumerate(labels):
        centre = rng.integers(skin.count)
        distance = np.linalg.norm(skin.positions - skin.positions[centre], axis=1)
        near = np.flatnonzero((distance < RADII[label]) & (links == links[centre]))
        length = min(round(LENGTHS[label] * rng.uniform(0.7, 1.3)), READINGS)
        start = int(rng.integers(READINGS - length + 1))
        load = rng.uniform(5.0, 30.0, (length, 1)) * rng.uniform(0.5, 1.5, len(near))
        pressure[clip, start : start + length, near] = load.T
    q = rng.uniform(-1.0, 1.0, (count, 1, joints)).repeat(READINGS, axis=1)
    return SkinWindows(pressure, q.astype(np.float32)), labels
