"""This module defines the methods that are compared, all trained on clips."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.learn.dataset import Dataset
from eskin.learn.evaluation import find_last_rows, predict_clips
from eskin.learn.training import TrainConfig, Trainer
from eskin.live import SLOT_NS, GraphConfig, NetworkConfig, compute_summary
from eskin.recording import NONE
from eskin.skin import MountedSkin
from lab.baselines import (
    BASELINES,
    NETWORKS,
    Baseline,
    FitConfig,
    PaperBaseline,
)
from lab.baselines.estimators import Estimator, GradientBoosting
from lab.baselines.hand import compute_features, compute_statistics
from lab.baselines.series import COLUMNS, SERIES, align_series
from lab.comparison.examples import Examples

Predictor = Callable[[Examples], Float[np.ndarray, "clip class"]]
"""Function that returns log-probabilities for each clip, the classes in the order of
the training examples' gestures."""


class Method(ABC):
    """A method trains a classifier of clips."""

    @abstractmethod
    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Train on clips; results are reproducible by the seed.

        Args:
            examples: clips to train on.
            seed: seed of all random draws.
        """


@final
@dataclass(frozen=True)
class TouchMethod(Method):
    """This method classifies the touch that ours classifies, without our network.

    Readings, segmentation, contact graphs and their summary are the recogniser's, so
    the difference between the two is the effect of the network, of augmentation and of
    labels for every touch.
    """

    estimator: Callable[[int], Estimator] = GradientBoosting(leaves=31)
    """Function that builds the classifier from a seed."""
    series: bool = False
    """Whether it takes the series of the touch, instead of statistics of it."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from the touches of clips."""
        truth = np.array(examples.gestures)[examples.truth(examples.gestures)]
        model = self.estimator(seed).fit(build_touch_rows(examples, self.series), truth)

        def predict(other: Examples) -> Float[np.ndarray, "clip class"]:
            rows = build_touch_rows(other, self.series)
            return np.log(np.maximum(model.predict_proba(rows), 1e-12))

        return predict


def build_touch_rows(
    examples: Examples, series: bool = False
) -> Float[np.ndarray, "clip *feature"]:
    """Return features of each clip's touch of largest impulse, zeros without one."""
    compute = compute_touch_series if series else compute_touch_features
    dataset = examples.dataset(GraphConfig())
    ends = list(find_last_rows(dataset, examples.clips))
    found = {end: compute(dataset, end) for end in ends if end >= 0}
    nothing = np.zeros_like(next(iter(found.values()), np.zeros(0)))
    return np.stack([found.get(end, nothing) for end in ends]).astype(np.float32)


def compute_touch_series(
    dataset: Dataset, end: int
) -> Float[np.ndarray, "channel reading"]:
    """Return the series of a touch, whose last row in the data set is `end`."""
    rows = np.arange(dataset.starts[end], end + 1)
    summary = compute_summary(dataset.graphs.select(rows), shear=False)
    return align_series(summary[:, COLUMNS], dataset.stamps[rows] // SLOT_NS)


def compute_touch_features(dataset: Dataset, end: int) -> Float[np.ndarray, "feature"]:
    """Return hand-crafted features of a touch, and its summary's statistics and end.

    `end` is the last row of the touch in the data set.
    """
    rows = np.arange(dataset.starts[end], end + 1)
    series = compute_summary(dataset.graphs.select(rows), shear=False).T
    hand = compute_features(dataset, rows, shear=False)
    return np.concatenate([hand, compute_statistics(series), series[:, -1]])


AS_LARGE_AS_SHIPPED = NetworkConfig(width=32, layers=3, channels=48, dropout=0.1)
FOR_SMALL_SETS = TrainConfig(
    epochs=6,
    steps=100,
    batch=96,
    readings=10,
    decay=0.1,
    smoothing=0.05,
    validation=0.0,
    network=AS_LARGE_AS_SHIPPED,
)
"""Training of the recogniser on some 500 clips: all epochs, without validation."""
SMALL = 500
"""Number of clips beyond which training takes more steps, in proportion."""
FIT_CONFIGS: dict[str, FitConfig] = {
    "cnn-lstm": FitConfig(epochs=80),
    "3d-cnn": FitConfig(rate=5e-3),
    "tactile-image": FitConfig(),
    "paper": FitConfig(epochs=10, batch=4, rate=5e-4, schedule="constant"),
}
"""Training of the baselines that are networks, tuned on sets of their own; forty
epochs of the paper's network would take an hour."""


@final
@dataclass(frozen=True)
class RecogniserMethod(Method):
    """This method trains the recogniser."""

    config: TrainConfig = FOR_SMALL_SETS
    """Settings of the training."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from the touches of clips."""
        graph = self.config.select_graph()
        dataset = examples.dataset(graph)
        vocabulary = (NONE, *(name for name in examples.gestures if name != NONE))
        factor = max(1.0, len(examples.clips) / SMALL)
        config = replace(self.config, steps=round(factor * self.config.steps))
        trainer = Trainer(dataset, vocabulary, config, seed=seed)
        network = trainer.run(quiet=True)
        columns = [vocabulary.index(gesture) for gesture in examples.gestures]
        truth = examples.truth(examples.gestures)
        shares = np.bincount(truth) / len(truth)

        def predict(other: Examples) -> Float[np.ndarray, "clip class"]:
            found = predict_clips(network, other.dataset(graph), vocabulary)
            log_probabilities = found.log_probabilities[:, columns]
            # Without a class `none`, clips without a touch get the prior.
            nothing = np.isneginf(log_probabilities).all(axis=1, keepdims=True)
            return np.where(nothing, np.log(shares), log_probabilities)

        return predict


@final
@dataclass(frozen=True)
class BaselineMethod(Method):
    """This method fits one of the baselines (see `lab.baselines`)."""

    make: Callable[[MountedSkin], Baseline]
    """Function that builds the baseline; its `repr` shows all settings, since results
    are kept by the `repr` of a method."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Train on the pressures of all taxels in clips."""
        baseline = self.make(examples.mounted)
        baseline.fit(examples.windows, examples.truth(examples.gestures), seed)

        def predict(other: Examples) -> Float[np.ndarray, "clip class"]:
            probabilities = baseline.predict_probabilities(other.windows)
            return np.log(np.maximum(probabilities, 1e-12))

        return predict


METHODS: dict[str, Method] = {
    "eskin": RecogniserMethod(),
    "boosting-on-touch": TouchMethod(),
    **{name: TouchMethod(make, series=True) for name, make in SERIES.items()},
    **{name: BaselineMethod(make) for name, make in BASELINES.items()},
    **{
        name: BaselineMethod(partial(make, config=FIT_CONFIGS[name]))
        for name, make in NETWORKS.items()
        if name != "paper"
    },
    "paper": BaselineMethod(
        partial(PaperBaseline, config=FIT_CONFIGS["paper"], k=8, pooling="max")
    ),
}
"""Methods by name; ours is the first."""
