"""This module defines the methods that are compared: each learns from clips."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.graph import GraphConfig, compute_summary
from eskin.learn.baselines import (
    BASELINES,
    NETWORKS,
    Baseline,
    FitConfig,
    PaperBaseline,
    Pooling,
)
from eskin.learn.baselines.estimators import Estimator, GradientBoosting
from eskin.learn.baselines.hand import compute_features, compute_statistics
from eskin.learn.comparison.encoders import ENCODERS, EncoderKind
from eskin.learn.comparison.examples import Examples
from eskin.learn.dataset import Dataset
from eskin.learn.evaluation import find_last_rows, predict_clips
from eskin.learn.training import TrainConfig, Trainer
from eskin.model import NetworkConfig
from eskin.recording import NONE
from eskin.skin import MountedSkin

Predictor = Callable[[Examples], Float[np.ndarray, "clip class"]]
"""Function that returns log-probabilities of the classes for each clip, in the order of
the gestures that were learned."""


class Method(ABC):
    """A method learns from clips of a skin."""

    @abstractmethod
    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from clips; the same seed gives the same result.

        Args:
            examples: clips to learn from.
            seed: seed of all random draws.
        """


@final
@dataclass(frozen=True)
class TouchTrees(Method):
    """This method boosts trees on statistics of the touch that ours classifies.

    Readings, segmentation, contact graphs and their summary are the recogniser's own,
    so that the difference between the two is the effect of the network, with its
    augmentation and with labels of every touch.
    """

    estimator: Callable[[int], Estimator] = GradientBoosting(leaves=31)
    """Function that builds the trees from a seed."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from the touches of clips."""
        truth = examples.truth(examples.gestures)
        model = self.estimator(seed).fit(build_touch_rows(examples), truth)

        def predict(other: Examples) -> Float[np.ndarray, "clip class"]:
            chances = model.predict_proba(build_touch_rows(other))
            return np.log(np.maximum(chances, 1e-12))

        return predict


def build_touch_rows(examples: Examples) -> Float[np.ndarray, "clip feature"]:
    """Return features of each clip's touch of largest impulse, zeros without one."""
    dataset = examples.dataset(GraphConfig())
    ends = list(find_last_rows(dataset, examples.clips))
    found = {end: compute_touch_features(dataset, end) for end in ends if end >= 0}
    width = max((len(row) for row in found.values()), default=0)
    nothing = np.zeros(width)
    return np.stack([found.get(end, nothing) for end in ends]).astype(np.float32)


def compute_touch_features(dataset: Dataset, end: int) -> Float[np.ndarray, "feature"]:
    """Return the hand-made features of a touch, and its summary's statistics and end.

    Args:
        dataset: data set that holds the touch.
        end: last row of the touch.
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
"""Training of the recogniser on some 500 clips: to the end, without choosing an
epoch."""
SMALL = 500
"""Number of clips beyond which training takes more steps, in proportion."""
FIT_CONFIGS: dict[str, FitConfig] = {
    "cnn-lstm": FitConfig(epochs=80),
    "3d-cnn": FitConfig(rate=5e-3),
    "tactile-image": FitConfig(),
    "paper": FitConfig(epochs=10, batch=4, rate=5e-4, schedule="constant"),
}
"""Training of the networks among the baselines: the settings that did best
(`benchmarks.tuning`); forty epochs of the paper's would take an hour."""


@final
@dataclass(frozen=True)
class RecogniserMethod(Method):
    """This method trains the recogniser, or a variant that lacks something."""

    config: TrainConfig = FOR_SMALL_SETS
    """Settings of the training."""
    encoder: EncoderKind = "equivariant"
    """Encoder of the contact graphs."""
    skins: int = 0
    """Number of aged skins that record each clip besides."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from the touches of clips."""
        graph = self.config.graph_used
        dataset = examples.dataset(graph, self.skins)
        vocabulary = (NONE, *(name for name in examples.gestures if name != NONE))
        more = max(1.0, len(examples.clips) / SMALL)
        config = replace(self.config, steps=round(more * self.config.steps))
        trainer = Trainer(dataset, vocabulary, config, seed=seed)
        trainer.network.encoder = ENCODERS[self.encoder](self.config.network)
        network = trainer.run(quiet=True)
        columns = [vocabulary.index(gesture) for gesture in examples.gestures]
        shares = compute_class_shares(examples.truth(examples.gestures))

        def predict(other: Examples) -> Float[np.ndarray, "clip class"]:
            found = predict_clips(network, other.dataset(graph), vocabulary)
            chances = found.log_probabilities[:, columns]
            # Where `none` is not a class, no touch means the most frequent other.
            nothing = np.isneginf(chances).all(axis=1, keepdims=True)
            return np.where(nothing, np.log(shares), chances)

        return predict


@final
@dataclass(frozen=True)
class BaselineMethod(Method):
    """This method fits one of the baselines (see `eskin.learn.baselines`)."""

    make: Callable[[MountedSkin], Baseline]
    """Function that builds the baseline; its `repr` shows all settings, since results
    are kept by the `repr` of a method."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from all taxels in clips."""
        baseline = self.make(examples.mounted)
        baseline.fit(examples.windows, examples.truth(examples.gestures), seed)

        def predict(other: Examples) -> Float[np.ndarray, "clip class"]:
            chances = [
                baseline.move_to(mounted).predict_probabilities(windows)
                for mounted, windows in other.find_windows_on(baseline.mounted)
            ]
            return np.log(np.maximum(np.concatenate(chances), 1e-12))

        return predict


def build_network_method(name: str, config: FitConfig) -> BaselineMethod:
    """Return the method of a baseline that is a network.

    Args:
        name: name in `NETWORKS`.
        config: settings of the training.
    """
    if name == "paper":
        return build_paper_method(config)
    return BaselineMethod(partial(NETWORKS[name], config=config))


def build_paper_method(
    config: FitConfig, k: int = 8, pooling: Pooling = "max"
) -> BaselineMethod:
    """Return the method of the paper's network.

    Args:
        config: settings of the training.
        k: number of neighbours of a taxel inside its patch.
        pooling: pooling over the nodes of a reading.
    """
    return BaselineMethod(partial(PaperBaseline, config=config, k=k, pooling=pooling))


def compute_class_shares(truth: Int[np.ndarray, "clip"]) -> Float[np.ndarray, "class"]:
    """Return how often each class occurs, as a share."""
    return np.bincount(truth) / len(truth)


METHODS: dict[str, Method] = {
    "eskin": RecogniserMethod(),
    "boosting-on-touch": TouchTrees(),
    **{name: BaselineMethod(make) for name, make in BASELINES.items()},
    **{name: build_network_method(name, FIT_CONFIGS[name]) for name in NETWORKS},
}
"""Methods by name; ours is the first."""

ABLATIONS: dict[str, Method] = {
    "without poses": RecogniserMethod(
        replace(FOR_SMALL_SETS, graph=GraphConfig(posed=False))
    ),
    "not equivariant": RecogniserMethod(encoder="plain"),
}
"""Ours without something, by what it lacks."""
