"""This module wraps scikit-learn's classifiers of rows (Pedregosa et al. 2011).

Each one builds a classifier when it is called with a seed. Its `repr` shows all of its
settings, since results are kept by the `repr` of a method.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import HistGradientBoostingClassifier, RandomForestClassifier
from sklearn.exceptions import ConvergenceWarning
from sklearn.neighbors import KNeighborsClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

Estimator = Any
"""Classifier with `fit`, `predict` and `predict_proba`, as scikit-learn has them."""


@final
@dataclass(frozen=True)
class SupportVectors:
    """This estimator builds a support vector machine with a radial basis."""

    C: float = 10.0
    """Cost of errors."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return SoftmaxMachine(SVC(C=self.C, random_state=seed))


@final
@dataclass(frozen=True)
class NearestNeighbours:
    """This estimator builds a nearest-neighbour classifier, which ignores the seed."""

    k: int = 5
    """Number of neighbours."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return KNeighborsClassifier(self.k)


@final
@dataclass(frozen=True)
class Perceptron:
    """This estimator builds a multilayer perceptron."""

    hidden: tuple[int, ...] = (128, 64)
    """Sizes of its hidden layers."""
    decay: float = 1e-4
    """Weight decay."""
    epochs: int = 100
    """Largest number of epochs."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return QuietPerceptron(
            self.hidden, alpha=self.decay, max_iter=self.epochs, random_state=seed
        )


@final
@dataclass(frozen=True)
class LinearDiscriminant:
    """This estimator builds Fisher's discriminant with a shrunken covariance.

    It ignores the seed. The shrinkage is fixed: scikit-learn would estimate it on
    standardised features, which gives the last principal component as much weight as
    the first.
    """

    shrinkage: float = 0.1
    """Weight of the identity in the covariance."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=self.shrinkage)


@final
@dataclass(frozen=True)
class RandomForest:
    """This estimator builds a random forest."""

    trees: int = 500
    """Number of trees."""
    leaf: int = 1
    """Smallest number of rows in a leaf."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return RandomForestClassifier(
            self.trees, min_samples_leaf=self.leaf, random_state=seed, n_jobs=1
        )


@final
@dataclass(frozen=True)
class GradientBoosting:
    """This estimator builds gradient-boosted trees."""

    trees: int = 100
    """Number of trees of each class."""
    leaves: int = 15
    """Largest number of leaves of a tree."""
    rate: float = 0.1
    """Learning rate: share of each tree that is added."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return HistGradientBoostingClassifier(
            learning_rate=self.rate,
            max_iter=self.trees,
            max_leaf_nodes=self.leaves,
            min_samples_leaf=5,
            random_state=seed,
        )


@final
@dataclass(frozen=True)
class Standardised:
    """This estimator standardises features for another one."""

    of: Callable[[int], Estimator]
    """Function that builds the other estimator from a seed."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return make_pipeline(StandardScaler(), self.of(seed))


@final
class SoftmaxMachine(ClassifierMixin, BaseEstimator):
    """This classifier takes the softmax of the decisions of a linear or kernel machine.

    Platt scaling, scikit-learn's method for this, would fit every machine five times.
    """

    def __init__(self, machine: Estimator) -> None:
        """Store a machine that is to be fitted."""
        self.machine = machine

    def fit(self, X: np.ndarray, y: np.ndarray) -> "SoftmaxMachine":
        """Fit rows of features."""
        self.machine.fit(X, y)
        self.classes_ = self.machine.classes_
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        """Return the class of each row."""
        return self.machine.predict(X)

    def predict_proba(self, X: np.ndarray) -> np.ndarray:
        """Return the probabilities of the classes for each row."""
        decisions = self.machine.decision_function(X)
        if decisions.ndim == 1:
            decisions = np.stack([-decisions, decisions], axis=1)
        powers = np.exp(decisions - decisions.max(axis=1, keepdims=True))
        return powers / powers.sum(axis=1, keepdims=True)


@final
class QuietPerceptron(MLPClassifier):
    """This multilayer perceptron does not warn when it stops before it converges."""

    def fit(
        self, X: np.ndarray, y: np.ndarray, sample_weight: np.ndarray | None = None
    ) -> "QuietPerceptron":
        """Fit rows of features."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            return super().fit(X, y, sample_weight)
