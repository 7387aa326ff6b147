"""Whether clips give their class away by anything but the touch."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Shaped
from sklearn.ensemble import RandomForestClassifier
from sklearn.metrics import recall_score
from sklearn.model_selection import GroupKFold

from benchmarks.simulation.check import BandCheck
from benchmarks.simulation.clips import PROCESSES, Made, simulate
from benchmarks.simulation.forest import (
    FOLDS,
    TREES,
    features_of,
    labels_of,
    people_of,
)
from eskin.sim.constants import load_constants
from eskin.sim.dataset.sets import CLASSES

CHANCE = 1 / len(CLASSES)
BELOW = 0.1
"""How far histograms must stay below the features."""
SMALLEST = 10
"""Clips of a leaf: leaks are weak, and single clips teach nothing of them."""
DRAWS = 200
"""Resamples of people for an interval."""
STATED = ("electrical", "self_contact")
"""Kinds that do tell themselves before contact: an event has no contact, and links
touch only in poses where they are near each other."""


def leakage_checks(clips: int, seed: int) -> list[BandCheck]:
    """What forests make of all that is not the touch itself.

    Args:
        clips: of `train`, at the published difficulty.
        seed: of clips and forests.
    """
    made = simulate("train", clips, load_constants().value("sets.difficulty"), seed)
    early = [e for e in made if np.isfinite(e.before).all() and e.kind not in STATED]
    plain = [each for each in made if each.kind not in STATED]
    touched = [each for each in plain if np.isfinite(each.height)]
    before = np.array([each.before for each in early])
    hand = balanced(features_of(made), made, seed)[0]
    shuffled = balanced(np.array([each.histogram for each in made]), made, seed)
    return [
        at_chance(f"{len(early)} clips, readings before contact", before, early, seed),
        at_chance("joint positions", poses_of(plain), plain, seed),
        at_chance("pose group, build, moving, folds", facts_of(plain), plain, seed),
        BandCheck(
            *("link and height of the site", "near chance but for grabs: tubes"),
            *("design", said(*balanced(places_of(touched), touched, seed))),
            bool(balanced(places_of(touched), touched, seed)[0] < 2 * CHANCE),
        ),
        BandCheck(
            *("shuffled histogram of pressures", f"< features - {BELOW:.0%}", "design"),
            *(f"{said(*shuffled)}; features {hand:.1%}", shuffled[0] < hand - BELOW),
        ),
    ]


def at_chance(
    name: str, features: Float[np.ndarray, "clip f"], made: Sequence[Made], seed: int
) -> BandCheck:
    """Whether a forest is at chance, within the interval of its score."""
    score, low, high = balanced(features, made, seed)
    target = f"chance, {CHANCE:.0%}, in the interval"
    return BandCheck(
        name, target, "design", said(score, low, high), low <= CHANCE <= high
    )


def said(score: float, low: float, high: float) -> str:
    """A score in words."""
    return f"{score:.1%} ({low:.1%}-{high:.1%})"


def balanced(
    features: Float[np.ndarray, "clip f"], made: Sequence[Made], seed: int
) -> tuple[float, float, float]:
    """Mean recall of a forest, people held out, and its 95 % interval over people."""
    labels, people = labels_of(made), people_of(made)
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
    """The interval of mean recall when people are drawn again."""
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


def poses_of(made: Sequence[Made]) -> Float[np.ndarray, "clip joint"]:
    """Joint positions at the start of clips [rad]."""
    return np.array([each.q for each in made])


def facts_of(made: Sequence[Made]) -> Float[np.ndarray, "clip fact"]:
    """Pose group, build, whether the robot moves, whether two links meet, time."""
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


def places_of(made: Sequence[Made]) -> Float[np.ndarray, "clip place"]:
    """Link that was touched, one-hot, and height of the site [m]."""
    links = sorted({each.link for each in made})
    return np.array(
        [[each.height, *(each.link == link for link in links)] for each in made],
        dtype=np.float64,
    )
