"""Scores: accuracy, macro F1, per class, per person, calibration, intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

RESAMPLES = 10_000
BINS = 15


@dataclass(frozen=True)
class Score:
    """How well a list of predictions fits the truth."""

    accuracy: float
    """Share of right answers."""

    macro_f1: float
    """Mean F1 over the classes that occur in the truth."""

    per_class: dict[str, dict[str, float]]
    """Precision, recall, F1 and number of examples of each class."""

    confusion: Int[np.ndarray, "true predicted"]
    """Counts."""


def score(
    truth: Int[np.ndarray, "example"],
    predicted: Int[np.ndarray, "example"],
    vocabulary: Sequence[str],
) -> Score:
    """Score predictions against the truth."""
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
    return Score(
        accuracy=float(hits.sum() / max(len(truth), 1)),
        macro_f1=float(f1[support > 0].mean()) if len(truth) else 0.0,
        per_class=per_class,
        confusion=confusion,
    )


def by_group(
    right: Bool[np.ndarray, "example"], groups: Sequence[str]
) -> dict[str, float]:
    """Accuracy of each group, such as each person."""
    names = np.asarray(groups)
    return {str(g): float(right[names == g].mean()) for g in np.unique(names)}


def calibration_error(
    confidence: Float[np.ndarray, "example"], right: Bool[np.ndarray, "example"]
) -> float:
    """Expected calibration error over 15 equal bins (Guo et al. 2017, eq. 3)."""
    bins = np.minimum((confidence * BINS).astype(np.int64), BINS - 1)
    gaps = np.bincount(bins, confidence - right, BINS)
    return float(np.abs(gaps).sum() / max(len(right), 1))


def paired_interval(
    ours: Bool[np.ndarray, "example"],
    theirs: Bool[np.ndarray, "example"],
    seed: int = 0,
    cluster: Sequence[int] | None = None,
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
    _, index, counts = np.unique(members, return_inverse=True, return_counts=True)
    gains = np.bincount(index, difference)
    rng = np.random.default_rng(seed)
    draws = rng.integers(len(counts), size=(RESAMPLES, len(counts)))
    means = gains[draws].sum(axis=1) / counts[draws].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
