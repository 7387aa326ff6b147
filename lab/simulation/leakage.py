"""Test whether anything but the touch predicts the class of a clip."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Shaped
from sklearn.ensemble import RandomForestClassifier
from sklearn.metrics import recall_score
from sklearn.model_selection import GroupKFold

from eskin.sim.constants import load_constants
from eskin.sim.dataset.sets import CLASSES
from lab.simulation.check import BandCheck
from lab.simulation.clips import PROCESSES, ClipSummary, simulate
from lab.simulation.forest import (
    FOLDS,
    TREES,
    list_labels,
    list_people,
    stack_features,
)

CHANCE = 1 / len(CLASSES)
BELOW = 0.1
"""Least difference of the recall of histograms from that of features."""
SMALLEST = 10
"""Clips per leaf: leaks are weak, and do not show in single clips."""
DRAWS = 200
"""Number of resamples of people for an interval."""
STATED = ("electrical", "self_contact")
"""Kinds that are predictable before contact: electrical events have no contact, and
links touch each other only in poses where they are close."""


def leakage_checks(clips: int, seed: int) -> list[BandCheck]:
    """Check the accuracy of forests on everything but the touch.

    Args:
        clips: number of clips of `train`, at the published difficulty.
        seed: seed of clips and forests.
    """
    made = simulate("train", clips, load_constants().value("sets.difficulty"), seed)
    early = [e for e in made if np.isfinite(e.before).all() and e.kind not in STATED]
    plain = [each for each in made if each.kind not in STATED]
    touched = [each for each in plain if np.isfinite(each.height)]
    before = np.array([each.before for each in early])
    hand = measure_recall(stack_features(made), made, seed)[0]
    shuffled = measure_recall(np.array([each.histogram for each in made]), made, seed)
    placed = measure_recall(stack_places(touched), touched, seed)
    return [
        at_chance(f"{len(early)} clips, readings before contact", before, early, seed),
        at_chance("joint positions", stack_poses(plain), plain, seed),
        at_chance(
            "pose group, build, moving, folds", stack_scene_facts(plain), plain, seed
        ),
        BandCheck(
            name="link and height of the site",
            target="near chance but for grabs: tubes",
            source="design",
            measured=format_score(*placed),
            met=placed[0] < 2 * CHANCE,
        ),
        BandCheck(
            name="shuffled histogram of pressures",
            target=f"< features - {BELOW:.0%}",
            source="design",
            measured=f"{format_score(*shuffled)}; features {hand:.1%}",
            met=shuffled[0] < hand - BELOW,
        ),
    ]


def at_chance(
    name: str,
    features: Float[np.ndarray, "clip f"],
    made: Sequence[ClipSummary],
    seed: int,
) -> BandCheck:
    """Check that chance lies in the confidence interval of a forest."""
    score, low, high = measure_recall(features, made, seed)
    target = f"chance, {CHANCE:.0%}, in the interval"
    return BandCheck(
        name, target, "design", format_score(score, low, high), low <= CHANCE <= high
    )


def format_score(score: float, low: float, high: float) -> str:
    """Format a score and its interval."""
    return f"{score:.1%} ({low:.1%}-{high:.1%})"


def measure_recall(
    features: Float[np.ndarray, "clip f"], made: Sequence[ClipSummary], seed: int
) -> tuple[float, float, float]:
    """Return the mean recall of a forest on held-out people, and its 95 % interval."""
    labels, people = list_labels(made), list_people(made)
    guess = np.empty_like(labels)
    folds = GroupKFold(min(FOLDS, len(set(people))))
    for rest, out in folds.split(features, labels, people):
        forest = RandomForestClassifier(
            TREES,
            min_samples_leaf=SMALLEST,
            class_weight="balanced",
            random_state=seed,
            n_jobs=PROCESSES,
        ).fit(features[rest], labels[rest])
        guess[out] = forest.predict(features[out])
    low, high = over_people(labels, guess, people, seed)
    return float(recall_score(labels, guess, average="macro")), low, high


def over_people(
    labels: Shaped[np.ndarray, "clip"],
    guess: Shaped[np.ndarray, "clip"],
    people: Shaped[np.ndarray, "clip"],
    seed: int,
) -> tuple[float, float]:
    """Return the bootstrap interval of the mean recall over people."""
    rng = np.random.default_rng(seed)
    own = [np.flatnonzero(people == person) for person in np.unique(people)]
    scores = []
    for _ in range(DRAWS):
        drawn = np.concatenate([own[i] for i in rng.integers(len(own), size=len(own))])
        right = labels[drawn] == guess[drawn]
        present = np.unique(labels[drawn])
        scores.append(np.mean([right[labels[drawn] == c].mean() for c in present]))
    low, high = np.quantile(scores, [0.025, 0.975])
    return float(low), float(high)


def stack_poses(made: Sequence[ClipSummary]) -> Float[np.ndarray, "clip joint"]:
    """Return joint positions at the start of clips [rad]."""
    return np.array([each.q for each in made])


def stack_scene_facts(made: Sequence[ClipSummary]) -> Float[np.ndarray, "clip fact"]:
    """Return pose group, build, motion, fold and time of clips."""
    builds = sorted({each.plan.build.name for each in made})
    return np.array(
        [
            [
                each.pose_group,
                builds.index(each.plan.build.name),
                each.plan.moving,
                each.folded,
                each.plan.at,
            ]
            for each in made
        ],
        dtype=np.float64,
    )


def stack_places(made: Sequence[ClipSummary]) -> Float[np.ndarray, "clip place"]:
    """Return the height of the site [m], and the touched link, one-hot."""
    links = sorted({each.link for each in made})
    return np.array(
        [[each.height, *(each.link == link for link in links)] for each in made],
        dtype=np.float64,
    )
