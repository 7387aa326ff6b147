"""This module classifies the pressures of all taxels as one feature vector.

The paper's SVM, KNN and MLP "flatten all sensor signals into a 2112-dimensional input
vector" (section V-B).
"""

from collections.abc import Callable
from typing import Literal, final

import numpy as np
from jaxtyping import Float
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from eskin.skin import MountedSkin
from lab.baselines.estimators import Estimator
from lab.baselines.interface import (
    READINGS,
    Labels,
    RowBaseline,
    SkinWindows,
)

PRESSURE_UNIT = 10.0
"""Unit in which baselines take pressures [kPa]."""

TIME_BINS = 10
"""Number of parts of a window."""

COMPONENTS = 512
"""Largest number of principal components."""

Features = Literal["maxima", "bins"]
FeatureRows = Float[np.ndarray, "clip feature"]


@final
class FlatBaseline(RowBaseline):
    """A flat baseline classifies the pressures of all taxels as rows of features."""

    def __init__(
        self,
        mounted: MountedSkin,
        estimator: Callable[[int], Estimator],
        features: Features,
    ) -> None:
        """Create an untrained baseline.

        Args:
            mounted: the skin on its robot.
            estimator: function that builds the classifier of rows from a seed.
            features: each taxel's maximum over the window, or its mean in each of ten
                parts of the window, all reduced to 512 principal components (fewer
                where there are fewer windows).
        """
        super().__init__(mounted, estimator)
        self.reduces = features == "bins"

    def compute_rows(self, clips: SkinWindows) -> FeatureRows:
        """Return the features of each window."""
        compute = compute_bins if self.reduces else compute_maxima
        return compute(clips.pressure)

    def fit_windows(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Fit windows that have been checked."""
        rows = self.compute_rows(clips)
        self.model = self.estimator(seed)
        if self.reduces:
            parts = PCA(min(COMPONENTS, *rows.shape), random_state=seed)
            self.model = make_pipeline(parts, self.model)
        self.model.fit(rows, labels)


def compute_maxima(pressure: Float[np.ndarray, "clip 100 taxel"]) -> FeatureRows:
    """Return each taxel's maximum over the window, in `PRESSURE_UNIT`."""
    return pressure.max(axis=1) / np.float32(PRESSURE_UNIT)


def compute_bins(pressure: Float[np.ndarray, "clip 100 taxel"]) -> FeatureRows:
    """Return each taxel's mean in each part of the window, in `PRESSURE_UNIT`."""
    clips, _, taxels = pressure.shape
    parts = pressure.reshape(clips, TIME_BINS, READINGS // TIME_BINS, taxels)
    means = parts.mean(axis=2, dtype=np.float32).reshape(clips, -1)
    return means / np.float32(PRESSURE_UNIT)
