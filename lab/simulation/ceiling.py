"""Estimate the highest possible accuracy by a classifier of the true touches."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier
from threadpoolctl import threadpool_limits

from eskin.sim.constants import load_constants
from lab.simulation.clips import PROCESSES, ClipSummary, simulate
from lab.simulation.forest import TREES, list_labels
from lab.simulation.true_features import true_features

TESTS = ("test-s", "test-p", "test-x", "test-m")
"""Sets for which the bound is computed."""

Z = 1.959964
"""Standard deviations from the mean that hold 95 % of a normal distribution."""


def ceiling_tables(clips: int, seed: int) -> str:
    """Format the bound on each test set at the published difficulty, in Markdown.

    Args:
        clips: number of clips for training; a third as many of each test set.
        seed: seed of clips and classifiers.
    """
    level = load_constants().value("sets.difficulty")
    bound = Bound(simulate("train", clips, level, seed), seed)
    names = bound.names
    rows = [
        f"\n**Ceiling at lambda {level:g}: boosted trees on true force, area and "
        "centroid**\n",
        f"{clips} clips of `train`, {clips // 3} of each test set.\n",
        f"| set | accuracy (95 % interval) | recall: {' | '.join(names)} |",
        "|---" * (len(names) + 2) + "|",
    ]
    for name in TESTS:
        made = simulate(name, clips // 3, level, seed)
        right = bound.guess(made) == list_labels(made)
        recalls = [right[list_labels(made) == label].mean() for label in names]
        cells = " | ".join(f"{recall:.1%}" for recall in recalls)
        low, high = wilson_interval(int(right.sum()), len(right))
        rows.append(f"| {name} | {right.mean():.1%} ({low:.1%}-{high:.1%}) | {cells} |")
    return "\n".join(rows)


class Bound:
    """Classifies clips by their true series, with boosted and random trees."""

    def __init__(self, made: Sequence[ClipSummary], seed: int) -> None:
        """Train the classifiers."""
        boosted = HistGradientBoostingClassifier(
            max_iter=300,
            learning_rate=0.05,
            max_leaf_nodes=15,
            l2_regularization=1.0,
            max_features=0.3,
            random_state=seed,
        )
        trees = ExtraTreesClassifier(TREES, random_state=seed, n_jobs=PROCESSES)
        features, labels = stack_true_features(made), list_labels(made)
        with threadpool_limits(1):  # OpenMP's threads wait busily for each other
            self.models = [model.fit(features, labels) for model in (boosted, trees)]
        self.names = [str(name) for name in self.models[0].classes_]

    def guess(self, made: Sequence[ClipSummary]) -> np.ndarray:
        """Return the class of each clip, by the mean of both classifiers."""
        features = stack_true_features(made)
        probabilities = np.mean(
            [m.predict_proba(features) for m in self.models], axis=0
        )
        return np.array(self.names)[probabilities.argmax(axis=1)]


def stack_true_features(
    made: Sequence[ClipSummary],
) -> Float[np.ndarray, "clip feature"]:
    """Return the true features of clips."""
    return np.array([true_features(each.truth) for each in made])


def wilson_interval(correct: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share of independent examples (Wilson 1927).

    Args:
        correct: number of examples classified correctly.
        count: number of examples; at least one.
    """
    share, weight = correct / count, Z**2 / count
    middle = share + weight / 2
    spread = Z * np.sqrt((share * (1 - share) + weight / 4) / count)
    low, high = (middle - spread) / (1 + weight), (middle + spread) / (1 + weight)
    return max(float(low), 0.0), min(float(high), 1.0)
