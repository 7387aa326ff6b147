"""Compare settings of each method, to choose those of `eskin compare`.

python -m lab.tuning --sets FOLDER [--methods ...]: four settings of every
method, and six of the paper's network, are evaluated on the held-out people of two
paper-size sets (seeds 100 and 101) that no table uses. `eskin compare` uses the best of
each. FOLDER holds the sets and prepared clips; answers are kept in
`lab/kept/tuning.jsonl`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import tyro

from eskin.learn.batches import AugmentConfig
from eskin.live import NetworkConfig
from lab.baselines import NETWORKS, FitConfig
from lab.baselines.estimators import (
    Estimator,
    GradientBoosting,
    LinearDiscriminant,
    NearestNeighbours,
    Perceptron,
    RandomForest,
    SupportVectors,
)
from lab.baselines.flat import Features, FlatBaseline
from lab.baselines.hand import HandBaseline
from lab.compare import train_all
from lab.comparison import (
    BaselineMethod,
    Examples,
    Method,
    RecogniserMethod,
    TrainingTask,
    find_examples,
)
from lab.comparison.methods import (
    FOR_SMALL_SETS,
    TouchTrees,
    build_network_method,
)
from lab.crossvalidation import Standardised
from lab.simulated_sets import made_set

SEEDS = (100, 101)
RESULTS = Path("lab/kept/tuning.jsonl")
GENTLE = AugmentConfig(
    gain=0.15,
    taxel_gain=0.05,
    dead=0.03,
    offset=0.25,
    crop=0.0,
    stretch=0.1,
    lost=0.3,
    halved=0.1,
    patch=0.05,
    noise=0.02,
)
"""Augmentation used to train the weights that come with eskin."""
FEATURES: dict[str, Features] = {"max": "maxima", "bins": "bins"}
FLAT: dict[str, dict[str, Callable[[int], Estimator]]] = {
    "svm": {
        "C = 1": SupportVectors(C=1.0),
        "C = 10": SupportVectors(),
        "C = 100": SupportVectors(C=100.0),
        "C = 10, standardised": Standardised(SupportVectors()),
    },
    "knn": {
        "k = 1": NearestNeighbours(k=1),
        "k = 5": NearestNeighbours(),
        "k = 15": NearestNeighbours(k=15),
        "k = 5, standardised": Standardised(NearestNeighbours()),
    },
    "mlp": {
        "128, 64": Perceptron(),
        "512": Perceptron(hidden=(512,)),
        "128, 64, decay 0.1": Perceptron(decay=0.1),
        "128, 64, standardised": Standardised(Perceptron()),
    },
    "lda": {
        f"shrinkage {share}": LinearDiscriminant(share)
        for share in (0.1, 0.3, 0.6, 0.9)
    },
}
HAND: dict[str, dict[str, Callable[[int], Estimator]]] = {
    "random-forest": {
        "500 trees": RandomForest(),
        "1000 trees": RandomForest(trees=1000),
        "500 trees, leaves of 3": RandomForest(leaf=3),
        "500 trees, leaves of 5": RandomForest(leaf=5),
    },
    "gradient-boosting": {
        "100 trees of 15 leaves": GradientBoosting(),
        "100 trees of 7": GradientBoosting(leaves=7),
        "300 trees of 7, rate 0.05": GradientBoosting(trees=300, leaves=7, rate=0.05),
        "100 trees of 31": GradientBoosting(leaves=31),
    },
}
CNNS: dict[str, FitConfig] = {
    "40 epochs, rate up to 2e-3": FitConfig(),
    "40 epochs, rate up to 5e-4": FitConfig(rate=5e-4),
    "40 epochs, rate up to 5e-3": FitConfig(rate=5e-3),
    "80 epochs, rate up to 2e-3": FitConfig(epochs=80),
}
PAPER: dict[str, FitConfig] = {
    "16 clips a step, rate 2e-3": FitConfig(epochs=5, schedule="constant"),
    "16 clips a step, rate 5e-4": FitConfig(epochs=5, rate=5e-4, schedule="constant"),
    "4 clips a step, rate 2e-3": FitConfig(epochs=5, batch=4, schedule="constant"),
    "4 clips a step, rate 5e-4": FitConfig(
        epochs=5, batch=4, rate=5e-4, schedule="constant"
    ),
    "16 clips a step, rate up to 2e-3": FitConfig(epochs=5),
    "4 clips a step, rate up to 5e-4": FitConfig(epochs=5, batch=4, rate=5e-4),
}
"""Settings with half of the final number of epochs, because each takes minutes."""
OURS: dict[str, Method] = {
    "strong augmentation": RecogniserMethod(),
    "gentle augmentation": RecogniserMethod(replace(FOR_SMALL_SETS, augment=GENTLE)),
    "gentle, two worn skins": RecogniserMethod(
        replace(FOR_SMALL_SETS, augment=GENTLE), skins=2
    ),
    "gentle, two worn skins, small network": RecogniserMethod(
        replace(FOR_SMALL_SETS, augment=GENTLE, network=NetworkConfig()), skins=2
    ),
}


def list_candidates() -> dict[str, dict[str, Method]]:
    """List the settings of every method, by their description."""
    found: dict[str, dict[str, Method]] = {"eskin": OURS}
    for name, settings in FLAT.items():
        for short, features in FEATURES.items():
            found[f"{name}-{short}"] = {
                words: BaselineMethod(
                    partial(FlatBaseline, estimator=estimator, features=features)
                )
                for words, estimator in settings.items()
            }
    for name, settings in HAND.items():
        found[name] = {
            words: BaselineMethod(partial(HandBaseline, estimator=estimator))
            for words, estimator in settings.items()
        }
    found["boosting-on-touch"] = {
        words: TouchTrees(estimator)
        for words, estimator in HAND["gradient-boosting"].items()
    }
    for name in NETWORKS:
        fits = PAPER if name == "paper" else CNNS
        found[name] = {
            words: build_network_method(name, fit) for words, fit in fits.items()
        }
    return found


@dataclass(frozen=True)
class Command:
    """Evaluate some settings of each method."""

    sets: Path = Path("sets")
    """Folder of the sets."""
    methods: tuple[str, ...] = ()
    """Methods to evaluate; all unless given."""
    workers: int = 1
    """Number of processes that train."""


def main() -> None:
    """Evaluate the settings and print a table."""
    command = tyro.cli(Command)
    draws = [
        find_examples(
            [made_set(command.sets, "paper", seed=seed) / "train"],
            command.sets / "pack",
            command.workers,
        )
        for seed in SEEDS
    ]
    print("| method | settings | accuracy on held-out people |\n|---|---|---|")
    for name, settings in list_candidates().items():
        if not command.methods or name in command.methods:
            print(format_rows(name, settings, draws, command), flush=True)


def format_rows(
    name: str, settings: Mapping[str, Method], draws: list[Examples], command: Command
) -> str:
    """Format one row per setting."""
    tasks = [
        TrainingTask(f"{name} of {words}", method, draw, {}, 0)
        for words, method in settings.items()
        for draw in draws
    ]
    done = train_all(tasks, RESULTS, command.workers)
    shares = [r.answered["val"].correct.mean() for r in done if r is not None]
    means = np.reshape(shares, (len(settings), len(draws))).mean(axis=1)
    rows = zip(settings, means.tolist(), strict=True)
    return "\n".join(f"| {name} | {words} | {mean:.1%} |" for words, mean in rows)


if __name__ == "__main__":
    main()
