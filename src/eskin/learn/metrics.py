"""Scores: accuracy, macro F1, per class, per person, calibration, intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

RESAMPLES = 10_000
BINS = 15

Z = 1.959964
"""Deviations from the mean that hold 95 % of a normal distribution."""


@dataclass(frozen=True)
class ClassificationScore:
    """How well a list of predictions fits the truth."""

    accuracy: float
    """Share of right answers."""

    macro_f1: float
    """Mean F1 over the classes that occur in the truth."""

    per_class: dict[str, dict[str, float]]
    """Precision, recall, F1 and number of examples of each class."""

    confusion: Int[np.ndarray, "true predicted"]
    """Counts."""


def score_predictions(
    truth: Int[np.ndarray, "example"],
    predicted: Int[np.ndarray, "example"],
    vocabulary: Sequence[str],
) -> ClassificationScore:
    """ClassificationScore predictions against the truth."""
    size = len(vocabulary)
    confusion = np.zeros((size, size), dtype=np.int64)
    np.add.at(confusion, (truth, predicted), 1)
    hits, support = np.diag(confusion), confusion.sum(axis=1)
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
    right: Bool[np.ndarray, "example"], groups: Sequence[str]
) -> dict[str, float]:
    """Accuracy of each group, such as each person."""
    names = np.asarray(groups)
    return {str(g): float(right[names == g].mean()) for g in np.unique(names)}


@dataclass(frozen=True, eq=False)
class Reliability:
    """How often answers are right, by how sure they were, in 15 equal bins."""

    count: Int[np.ndarray, "bin"]
    """Answers in each bin."""

    confidence: Float[np.ndarray, "bin"]
    """Their mean confidence; zero where there is none."""

    accuracy: Float[np.ndarray, "bin"]
    """Share of them that is right; zero where there is none."""

    @property
    def error(self) -> float:
        """Expected calibration error (Guo et al. 2017, eq. 3)."""
        gaps = self.count * np.abs(self.confidence - self.accuracy)
        return float(gaps.sum() / max(self.count.sum(), 1))


def compute_reliability(
    confidence: Float[np.ndarray, "example"], right: Bool[np.ndarray, "example"]
) -> Reliability:
    """How often answers are right, by how sure they were."""
    bins = np.minimum((confidence * BINS).astype(np.int64), BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    some = np.maximum(count, 1)
    return Reliability(
        count=count,
        confidence=np.bincount(bins, confidence, BINS) / some,
        accuracy=np.bincount(bins, right, BINS) / some,
    )


def bootstrap_difference(
    ours: Bool[np.ndarray, "example"],
    theirs: Bool[np.ndarray, "example"],
    seed: int = 0,
    cluster: Sequence[int] | Sequence[str] | None = None,
) -> tuple[float, float]:
    """95 % bootstrap interval of the difference in accuracy on the same examples.

    Args:
        ours: which examples one method got right.
        theirs: which the other one did.
        seed: decides the draws.
        cluster: what each example is of, such as its recording, where examples of one
            are not independent; whole clusters are drawn then.
    """
    difference = ours.astype(np.float64) - theirs
    members = np.arange(len(difference)) if cluster is None else np.asarray(cluster)
    return bootstrap_mean(difference, members, seed)


def bootstrap_accuracy(
    right: Bool[np.ndarray, "example"], cluster: Sequence[str], seed: int = 0
) -> tuple[float, float]:
    """95 % bootstrap interval of an accuracy, for other people than these.

    Args:
        right: which examples were got right.
        cluster: what each example is of, such as a person; whole clusters are drawn.
        seed: decides the draws.
    """
    return bootstrap_mean(right.astype(np.float64), np.asarray(cluster), seed)


def wilson_interval(right: int, count: int) -> tuple[float, float]:
    """95 % interval of a share of independent examples (Wilson 1927).

    Args:
        right: how many were got right.
        count: of how many; at least one.
    """
    share, weight = right / count, Z**2 / count
    middle = share + weight / 2
    spread = Z * np.sqrt((share * (1 - share) + weight / 4) / count)
    low, high = (middle - spread) / (1 + weight), (middle + spread) / (1 + weight)
    return max(float(low), 0.0), min(float(high), 1.0)


def bootstrap_mean(
    values: Float[np.ndarray, "example"],
    members: Shaped[np.ndarray, "example"],
    seed: int,
) -> tuple[float, float]:
    """95 % bootstrap interval of a mean, whole clusters drawn anew."""
    _, index, counts = np.unique(members, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(index, values), counts.astype(np.float64)], axis=1)
    total, count = resample_clusters(sums, seed).T
    low, high = np.percentile(total / count, [2.5, 97.5])
    return float(low), float(high)


def resample_clusters(
    sums: Float[np.ndarray, "cluster column"], seed: int
) -> Float[np.ndarray, "draw column"]:
    """Sums over as many clusters as there are, drawn with replacement, many times."""
    rng = np.random.default_rng(seed)
    draws = rng.integers(len(sums), size=(RESAMPLES, len(sums)))
    return np.stack([column[draws].sum(axis=1) for column in sums.T], axis=1)
