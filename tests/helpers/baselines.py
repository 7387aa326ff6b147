"""Windows of the whole skin in which three classes differ at a glance."""

from functools import cache

import numpy as np

from eskin.learn.baselines import READINGS, SkinWindows
from eskin.skin import MountedSkin
from helpers.live import mounted

UR5: MountedSkin = mounted("ur5")
RESTS = 20  # readings before the touch


@cache
def toy(count=10, seed=0):
    """Clips of a short touch, a long light one and a wide one on the forearm."""
    rng = np.random.default_rng(seed)
    skin = UR5.skin
    patch = skin.find_taxels("forearm_front")
    middle = skin.positions[patch].mean(axis=0)
    labels = np.arange(3 * count) % 3
    pressure = np.zeros((3 * count, READINGS, skin.count), np.float32)
    for clip, label in enumerate(labels):
        shifted = middle + rng.normal(0, 0.003, 3)
        near = np.argsort(np.linalg.norm(skin.positions[patch] - shifted, axis=1))
        taxels = patch[near[: (9, 9, 40)[label]]]
        end = RESTS + (6, 30, 12)[label]
        kpa = (40, 8, 25)[label] * rng.uniform(0.9, 1.1)
        pressure[clip, RESTS:end, taxels] = kpa
    q = rng.uniform(-1, 1, (3 * count, 1, 6)).repeat(READINGS, axis=1)
    return SkinWindows(pressure, q.astype(np.float32)), labels
