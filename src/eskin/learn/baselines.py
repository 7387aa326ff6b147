"""Classical classifiers on hand-made features."""

from collections.abc import Callable

from sklearn.ensemble import RandomForestClassifier
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

Classifier = RandomForestClassifier | Pipeline


def random_forest(seed: int) -> Classifier:
    """500 trees."""
    return RandomForestClassifier(500, random_state=seed, n_jobs=1)


def support_vectors(seed: int) -> Classifier:
    """A radial-basis support vector machine on standardised features."""
    return make_pipeline(StandardScaler(), SVC(C=10.0, random_state=seed))


def nearest_neighbours(seed: int) -> Classifier:
    """The five nearest in standardised features."""
    return make_pipeline(StandardScaler(), KNeighborsClassifier(5))


BASELINES: dict[str, Callable[[int], Classifier]] = {
    "random forest": random_forest,
    "SVM": support_vectors,
    "kNN": nearest_neighbours,
}
"""By the name that tables show; each takes a seed."""
