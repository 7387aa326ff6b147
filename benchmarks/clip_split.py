"""Validate on other clips of the same people, as the paper does, beside another day.

    python -m benchmarks.clip_split --sets SETS

The paper trains on 80 % of its clips, validates on the other 20 %, and tests on another
day; its network falls from 96.1 to 91.1 %. Here each paper-size set is divided both
ways: by clips, a fifth of them drawn at random, and by people, one of six. The same
method is trained on each part and tested on the same other day. Touches of a clip that
is held out are not trained on. The last columns are validation less the other day, in
points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
import tyro
from jaxtyping import Bool

from benchmarks.simulated_sets import made_set
from benchmarks.tables import format_head, format_row
from eskin.graph import GraphConfig
from eskin.learn.baselines import SkinWindows
from eskin.learn.comparison import METHODS, Examples, find_examples
from eskin.learn.comparison.results import split_examples
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Clip
from eskin.progress import track_progress

SHARE = 0.2
"""Share of the clips, and of the people, that are held out."""


@dataclass(frozen=True)
class Command:
    """Compare validation by clips and by people with another day."""

    sets: Path
    """Folder of the sets; those that are missing are generated there."""
    draws: int = 3
    """Number of paper-size sets, each with its own people, poses and build."""
    methods: tuple[str, ...] = ("eskin", "boosting-on-touch", "random-forest")
    """Methods to train."""
    workers: int = 1
    """Number of processes that generate and prepare."""


@dataclass(frozen=True, eq=False)
class ChosenExamples(Examples):
    """Chosen examples are some of the clips of recordings."""

    chosen: frozenset[tuple[Path, int]] = frozenset()
    """Recording and start [ns since the epoch] of each."""

    @cached_property
    def clips(self) -> tuple[tuple[int, Clip], ...]:
        """Return the chosen clips, each with the index of its recording."""
        found = find_all_clips(self)
        return tuple(
            (n, c) for n, c in found if (self.paths[n], c.start) in self.chosen
        )

    @cached_property
    def windows(self) -> SkinWindows:
        """Return pressures of all taxels and joint positions in each clip."""
        whole = as_whole(self)
        kept = [(self.paths[n], clip.start) in self.chosen for n, clip in whole.clips]
        rows = np.flatnonzero(kept)
        return SkinWindows(whole.windows.pressure[rows], whole.windows.q[rows])

    def dataset(self, graph: GraphConfig, skins: int = 0) -> Dataset:
        """Return the graphs of all clips, with the segments of the chosen ones only."""
        dataset = super().dataset(graph, skins)
        count = dataset.original_count
        starts = [np.array([clip.start for clip in clips]) for clips in dataset.clips]

        def is_chosen(recording: int, stamp: int) -> bool:
            row = int(np.searchsorted(starts[recording], stamp, "right")) - 1
            first = int(starts[recording][max(row, 0)])
            return (self.paths[recording % count], first) in self.chosen

        segments = tuple(
            segment
            for segment in dataset.segments
            if is_chosen(segment.recording, int(dataset.stamps[segment.first]))
        )
        clips = tuple(
            tuple(c for c in each if (self.paths[n % count], c.start) in self.chosen)
            for n, each in enumerate(dataset.clips)
        )
        return replace(dataset, segments=segments, clips=clips)


def as_whole(examples: Examples) -> Examples:
    """Return examples of all clips of the same recordings."""
    return Examples(examples.paths, examples.pack, examples.workers, examples.transform)


def find_all_clips(examples: Examples) -> tuple[tuple[int, Clip], ...]:
    """Return all clips of the recordings, chosen or not."""
    return as_whole(examples).clips


def choose(examples: Examples, kept: Bool[np.ndarray, "clip"]) -> ChosenExamples:
    """Return some clips of examples."""
    pairs = zip(examples.clips, kept, strict=True)
    chosen = frozenset(
        (examples.paths[n], clip.start) for (n, clip), keep in pairs if keep
    )
    return ChosenExamples(**vars(as_whole(examples)), chosen=chosen)


def split_clips(examples: Examples) -> tuple[Examples, Examples]:
    """Divide clips at random into those to train on and those to validate on."""
    rng = np.random.default_rng(0)
    held = np.zeros(len(examples.clips), np.bool_)
    held[rng.permutation(len(held))[: round(SHARE * len(held))]] = True
    return choose(examples, ~held), choose(examples, held)


def split_people(examples: Examples) -> tuple[Examples, Examples]:
    """Divide clips by people, as the comparison of methods does."""
    return split_examples(examples, SHARE)


SPLITS = {"clips": split_clips, "people": split_people}
"""Ways of dividing examples, by what is held out."""


def measure(
    method: str, train: Examples, others: Sequence[Examples], seed: int
) -> list[float]:
    """Return the accuracy of a method on others after training."""
    predict = METHODS[method].fit(train, seed)
    return [
        float(np.mean(predict(each).argmax(axis=1) == each.truth(train.gestures)))
        for each in others
    ]


def main() -> None:
    """Train, test and print the table."""
    command = tyro.cli(Command)
    torch.set_num_threads(1)
    pack, workers = command.sets / "pack", command.workers
    runs = [
        (m, s, d) for m in command.methods for s in SPLITS for d in range(command.draws)
    ]
    found: dict[tuple[str, str], list[list[float]]] = {}
    for method, split, draw in track_progress(runs, "trainings", len(runs)):
        folder = made_set(command.sets, "paper", seed=draw, workers=workers)
        examples = find_examples([folder / "train"], pack, workers)
        train, validation = SPLITS[split](examples)
        test = find_examples([folder / "test"], pack, workers)
        shares = measure(method, train, [validation, test], draw)
        found.setdefault((method, split), []).append(shares)
    heads = ("method", "held out", "validation (SD)", "other day (SD)", "less", "range")
    print(format_head(heads))
    for (method, split), shares in found.items():
        values = 100 * np.array(shares)
        drops = values[:, 0] - values[:, 1]
        spread = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(2)
        cells = [
            f"{mean:.1f} % ({deviation:.1f})"
            for mean, deviation in zip(values.mean(axis=0), spread, strict=True)
        ]
        cells += [f"{drops.mean():+.1f}", f"{drops.min():+.1f} to {drops.max():+.1f}"]
        print(format_row([method, split, *cells]))


if __name__ == "__main__":
    main()
