"""Measure the confusions of a random forest, with whole people held out."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int, Shaped
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from eskin.sim.constants import load_constants
from eskin.sim.dataset.sets import CLASSES
from lab.simulation.check import BandCheck, at_most, within
from lab.simulation.clips import TAP, ClipSummary, simulate
from lab.simulation.features import NAMES
from lab.simulation.forest import (
    FOLDS,
    compute_spread,
    held_out,
    list_labels,
    list_people,
    stack_features,
)

SOURCE = "expected"
COST = "Jung et al. 2017"
MORE = ("squeeze", "rub", TAP)
"""Classes of CoST that are not in the vocabulary."""
PAIRS = ({"grab", "squeeze"}, {"stroke", "rub"}, {"double_pat", TAP})
"""Pairs of these classes that were confused most in CoST."""
PLAIN = ("seconds", "peak force", "most taxels")
"""Features of the linear probe."""


def confusion_tables(clips: int, seed: int) -> tuple[str, list[BandCheck]]:
    """Return two tables of confusions at the published difficulty, and their checks.

    Args:
        clips: number of clips of each table.
        seed: seed of clips and forests.
    """
    level = load_constants().value("sets.difficulty")
    made = simulate("train", clips, level, seed)
    more = simulate("train", clips, level, seed, (*CLASSES, *MORE))
    one, two = held_out(made, seed), held_out(more, seed)
    checks = [
        *expected(list_labels(made), one),
        per_person(made, one),
        at_most(
            "linear probe of duration, force, area",
            measure_linear_probe(made),
            0.8,
            SOURCE,
        ),
        pairs_check(list_labels(more), two),
    ]
    tables = [matrix(list_labels(made), one), matrix(list_labels(more), two)]
    return "\n".join(tables), checks


def expected(labels: Shaped[np.ndarray, "clip"], guess: np.ndarray) -> list[BandCheck]:
    """Check the confusions of `none`, and the order of the gestures by recall."""
    counts = counted(labels, guess)
    names = sorted(set(labels))
    lost = counts[names.index("none")].astype(float)
    lost[names.index("none")] = 0.0
    order = [names[i] for i in lost.argsort()[::-1][:2]]
    recall = dict(zip(names, np.diag(counts) / counts.sum(axis=1), strict=True))
    ranks = [name for name in sorted(recall, key=lambda n: recall[n]) if name != "none"]
    measured = ", ".join(f"{name} {recall[name]:.1%}" for name in ranks)
    return [
        BandCheck(
            name="`none` is confused most with",
            target="poke and double_pat",
            source=SOURCE,
            measured=" and ".join(order),
            met=set(order) == {"poke", "double_pat"},
        ),
        BandCheck(
            name="gestures by recall",
            target="double_pat and poke least, grab most",
            source=SOURCE,
            measured=measured,
            met=set(ranks[:2]) == {"double_pat", "poke"} and ranks[-1] == "grab",
        ),
    ]


def per_person(made: Sequence[ClipSummary], guess: np.ndarray) -> BandCheck:
    """Check the spread of the accuracy between people."""
    found = compute_spread(guess == list_labels(made), list_people(made))
    name = f"SD between people ({100 * found.beyond:.1f} beyond the chance of counting)"
    return within(name, 100 * found.deviation, 4.0, 11.0, COST, "points")


def measure_linear_probe(made: Sequence[ClipSummary]) -> float:
    """Return the accuracy of a linear model of three plain features."""
    columns = [NAMES.index(name) for name in PLAIN]
    chosen = np.log(stack_features(made)[:, columns] + [0.02, 0.1, 1.0])
    model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))
    groups = list_people(made)
    folds = GroupKFold(min(FOLDS, len(set(groups))))
    guess = cross_val_predict(model, chosen, list_labels(made), groups=groups, cv=folds)
    return float(np.mean(guess == list_labels(made)))


def pairs_check(labels: Shaped[np.ndarray, "clip"], guess: np.ndarray) -> BandCheck:
    """Check the pairs of gestures that are confused most, both ways."""
    counts = counted(labels, guess)
    names = sorted(set(labels))
    both = {
        (names[i], names[j]): int(counts[i, j] + counts[j, i])
        for i in range(len(names))
        for j in range(i)
        if "none" not in (names[i], names[j])
    }
    top = sorted(both, key=lambda pair: -both[pair])[:4]
    measured = ", ".join(f"{a}-{b} {both[a, b]}" for a, b in top)
    met = all(set(pair) in PAIRS for pair in top[:3])
    wanted = "grab-squeeze, stroke-rub, double_pat-tap"
    return BandCheck("pairs of gestures confused most", wanted, COST, measured, met)


def counted(
    labels: Shaped[np.ndarray, "clip"], guess: np.ndarray
) -> Int[np.ndarray, "label guess"]:
    """Count the confusions of each pair of classes."""
    names = sorted(set(labels))
    return np.array(
        [[np.sum((labels == a) & (guess == b)) for b in names] for a in names]
    )


def matrix(labels: Shaped[np.ndarray, "clip"], guess: np.ndarray) -> str:
    """Format the confusions as a table in Markdown."""
    names, counts = sorted(set(labels)), counted(labels, guess)
    shares = 100 * counts / counts.sum(axis=1, keepdims=True)
    rows = [
        "\n**Confusions, per cent of each row**\n",
        f"| | {' | '.join(names)} |",
        "|---" * (len(names) + 1) + "|",
    ]
    rows += [
        f"| {name} | {' | '.join(f'{share:.1f}' for share in row)} |"
        for name, row in zip(names, shares, strict=True)
    ]
    return "\n".join(rows)
