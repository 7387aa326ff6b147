"""Windows of a small skin in which three classes differ at a glance."""

from functools import cache

import numpy as np

from eskin.skin import MountedSkin
from helpers.live import mounted
from lab.baselines import READINGS, SkinWindows

UR5: MountedSkin = mounted("ur5")
SMALL: MountedSkin = mounted()
RESTS = 20  # readings before the touch


@cache
def toy(count=10, seed=0):
    """Clips of a short touch, a long light one and a wide one on `SMALL`."""
    rng = np.random.default_rng(seed)
    skin = SMALL.skin
    middle = skin.positions.mean(axis=0)
    labels = np.arange(3 * count) % 3
    pressure = np.zeros((3 * count, READINGS, skin.count), np.float32)
    for clip, label in enumerate(labels):
        shifted = middle + rng.normal(0, 0.003, 3)
        near = np.argsort(np.linalg.norm(skin.positions - shifted, axis=1))
        taxels = near[: (9, 9, 40)[label]]
        end = RESTS + (6, 30, 12)[label]
        kpa = (40, 8, 25)[label] * rng.uniform(0.9, 1.1)
        pressure[clip, RESTS:end, taxels] = kpa
    q = np.zeros((3 * count, READINGS, 0), np.float32)
    return SkinWindows(pressure, q), labels
