"""This module computes scores: accuracy, F1, calibration and confidence intervals."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.special import gammaincinv, ndtri, stdtrit

RESAMPLES = 10_000
"""Number of bootstrap draws."""
TAIL = 0.025
"""Share of each end outside a confidence interval."""

MANY_CLUSTERS = 20
"""Number of clusters from which drawing them anew gives an interval that holds the
truth nearly as often as it says; of five it is four times in five."""

RELIABILITY_BINS = 15


@dataclass(frozen=True)
class ClassificationScore:
    """A classification score compares predictions with the truth."""

    accuracy: float
    """Share of correct predictions."""
    macro_f1: float
    """Mean F1 over the classes that occur in the truth."""
    per_class: dict[str, dict[str, float]]
    """Precision, recall, F1 and number of examples of each class."""
    confusion: Int[np.ndarray, "true predicted"]
    """Number of examples by true and by predicted class."""

    def label_confusion(self) -> Any:  # noqa: ANN401
        """Return the confusion with the names of its classes, as `label_counts`."""
        return label_counts(self.confusion, tuple(self.per_class))


def label_counts(
    confusion: Int[np.ndarray, "true predicted"], names: Sequence[str]
) -> Any:  # noqa: ANN401
    """Return a confusion with a row a true and a column a predicted class.

    It is a `pandas.DataFrame` where pandas is installed, else a dictionary of rows,
    each a dictionary of counts, by the names of the classes.
    """
    if find_spec("pandas") is not None:
        pandas = import_module("pandas")
        return pandas.DataFrame(
            confusion,
            pandas.Index(names, name="true"),
            pandas.Index(names, name="predicted"),
        )
    return {
        name: dict(zip(names, row, strict=True))
        for name, row in zip(names, confusion.tolist(), strict=True)
    }


def score_predictions(
    truth: Int[np.ndarray, "example"],
    predicted: Int[np.ndarray, "example"],
    vocabulary: Sequence[str],
) -> ClassificationScore:
    """Compare predictions with the truth."""
    size = len(vocabulary)
    confusion = np.zeros((size, size), dtype=np.int64)
    np.add.at(confusion, (truth, predicted), 1)
    hits = np.diag(confusion)
    support = confusion.sum(axis=1)
    precision = hits / np.maximum(confusion.sum(axis=0), 1)
    recall = hits / np.maximum(support, 1)
    f1 = 2 * precision * recall / np.maximum(precision + recall, 1e-12)
    columns = {"precision": precision, "recall": recall, "f1": f1, "count": support}
    per_class = {
        name: {key: round(float(v[i]), 4) for key, v in columns.items()}
        for i, name in enumerate(vocabulary)
    }
    return ClassificationScore(
        accuracy=float(hits.sum() / max(len(truth), 1)),
        macro_f1=float(f1[support > 0].mean()) if len(truth) else 0.0,
        per_class=per_class,
        confusion=confusion,
    )


def compute_group_accuracies(
    correct: Bool[np.ndarray, "example"], groups: Sequence[str]
) -> dict[str, float]:
    """Return the accuracy of each group, such as each person."""
    names = np.asarray(groups)
    return {str(g): float(correct[names == g].mean()) for g in np.unique(names)}


@dataclass(frozen=True, eq=False)
class Reliability:
    """Reliability holds the accuracy of predictions in 15 equal bins of confidence."""

    count: Int[np.ndarray, "bin"]
    """Number of predictions in each bin."""
    confidence: Float[np.ndarray, "bin"]
    """Mean confidence of each bin; zero where it is empty."""
    accuracy: Float[np.ndarray, "bin"]
    """Accuracy of each bin; zero where it is empty."""

    @property
    def error(self) -> float:
        """Return the expected calibration error (Guo et al. 2017, eq. 3)."""
        gaps = self.count * np.abs(self.confidence - self.accuracy)
        return float(gaps.sum() / max(self.count.sum(), 1))


def compute_reliability(
    confidence: Float[np.ndarray, "example"], correct: Bool[np.ndarray, "example"]
) -> Reliability:
    """Return the accuracy of predictions by their confidence."""
    bins = np.minimum(
        (confidence * RELIABILITY_BINS).astype(np.int64), RELIABILITY_BINS - 1
    )
    count = np.bincount(bins, minlength=RELIABILITY_BINS)
    some = np.maximum(count, 1)
    return Reliability(
        count=count,
        confidence=np.bincount(bins, confidence, RELIABILITY_BINS) / some,
        accuracy=np.bincount(bins, correct, RELIABILITY_BINS) / some,
    )


def bootstrap_difference(
    ours: Bool[np.ndarray, "example"],
    theirs: Bool[np.ndarray, "example"],
    seed: int = 0,
    cluster: Sequence[int] | Sequence[str] | None = None,
) -> tuple[float, float]:
    """Return a 95 % confidence interval of the difference in accuracy, paired.

    Args:
        ours: which examples one method classified correctly.
        theirs: which of the same examples the other one did.
        seed: seed of the draws.
        cluster: cluster of each example, such as its recording, where examples of a
            cluster are not independent; whole clusters are drawn.
    """
    difference = ours.astype(np.float64) - theirs
    members = np.arange(len(difference)) if cluster is None else np.asarray(cluster)
    return bootstrap_mean(difference, members, seed)


def bootstrap_accuracy(
    correct: Bool[np.ndarray, "example"], cluster: Sequence[str], seed: int = 0
) -> tuple[float, float]:
    """Return a 95 % confidence interval of an accuracy, from clusters drawn anew.

    Args:
        correct: which examples were classified correctly.
        cluster: cluster of each example, such as a person; whole clusters are drawn.
        seed: seed of the draws.
    """
    return bootstrap_mean(correct.astype(np.float64), np.asarray(cluster), seed)


def bound_accuracy(
    correct: Bool[np.ndarray, "example"], cluster: Sequence[str]
) -> tuple[float, float]:
    """Return a 95 % confidence interval of an accuracy on further clusters.

    Clusters are drawn anew where they are many and not all alike. Of few the interval
    is that of a share (Wilson 1927) of as many examples as would be as uncertain if
    they were independent, at most all, with the quantile of Student's t in place of the
    normal one (Korn and Graubard 1998). It is NaN of one cluster, which does not show
    how others differ.

    Args:
        correct: which examples were classified correctly.
        cluster: cluster of each example, such as a person.
    """
    names, index, sizes = np.unique(cluster, return_inverse=True, return_counts=True)
    count = len(names)
    if count < 2:
        return float("nan"), float("nan")
    if count >= MANY_CLUSTERS:
        low, high = bootstrap_accuracy(correct, cluster)
        if low < high:
            return low, high
    share = float(correct.mean())
    errors = np.bincount(index, correct) - share * sizes
    variance = count / (count - 1) * float((errors**2).sum()) / len(correct) ** 2
    independent = share * (1 - share) / len(correct)
    excess = max(1.0, variance / independent) if independent > 0 else 1.0
    z = float(stdtrit(count - 1, 1 - TAIL))
    return bound_mean_share(share, len(correct) / excess, z)


def bootstrap_mean(
    values: Float[np.ndarray, "example"],
    members: Shaped[np.ndarray, "example"],
    seed: int,
) -> tuple[float, float]:
    """Return a 95 % bootstrap interval of a mean; whole clusters are drawn."""
    _, index, counts = np.unique(members, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(index, values), counts.astype(np.float64)], axis=1)
    total, count = resample_clusters(sums, seed).T
    low, high = np.percentile(total / count, [2.5, 97.5])
    return float(low), float(high)


def resample_clusters(
    sums: Float[np.ndarray, "cluster column"], seed: int
) -> Float[np.ndarray, "draw column"]:
    """Return sums over as many clusters as there are, drawn with replacement."""
    rng = np.random.default_rng(seed)
    draws = rng.integers(len(sums), size=(RESAMPLES, len(sums)))
    return np.stack([column[draws].sum(axis=1) for column in sums.T], axis=1)


def bound_rate(count: int, time: float) -> tuple[float, float]:
    """Return the 95 % interval of the rate of a Poisson count (Garwood 1936).

    It is in units of one over those of `time`, and NaN without time.
    """
    if not time:
        return float("nan"), float("nan")
    low = float(gammaincinv(count, TAIL)) if count else 0.0
    return low / time, float(gammaincinv(count + 1, 1 - TAIL)) / time


def bound_share(count: int, whole: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927); NaN where it is of none."""
    if not whole:
        return float("nan"), float("nan")
    return bound_mean_share(count / whole, float(whole), float(ndtri(1 - TAIL)))


def bound_mean_share(share: float, whole: float, z: float) -> tuple[float, float]:
    """Return the interval of a share of so many examples within z deviations."""
    middle = share + z**2 / (2 * whole)
    half = z * float(np.sqrt(share * (1 - share) / whole + (z / (2 * whole)) ** 2))
    scale = 1 + z**2 / whole
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)
