"""Classifiers of rows of features, from scikit-learn (Pedregosa et al. 2011).

Each makes one when it is called with a seed. It prints as all of its settings, since
results are kept by what a method prints as.
"""

import warnings
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import HistGradientBoostingClassifier, RandomForestClassifier
from sklearn.exceptions import ConvergenceWarning
from sklearn.neighbors import KNeighborsClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.svm import SVC

Estimator = Any
"""With `fit`, `predict` and `predict_proba`, as scikit-learn has them."""


@final
@dataclass(frozen=True)
class SupportVectors:
    """A radial-basis support vector machine."""

    C: float = 10.0
    """What errors cost."""

    def __call__(self, seed: int) -> Estimator:
        """Make one."""
        return SoftmaxMachine(SVC(C=self.C, random_state=seed))


@final
@dataclass(frozen=True)
class NearestNeighbours:
    """The nearest rows; nothing is drawn."""

    k: int = 5
    """How many."""

    def __call__(self, seed: int) -> Estimator:
        """Make one."""
        return KNeighborsClassifier(self.k)


@final
@dataclass(frozen=True)
class Perceptron:
    """A multilayer perceptron."""

    hidden: tuple[int, ...] = (128, 64)
    """Sizes of its hidden layers."""

    decay: float = 1e-4
    """Weight decay."""

    epochs: int = 100
    """At most so many."""

    def __call__(self, seed: int) -> Estimator:
        """Make one."""
        return ContentPerceptron(
            self.hidden, alpha=self.decay, max_iter=self.epochs, random_state=seed
        )


@final
@dataclass(frozen=True)
class LinearDiscriminant:
    """Fisher's discriminant, its covariance drawn to a sphere a little; draws nothing.

    How much is not estimated: scikit-learn does that on standardised features, which
    makes as much of the least principal component as of the first.
    """

    shrinkage: float = 0.1
    """Share of the sphere."""

    def __call__(self, seed: int) -> Estimator:
        """Make one."""
        return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=self.shrinkage)


@final
@dataclass(frozen=True)
class RandomForest:
    """Trees on rows drawn anew, which vote."""

    trees: int = 500
    """How many."""

    leaf: int = 1
    """Fewest rows of a leaf."""

    def __call__(self, seed: int) -> Estimator:
        """Make one."""
        return RandomForestClassifier(
            self.trees, min_samples_leaf=self.leaf, random_state=seed, n_jobs=1
        )


@final
@dataclass(frozen=True)
class GradientBoosting:
    """Small trees, each on what the last ones left over."""

    trees: int = 100
    """How many of each class."""

    leaves: int = 15
    """Most leaves of a tree."""

    rate: float = 0.1
    """Share of each tree that is taken."""

    def __call__(self, seed: int) -> Estimator:
        """Make one."""
        return HistGradientBoostingClassifier(
            learning_rate=self.rate,
            max_iter=self.trees,
            max_leaf_nodes=self.leaves,
            min_samples_leaf=5,
            random_state=seed,
        )


@final
class SoftmaxMachine(ClassifierMixin, BaseEstimator):
    """A support vector machine whose probabilities are the softmax of its decisions.

    Platt's scaling, which scikit-learn has for this, fits every machine five times.
    """

    def __init__(self, machine: SVC) -> None:
        """Take a machine that is to be fitted."""
        self.machine = machine

    def fit(self, X: np.ndarray, y: np.ndarray) -> "SoftmaxMachine":
        """Learn from rows of features."""
        self.machine.fit(X, y)
        self.classes_ = self.machine.classes_
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        """The class of each row."""
        return self.machine.predict(X)

    def predict_proba(self, X: np.ndarray) -> np.ndarray:
        """Probabilities of the classes for each row."""
        decisions = self.machine.decision_function(X)
        if decisions.ndim == 1:
            decisions = np.stack([-decisions, decisions], axis=1)
        powers = np.exp(decisions - decisions.max(axis=1, keepdims=True))
        return powers / powers.sum(axis=1, keepdims=True)


@final
class ContentPerceptron(MLPClassifier):
    """A multilayer perceptron that is content with what its epochs have brought."""

    def fit(
        self, X: np.ndarray, y: np.ndarray, sample_weight: np.ndarray | None = None
    ) -> "ContentPerceptron":
        """Learn from rows of features."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            return super().fit(X, y, sample_weight)
