"""Measure how much accuracy the flaws of the simulated sensor cost.

    python -m lab.losses --sets FOLDER

Boosted trees are trained on statistics of the features that the network receives (the
summary of every reading of a touch), and tested on clips of other people. Three skins
are compared: as published, with taxels that respond to the lightest touch, and without
any flaw. Sets that are missing in FOLDER are generated there (about 3 GB). The command
prints a table of docs/experiments.md.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float
from sklearn.ensemble import HistGradientBoostingClassifier

from eskin.learn.dataset import Dataset, prepare
from eskin.learn.evaluation import find_last_rows
from eskin.learn.ground_truth import find_runs
from eskin.live import GraphConfig, compute_summary
from eskin.recording import NONE, find_recordings
from eskin.sim.constants import load_constants
from eskin.sim.dataset import GenerationSettings, Simulator, generate

NEARLY_NOTHING = 1e-3
"""Factor that makes a constant almost zero."""

LIGHTEST = {
    "sensor.activation.fresh": NEARLY_NOTHING,
    "sensor.bent.fresh": NEARLY_NOTHING,
    "sensor.bend.fresh": NEARLY_NOTHING,
}
"""Constants of taxels that respond from the first pascal on."""

EVEN = {
    f"sensor.{name}.fresh": NEARLY_NOTHING
    for name in (
        *("gain_taxel", "gain_patch", "exponent_scatter", "session_gain"),
        *("temperature", "after", "ghost", "leak", "noise"),
        *("defective", "dead_line", "dropped"),
    )
}
"""Constants of taxels that are equal, free of noise and without defects."""

TIMES = 8
"""Number of instants of the force, evenly spaced over a touch."""


@dataclass(frozen=True)
class Command:
    """Score boosted trees on skins with more and fewer flaws."""

    sets: Path = Path("sets")
    """Folder of the sets."""
    train: int = 4000
    """Number of clips for training."""
    val: int = 800
    """Number of clips of other people for the test."""
    seeds: int = 3
    """Number of trainings; accuracies are their mean."""
    workers: int = os.cpu_count() or 1
    """Number of processes that generate and prepare."""


def as_published(skin: str) -> Simulator:
    """Build the simulator that comes with eskin."""
    return Simulator(skin)


def lightest(skin: str) -> Simulator:
    """Build a simulator whose taxels respond to the lightest touch."""
    return Simulator(skin, load_constants().scaled(LIGHTEST))


def flawless(skin: str) -> Simulator:
    """Build a simulator whose taxels also have no other flaw."""
    return Simulator(skin, load_constants().scaled(LIGHTEST | EVEN))


WORLDS: dict[str, Callable[[str], Simulator]] = {
    "as published": as_published,
    "feels the lightest touch": lightest,
    "no flaw at all": flawless,
}


def main() -> None:
    """Print the table."""
    command = tyro.cli(Command)
    print("| sensor | accuracy |\n|---|---|")
    for number, (name, world) in enumerate(WORLDS.items()):
        folder = command.sets / f"losses-{number}"
        train, val = (
            generate_dataset(
                folder / kind,
                GenerationSettings(kind, "ur5", 0, clips),
                world,
                command.workers,
            )
            for kind, clips in (("train", command.train), ("val", command.val))
        )
        right = [compute_accuracy(train, val, seed) for seed in range(command.seeds)]
        print(f"| {name} | {np.mean(right):.1%} |", flush=True)


def generate_dataset(
    folder: Path,
    settings: GenerationSettings,
    world: Callable[[str], Simulator],
    workers: int,
) -> Dataset:
    """Generate a set of clips with a simulator, and prepare it."""
    generate(folder, settings, workers, world)
    graph = GraphConfig().without_shear()
    paths = find_recordings([folder])
    return prepare(paths, graph=graph, pack=folder.parent / "pack", workers=workers)


def compute_accuracy(train: Dataset, val: Dataset, seed: int) -> float:
    """Return the accuracy of boosted trees on clips."""
    trees = HistGradientBoostingClassifier(
        max_iter=350,
        learning_rate=0.06,
        max_leaf_nodes=15,
        l2_regularization=1.0,
        max_features=0.3,
        random_state=seed,
    )
    trees.fit(
        compute_statistics(train), [segment.gesture for segment in train.segments]
    )
    predicted = trees.predict(compute_statistics(val))
    ends = [end - 1 for _, end in find_runs(val.sequence[:, None])]
    every = [(n, clip) for n, clips in enumerate(val.clips) for clip in clips]
    rows = list(find_last_rows(val, every))
    answers = [
        NONE if row < 0 else predicted[np.searchsorted(ends, row)] for row in rows
    ]
    truths = [clip.gesture for _, clip in every]
    return float(np.mean([a == t for a, t in zip(answers, truths, strict=True)]))


def compute_statistics(dataset: Dataset) -> Float[np.ndarray, "touch statistic"]:
    """Compute statistics of the features of each touch during contact."""
    rows = compute_summary(dataset.graphs, shear=False)
    runs = find_runs(dataset.sequence[:, None])
    return np.array([compute_touch_compute_statistics(rows[a:b]) for a, b in runs])


def compute_touch_compute_statistics(
    rows: Float[np.ndarray, "reading feature"],
) -> np.ndarray:
    """Compute the statistics of one touch."""
    felt = rows[:, 0] > 0
    on = rows[felt] if felt.any() else rows
    when = np.linspace(0, len(rows) - 1, TIMES)
    force = np.interp(when, np.arange(len(rows)), rows[:, 0])
    moments = (on.mean(0), on.std(0), on.max(0), on.min(0), rows[-1])
    quartiles = np.percentile(on, [25, 75], axis=0).ravel()
    return np.concatenate([*moments, quartiles, force, [len(rows), felt.mean()]])


if __name__ == "__main__":
    main()
