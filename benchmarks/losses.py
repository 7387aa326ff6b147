"""What of a recogniser's accuracy the simulated sensor takes.

    python -m benchmarks.losses --sets FOLDER

Boosted trees learn statistics of the features that the network sees (the summary of
every reading of a touch), on skins as published, on skins whose taxels feel the
lightest touch, and on skins without any flaw, and answer clips of other people. Sets
that FOLDER does not hold yet are generated there (about 3 GB). Prints a table of
docs/experiments.md.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float
from sklearn.ensemble import HistGradientBoostingClassifier

from eskin.graph import GraphConfig, compute_summary
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.evaluation import find_last_rows
from eskin.learn.ground_truth import find_runs
from eskin.recording import NONE, find_recordings
from eskin.sim.constants import load_constants
from eskin.sim.dataset import GenerationSettings, Simulator, generate

NEARLY_NOTHING = 1e-3
"""Factor on a constant that is to be as good as zero."""

LIGHTEST = {
    "sensor.activation.fresh": NEARLY_NOTHING,
    "sensor.bent.fresh": NEARLY_NOTHING,
    "sensor.bend.fresh": NEARLY_NOTHING,
}
"""Taxels that feel from the first pascal on."""

EVEN = {
    f"sensor.{name}.fresh": NEARLY_NOTHING
    for name in (
        *("gain_taxel", "gain_patch", "exponent_scatter", "session_gain"),
        *("temperature", "after", "ghost", "leak", "noise"),
        *("defective", "dead_line", "dropped"),
    )
}
"""Taxels that are all alike, quiet and whole."""

TIMES = 8
"""Instants that force is looked at, evenly over a touch."""


@dataclass(frozen=True)
class Command:
    """Score boosted trees on skins with more and fewer flaws."""

    sets: Path = Path("sets")
    """Folder of the sets."""

    train: int = 4000
    """Clips to learn from."""

    val: int = 800
    """Clips of other people to answer."""

    seeds: int = 3
    """Trees are grown so often; accuracies are their mean."""

    workers: int = os.cpu_count() or 1
    """Processes that generate and prepare."""


def as_published(skin: str) -> Simulator:
    """The world as it comes with eskin."""
    return Simulator(skin)


def lightest(skin: str) -> Simulator:
    """A world whose taxels feel the lightest touch."""
    return Simulator(skin, load_constants().scaled(LIGHTEST))


def flawless(skin: str) -> Simulator:
    """A world whose taxels have no flaw besides."""
    return Simulator(skin, load_constants().scaled(LIGHTEST | EVEN))


WORLDS: dict[str, Callable[[str], Simulator]] = {
    "as published": as_published,
    "feels the lightest touch": lightest,
    "no flaw at all": flawless,
}


def main() -> None:
    """Print the table."""
    command = tyro.cli(Command)
    print("| sensor | clips right |\n|---|---|")
    for number, (name, world) in enumerate(WORLDS.items()):
        folder = command.sets / f"losses-{number}"
        train, val = (
            made(
                folder / kind,
                GenerationSettings(kind, "ur5", 0, clips),
                world,
                command.workers,
            )
            for kind, clips in (("train", command.train), ("val", command.val))
        )
        right = [accuracy(train, val, seed) for seed in range(command.seeds)]
        print(f"| {name} | {np.mean(right):.1%} |", flush=True)


def made(
    folder: Path,
    settings: GenerationSettings,
    world: Callable[[str], Simulator],
    workers: int,
) -> Dataset:
    """A set of that world, prepared."""
    generate(folder, settings, workers, world)
    graph = GraphConfig().without_shear()
    paths = find_recordings([folder])
    return prepare(paths, graph=graph, pack=folder.parent / "pack", workers=workers)


def accuracy(train: Dataset, val: Dataset, seed: int) -> float:
    """Share of clips that boosted trees answer rightly."""
    trees = HistGradientBoostingClassifier(
        max_iter=350,
        learning_rate=0.06,
        max_leaf_nodes=15,
        l2_regularization=1.0,
        max_features=0.3,
        random_state=seed,
    )
    trees.fit(statistics(train), [segment.gesture for segment in train.segments])
    said = trees.predict(statistics(val))
    ends = [end - 1 for _, end in find_runs(val.sequence[:, None])]
    every = [(n, clip) for n, clips in enumerate(val.clips) for clip in clips]
    rows = list(find_last_rows(val, every))
    answers = [NONE if row < 0 else said[np.searchsorted(ends, row)] for row in rows]
    truths = [clip.gesture for _, clip in every]
    return float(np.mean([a == t for a, t in zip(answers, truths, strict=True)]))


def statistics(dataset: Dataset) -> Float[np.ndarray, "touch statistic"]:
    """What the features of each touch were like while there was contact."""
    rows = compute_summary(dataset.graphs, shear=False)
    runs = find_runs(dataset.sequence[:, None])
    return np.array([statistics_of(rows[a:b]) for a, b in runs])


def statistics_of(rows: Float[np.ndarray, "reading feature"]) -> np.ndarray:
    """The same of one touch."""
    felt = rows[:, 0] > 0
    on = rows[felt] if felt.any() else rows
    when = np.linspace(0, len(rows) - 1, TIMES)
    force = np.interp(when, np.arange(len(rows)), rows[:, 0])
    moments = (on.mean(0), on.std(0), on.max(0), on.min(0), rows[-1])
    quartiles = np.percentile(on, [25, 75], axis=0).ravel()
    return np.concatenate([*moments, quartiles, force, [len(rows), felt.mean()]])


if __name__ == "__main__":
    main()
