"""This module classifies windows by one signal, the total force on the skin.

It stands for Alonso-Martin et al. 2017 in the paper's Table I, who tell four gestures
apart by one microphone, with a CNN, an SVM and an MLP. Our skins hear no sound; what is
kept is that one signal has no places. Which signal, and its features, are our choice.
"""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.live.summary_kernels import N_PER_KPA_CM2
from lab.baselines.interface import READINGS, STEP_NS, RowBaseline, SkinWindows

SECONDS = np.arange(READINGS) * STEP_NS * 1e-9
"""Time of each reading since the first of its window [s]."""

BANDS = (1, 2, 3, 4, 7, 12, 19, 31, 51)
"""Limits of the bands of the spectrum, in half hertz."""

LEVELS = (0.1, 0.5)
"""Shares of the largest force that count as on."""


@final
class SignalBaseline(RowBaseline):
    """This baseline classifies features of the total force in time and frequency."""

    def compute_rows(self, clips: SkinWindows) -> Float[np.ndarray, "clip feature"]:
        """Return the features of each window."""
        areas = self.mounted.skin.areas.astype(np.float32) * 1e4 * N_PER_KPA_CM2
        return compute_signal_features(clips.pressure @ areas)


def compute_signal_features(
    force: Float[np.ndarray, "clip 100"],
) -> Float[np.ndarray, "clip feature"]:
    """Return the features of the forces [N] in windows.

    They are mean, spread and largest value of the force; mean, spread and both extremes
    of its rate; when it acts, and for how long; how long it is above some shares of its
    largest value, and how often it rises above them; the share of its power in bands.
    """
    largest = force.max(axis=1, keepdims=True)
    rate = np.diff(force, axis=1) / SECONDS[1]
    share = force / np.maximum(force.sum(axis=1, keepdims=True), 1e-6)
    middle = share @ SECONDS
    columns = [
        force.mean(axis=1),
        force.std(axis=1),
        largest[:, 0],
        np.abs(rate).mean(axis=1),
        rate.std(axis=1),
        rate.max(axis=1),
        rate.min(axis=1),
        middle,
        np.sqrt(np.maximum(share @ SECONDS**2 - middle**2, 0.0)),
    ]
    for level in LEVELS:
        above = force > level * largest
        rises = above[:, 1:] & ~above[:, :-1]
        columns += [above.mean(axis=1), above[:, 0] + rises.sum(axis=1)]
    return np.column_stack([*columns, compute_bands(force)])


def compute_bands(
    force: Float[np.ndarray, "clip 100"],
) -> Float[np.ndarray, "clip band"]:
    """Return the share of a force's power in each band, without its mean."""
    changing = (force - force.mean(axis=1, keepdims=True)) * np.hanning(READINGS)
    power = np.abs(np.fft.rfft(changing, axis=1)) ** 2
    pairs = zip(BANDS[:-1], BANDS[1:], strict=True)
    bands = [power[:, low:high].sum(axis=1) for low, high in pairs]
    return np.column_stack(bands) / (power.sum(axis=1, keepdims=True) + 1e-9)
