"""Measure the difficulty of clips for a random forest of fifteen plain features."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped
from sklearn.ensemble import RandomForestClassifier
from sklearn.model_selection import GroupKFold

from eskin.sim.dataset.sets import PAPER_GESTURES
from lab.simulation.clips import PROCESSES, ClipSummary, simulate

LEVELS = (0.0, 1.0, 1.5, 2.0)
"""Values of the difficulty."""
TREES = 500
FOLDS = 6
"""Number of folds of people."""
NEW = "test-x"
"""Set of new people on builds that have aged."""

Names = Shaped[np.ndarray, "clip"]


@dataclass(frozen=True, eq=False)
class Spread:
    """Holds the distribution of the accuracy over people."""

    mean: float
    """Mean accuracy over people."""
    deviation: float
    """Standard deviation between people."""
    beyond: float
    """Standard deviation beyond the chance of counting few clips."""
    low: float
    """Accuracy of the person with the lowest one."""
    high: float
    """Accuracy of the person with the highest one."""


def difficulty_tables(clips: int, seed: int) -> str:
    """Format the accuracy of the forest at every difficulty, as a table in Markdown.

    Args:
        clips: number of clips of known people on fresh builds; a third as many of new.
        seed: seed of clips and forests.
    """
    rows = [
        "\n**Difficulty, to a forest of 15 features**\n",
        f"{clips} clips of `train`, whole people held out; {clips // 3} of `{NEW}`. "
        "People: mean (SD; SD beyond the chance of counting) lowest-highest.\n",
        "| lambda | five classes | people | four classes | new people, aged builds |",
        "|---|---|---|---|---|",
    ]
    rows += [difficulty_row(level, clips, seed) for level in LEVELS]
    return "\n".join(rows)


def difficulty_row(level: float, clips: int, seed: int) -> str:
    """Format the accuracy of the forest at one difficulty."""
    made = simulate("train", clips, level, seed)
    new = simulate(NEW, clips // 3, level, seed)
    guess, labels = held_out(made, seed), list_labels(made)
    people = compute_spread(guess == labels, list_people(made))
    four = [each for each in made if each.label in PAPER_GESTURES]
    right = np.mean(held_out(four, seed) == list_labels(four))
    shifted = grow(made, seed).predict(stack_features(new)) == list_labels(new)
    return (
        f"| {level:g} | {np.mean(guess == labels):.1%} | {people.mean:.1%} "
        f"({100 * people.deviation:.1f}; {100 * people.beyond:.1f}) "
        f"{people.low:.0%}-{people.high:.0%} | {right:.1%} | {shifted.mean():.1%} |"
    )


def stack_features(made: Sequence[ClipSummary]) -> Float[np.ndarray, "clip feature"]:
    """Return the features of clips."""
    return np.array([each.features for each in made])


def list_labels(made: Sequence[ClipSummary]) -> Names:
    """Return the classes of clips."""
    return np.array([each.label for each in made])


def list_people(made: Sequence[ClipSummary]) -> Names:
    """Return the names of the people in clips."""
    return np.array([each.plan.person.name for each in made])


def forest(seed: int) -> RandomForestClassifier:
    """Build an untrained forest."""
    return RandomForestClassifier(TREES, random_state=seed, n_jobs=PROCESSES)


def grow(made: Sequence[ClipSummary], seed: int) -> RandomForestClassifier:
    """Train a forest on clips."""
    return forest(seed).fit(stack_features(made), list_labels(made))


def held_out(made: Sequence[ClipSummary], seed: int) -> Names:
    """Predict each clip by a forest trained on other people."""
    features, labels, people = (
        stack_features(made),
        list_labels(made),
        list_people(made),
    )
    guess = np.empty_like(labels)
    folds = min(FOLDS, len(set(people)))
    for rest, out in GroupKFold(folds).split(features, labels, people):
        grown = forest(seed).fit(features[rest], labels[rest])
        guess[out] = grown.predict(features[out])
    return guess


def compute_spread(right: Shaped[np.ndarray, "clip"], people: Names) -> Spread:
    """Compute the distribution of the accuracy over people."""
    own = [right[people == person] for person in np.unique(people)]
    shares = np.array([each.mean() for each in own])
    counting = np.mean([each.var() / len(each) for each in own])
    return Spread(
        mean=float(shares.mean()),
        deviation=float(shares.std()),
        beyond=float(np.sqrt(max(shares.var() - counting, 0.0))),
        low=float(shares.min()),
        high=float(shares.max()),
    )
