"""Classifiers that see the skin as one long row of numbers.

The paper's SVM, KNN and MLP "flatten all sensor signals into a 2112-dimensional input
vector" (section V-B).
"""

from collections.abc import Callable
from typing import Literal, final

import numpy as np
from jaxtyping import Float
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from eskin.learn.baselines.estimators import Estimator
from eskin.learn.baselines.interface import (
    READINGS,
    Baseline,
    Labels,
    Probabilities,
    SkinWindows,
)
from eskin.skin import MountedSkin

KPA = 10.0
"""Pressures are in units of this [kPa]."""

BINS = 10
COMPONENTS = 512

Features = Literal["maxima", "bins"]
FeatureRows = Float[np.ndarray, "clip feature"]


@final
class FlatBaseline(Baseline):
    """A classifier of rows on the pressures of all taxels."""

    def __init__(
        self,
        mounted: MountedSkin,
        estimator: Callable[[int], Estimator],
        features: Features,
    ) -> None:
        """Make one that knows nothing yet.

        Args:
            mounted: the skin on its robot.
            estimator: makes the classifier of rows from a seed.
            features: each taxel's maximum over the window, or its mean in each of ten
                parts of the window, all reduced to 512 principal components (fewer
                where there are fewer clips).
        """
        super().__init__(mounted)
        self.make = estimator
        self.rows = compute_maxima if features == "maxima" else bins
        self.reduces = features == "bins"
        self.model: Estimator = None

    def learn(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Learn from windows that have been checked."""
        rows = self.rows(clips.pressure)
        self.model = self.make(seed)
        if self.reduces:
            parts = PCA(min(COMPONENTS, *rows.shape), random_state=seed)
            self.model = make_pipeline(parts, self.model)
        self.model.fit(rows, labels)

    def answer(self, clips: SkinWindows) -> Probabilities:
        """Answer windows that have been checked."""
        return np.asarray(self.model.predict_proba(self.rows(clips.pressure)))


def compute_maxima(pressure: Float[np.ndarray, "clip 100 taxel"]) -> FeatureRows:
    """Each taxel's maximum over the window, in `KPA`."""
    return pressure.max(axis=1) / np.float32(KPA)


def bins(pressure: Float[np.ndarray, "clip 100 taxel"]) -> FeatureRows:
    """Each taxel's mean in each of `BINS` parts of the window, in `KPA`."""
    clips, _, taxels = pressure.shape
    parts = pressure.reshape(clips, BINS, READINGS // BINS, taxels)
    return parts.mean(axis=2, dtype=np.float32).reshape(clips, -1) / np.float32(KPA)
