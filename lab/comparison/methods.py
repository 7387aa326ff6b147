"""This module defines the methods that are compared, all trained on examples."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.learn.dataset import Dataset
from eskin.learn.evaluation import compute_log_probabilities
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.training import TrainConfig, Trainer
from eskin.live import NetworkConfig
from eskin.recording import NONE
from eskin.skin import MountedSkin
from lab.baselines import (
    BASELINES,
    NETWORKS,
    Baseline,
    FitConfig,
    PaperBaseline,
)
from lab.baselines.estimators import (
    Estimator,
    GradientBoosting,
    NearestNeighbours,
    RandomForest,
    Standardised,
    SupportVectors,
)
from lab.baselines.series import SERIES
from lab.comparison.examples import Examples
from lab.comparison.touches import Form, TouchRows, TouchSpan, average_rows

SMALLEST = 1e-9
"""Probability that is added before a logarithm."""

Predictor = Callable[[Examples], Float[np.ndarray, "example class"]]
"""Function that returns log-probabilities for each example, their mean over its
windows, the classes in the order of the training examples' gestures."""


class Method(ABC):
    """A method trains a classifier of examples."""

    @abstractmethod
    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Train on examples; results are reproducible by the seed.

        Args:
            examples: examples to train on.
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

    estimator: Callable[[int], Estimator]
    """Function that builds the classifier from a seed."""
    forms: tuple[Form, ...]
    """Forms of the touch that it takes, joined."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from the touches of examples."""
        touches = build_touch_rows(examples, self.forms)
        truth = np.array(examples.labels)[touches.example]
        model = self.estimator(seed).fit(touches.rows, truth)

        def predict(other: Examples) -> Float[np.ndarray, "example class"]:
            found = build_touch_rows(other, self.forms)
            probabilities = model.predict_proba(found.rows)
            return average_rows(np.log(probabilities + SMALLEST), found.example)

        return predict


def build_touch_rows(examples: Examples, forms: Sequence[Form]) -> TouchRows:
    """Return several forms of the touches of examples side by side."""
    parts = [examples.touch_rows(form) for form in forms]
    rows = np.concatenate([part.rows for part in parts], axis=1)
    return TouchRows(rows, parts[0].example)


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
    "paper": FitConfig(
        epochs=60,
        drawn=500,
        batch=8,
        rate=3e-3,
        schedule="constant",
        held_out=0.15,
        patience=20,
    ),
}
"""Training of the baselines that are networks, tuned on sets of their own. That of the
paper takes every fourth reading, and stops when held-out accuracy no longer rises."""


@final
@dataclass(frozen=True)
class RecogniserMethod(Method):
    """This method trains the recogniser."""

    config: TrainConfig = FOR_SMALL_SETS
    """Settings of the training."""
    small: int | None = SMALL
    """Number of examples beyond which training takes more steps, in proportion; None
    for never."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Learn from the touches in recordings."""
        config = replace(self.config, shear=self.config.shear and examples.has_shear)
        if self.small is not None:
            factor = max(1.0, examples.count / self.small)
            config = replace(config, steps=round(factor * config.steps))
        graph = config.select_graph()
        vocabulary = (NONE, *(name for name in examples.gestures if name != NONE))
        trainer = Trainer(examples.dataset(graph), vocabulary, config, seed=seed)
        network = trainer.run(quiet=True)
        columns = [vocabulary.index(gesture) for gesture in examples.gestures]
        truth = examples.truth(examples.gestures)
        # Without a class `none`, examples without a touch get the prior.
        nothing = np.bincount(truth) / len(truth)
        if NONE in examples.gestures:
            nothing = np.array(examples.gestures) == NONE

        def predict(other: Examples) -> Float[np.ndarray, "example class"]:
            dataset = other.dataset(graph)
            touches = other.find_touches(dataset)
            answers = np.log(np.tile(nothing + SMALLEST, (len(touches), 1)))
            touched = np.array([touch is not None for touch in touches])
            found = [touch for touch in touches if touch is not None]
            if found:
                answers[touched] = score_touches(network, dataset, found)[:, columns]
            return answers

        return predict


def score_touches(
    network: RecogniserNetwork, dataset: Dataset, touches: Sequence[TouchSpan]
) -> Float[np.ndarray, "touch class"]:
    """Return the recogniser's mean log-probabilities over the windows of each touch."""
    counts = np.array([len(touch.ends) for touch in touches])
    ends = np.concatenate([touch.ends for touch in touches])
    firsts = np.repeat([touch.first for touch in touches], counts)
    closing = np.isin(np.arange(len(ends)), np.cumsum(counts) - 1)
    scores = compute_log_probabilities(network, dataset, ends, firsts, closing=closing)
    return average_rows(scores, np.repeat(np.arange(len(touches)), counts))


@final
@dataclass(frozen=True)
class BaselineMethod(Method):
    """This method fits one of the baselines (see `lab.baselines`)."""

    make: Callable[[MountedSkin], Baseline]
    """Function that builds the baseline; its `repr` shows all settings, since results
    are kept by the `repr` of a method."""
    on_touch: bool = False
    """Whether windows hold the touch that ours classifies alone."""

    def fit(self, examples: Examples, seed: int) -> Predictor:
        """Train on the windows of examples."""
        if self.on_touch:
            examples = examples.of_touches()
        baseline = self.make(examples.mounted)
        truth = examples.truth(examples.gestures)
        baseline.fit(examples.windows, truth[examples.window_example], seed)

        def predict(other: Examples) -> Float[np.ndarray, "example class"]:
            if self.on_touch:
                other = other.of_touches()
            probabilities = baseline.predict_probabilities(other.windows)
            scores = np.log(probabilities + SMALLEST)
            return average_rows(scores, other.window_example)

        return predict


ON_FEATURES: dict[str, Callable[[int], Estimator]] = {
    "random-forest": RandomForest(),
    "gradient-boosting": GradientBoosting(),
    "svm": Standardised(SupportVectors()),
    "knn": Standardised(NearestNeighbours()),
}
"""Estimators on hand-made features of a touch."""

METHODS: dict[str, Method] = {
    "eskin": RecogniserMethod(),
    "boosting-on-touch": TouchMethod(
        GradientBoosting(leaves=31), ("features", "summary")
    ),
    **{
        f"{name}-features": TouchMethod(estimator, ("features",))
        for name, estimator in ON_FEATURES.items()
    },
    **{name: TouchMethod(make, ("series",)) for name, make in SERIES.items()},
    **{name: BaselineMethod(make) for name, make in BASELINES.items()},
    **{
        name: BaselineMethod(partial(make, config=FIT_CONFIGS[name]))
        for name, make in NETWORKS.items()
        if name != "paper"
    },
    "paper": BaselineMethod(
        partial(
            PaperBaseline,
            config=FIT_CONFIGS["paper"],
            k=8,
            pooling="max",
            distance="kinematic",
            stride=4,
        )
    ),
}
"""Methods by name; ours is the first."""

METHODS_ON_RECORDINGS: dict[str, Method] = {
    **{name: method for name, method in METHODS.items() if name != "timers"},
    "eskin": RecogniserMethod(TrainConfig(validation=0.0), small=None),
    "3d-cnn": BaselineMethod(
        partial(NETWORKS["3d-cnn"], config=FitConfig(epochs=20, batch=32))
    ),
}
"""The same methods with their settings for real recordings: ours with the defaults of
`eskin train`. Timers know gestures of generated sets only."""
