"""Validate on other clips of the same people, as the paper does, beside another day.

    python -m lab.clip_split --sets SETS

The paper trains on 80 % of its clips, validates on the other 20 %, and tests on another
day; its network falls from 96.1 to 91.1 %. Here each paper-size set is divided both
ways: by clips, a fifth of them drawn at random, and by people, one of six. The same
method is trained on each part and tested on the same other day. Touches of a clip that
is held out are not trained on. The last columns are validation less the other day, in
points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import torch
import tyro
from jaxtyping import Bool

from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Clip
from eskin.live import GraphConfig
from eskin.progress import track_progress
from lab.baselines import SkinWindows
from lab.comparison import METHODS, Examples, find_examples
from lab.comparison.results import split_examples
from lab.simulated_sets import made_set
from lab.tables import format_head, format_row

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
        whole = as_whole(self).clips
        return tuple((n, clip) for n, clip in whole if self.has(n, clip.start))

    def has(self, recording: int, start: int) -> bool:
        """Return whether the clip of a recording that starts at a stamp is chosen."""
        return (self.paths[recording], start) in self.chosen

    @cached_property
    def windows(self) -> SkinWindows:
        """Return pressures of all taxels and joint positions in each clip."""
        whole = as_whole(self)
        rows = np.flatnonzero([self.has(n, clip.start) for n, clip in whole.clips])
        return SkinWindows(whole.windows.pressure[rows], whole.windows.q[rows])

    def dataset(self, graph: GraphConfig, skins: int = 0) -> Dataset:
        """Return the graphs of all clips, with the segments of the chosen ones only."""
        dataset = super().dataset(graph, skins)
        count = dataset.original_count
        starts = [np.array([clip.start for clip in clips]) for clips in dataset.clips]

        def is_chosen(recording: int, stamp: int) -> bool:
            row = int(np.searchsorted(starts[recording], stamp, "right")) - 1
            return self.has(recording % count, int(starts[recording][max(row, 0)]))

        segments = tuple(
            segment
            for segment in dataset.segments
            if is_chosen(segment.recording, int(dataset.stamps[segment.first]))
        )
        clips = tuple(
            tuple(clip for clip in each if self.has(n % count, clip.start))
            for n, each in enumerate(dataset.clips)
        )
        return replace(dataset, segments=segments, clips=clips)


def as_whole(examples: Examples) -> Examples:
    """Return examples of all clips of the same recordings."""
    return Examples(examples.paths, examples.pack, examples.workers, examples.transform)


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


SPLITS = {"clips": split_clips, "people": partial(split_examples, share=SHARE)}
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
