"""Boosted trees on what our network is given of a touch: what the network adds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphConfig, pressure_summary
from eskin.learn.baselines.estimators import Estimator, GradientBoosting
from eskin.learn.clip_scoring import last_rows
from eskin.learn.comparison.examples import Examples
from eskin.learn.comparison.method import Answers, Method
from eskin.learn.dataset import Dataset
from eskin.learn.hand_features import statistics, stretch_features


@final
@dataclass(frozen=True)
class TouchTrees(Method):
    """Boosting on statistics of the touch that our recogniser answers for a clip.

    Readings, segmentation, contact graphs and their summary are the recogniser's own,
    so that what is between the two is what the network is worth, with its augmentation
    and with labels of every touch.
    """

    estimator: Callable[[int], Estimator] = GradientBoosting(leaves=31)
    """Makes the trees from a seed."""

    def fit(self, examples: Examples, seed: int) -> Answers:
        """Learn from the touches of clips."""
        truth = examples.truth(examples.gestures)
        model = self.estimator(seed).fit(touch_rows(examples), truth)

        def answers(other: Examples) -> Float[np.ndarray, "clip class"]:
            chances = model.predict_proba(touch_rows(other))
            return np.log(np.maximum(chances, 1e-12))

        return answers


def touch_rows(examples: Examples) -> Float[np.ndarray, "clip feature"]:
    """Features of the touch of largest impulse of each clip, zeros without a touch."""
    dataset = examples.dataset(GraphConfig())
    ends = list(last_rows(dataset, examples.every))
    found = {end: touch_features(dataset, end) for end in ends if end >= 0}
    width = max((len(row) for row in found.values()), default=0)
    nothing = np.zeros(width)
    return np.stack([found.get(end, nothing) for end in ends]).astype(np.float32)


def touch_features(dataset: Dataset, end: int) -> Float[np.ndarray, "feature"]:
    """The hand-made features, and statistics and last row of our summary.

    Args:
        dataset: where the touch is.
        end: its last row.
    """
    rows = np.arange(dataset.starts[end], end + 1)
    series = pressure_summary(dataset.graphs.select(rows)).T
    hand = stretch_features(dataset, rows, shear=False)
    return np.concatenate([hand, statistics(series), series[:, -1]])
