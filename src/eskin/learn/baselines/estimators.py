"""Classifiers of rows of features, from scikit-learn (Pedregosa et al. 2011)."""

import warnings
from collections.abc import Callable
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
"""With `fit`, `predict` and `predict_proba`, as scikit-learn has them."""


@final
class SupportVectors(ClassifierMixin, BaseEstimator):
    """A support vector machine whose probabilities are the softmax of its decisions.

    Platt's scaling, which scikit-learn has for this, fits every machine five times.
    """

    def __init__(self, machine: SVC) -> None:
        """Take a machine that is to be fitted."""
        self.machine = machine

    def fit(self, X: np.ndarray, y: np.ndarray) -> "SupportVectors":
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
class Perceptron(MLPClassifier):
    """A multilayer perceptron that is content with what its epochs have brought."""

    def fit(
        self, X: np.ndarray, y: np.ndarray, sample_weight: np.ndarray | None = None
    ) -> "Perceptron":
        """Learn from rows of features."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            return super().fit(X, y, sample_weight)


def support_vectors(seed: int, C: float = 10.0) -> Estimator:
    """A radial-basis support vector machine; errors cost `C`."""
    return SupportVectors(SVC(C=C, random_state=seed))


def nearest_neighbours(seed: int, k: int = 5) -> Estimator:
    """The `k` nearest; nothing is drawn."""
    return KNeighborsClassifier(k)


def perceptron(
    seed: int, hidden: tuple[int, ...] = (128, 64), decay: float = 1e-4
) -> Estimator:
    """A multilayer perceptron with these hidden layers."""
    return Perceptron(hidden, alpha=decay, max_iter=100, random_state=seed)


def linear_discriminant(seed: int, shrinkage: float = 0.1) -> Estimator:
    """Fisher's discriminant, its covariance drawn to a sphere a little; draws nothing.

    How much is not estimated: scikit-learn does that on standardised features, which
    makes as much of the least principal component as of the first.
    """
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=shrinkage)


def random_forest(seed: int, trees: int = 500, leaf: int = 1) -> Estimator:
    """So many trees, with leaves of at least so many rows."""
    return RandomForestClassifier(
        trees, min_samples_leaf=leaf, random_state=seed, n_jobs=1
    )


def gradient_boosting(
    seed: int, trees: int = 100, leaves: int = 15, rate: float = 0.1
) -> Estimator:
    """Small trees, each on what the last ones left over."""
    return HistGradientBoostingClassifier(
        learning_rate=rate,
        max_iter=trees,
        max_leaf_nodes=leaves,
        min_samples_leaf=5,
        random_state=seed,
    )


def standardised(
    estimator: Callable[[int], Estimator],
) -> Callable[[int], Estimator]:
    """The same on features of mean zero and variance one."""

    def make(seed: int) -> Estimator:
        return make_pipeline(StandardScaler(), estimator(seed))

    return make


ON_FEATURES: dict[str, Callable[[int], Estimator]] = {
    "random forest": random_forest,
    "SVM": standardised(support_vectors),
    "kNN": standardised(nearest_neighbours),
}
"""Those that stand beside the recogniser on hand-made features of whole segments, by
the name that tables show; each takes a seed."""
