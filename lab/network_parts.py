"""Measure what each part of the network is worth: the same training without it.

    python -m lab.network_parts --sets SETS --keep FILE
    python -m lab.network_parts --sets SETS --seeds 1 --only "summary alone"
    python -m lab.network_parts --sets SETS --keep FILE --zero-shot

Every row is trained on the sets of `lab.weights`, and on one recorded person or,
zero-shot, on none, for as long and with the same augmentation, from random weights. It
is tested on simulated people with sensors as in training (`val`) and of all families
(`val-families`), on pairs of clips with the same counts and another label, and on the
recorded people who are left, whose touches are placed on a robot. None of these is a
final set, and the epoch of least loss is chosen on the first two.

Accuracies are of clips, by the touch of largest impulse at its last reading. Intervals
are those of 95 % of resampled people, or of recordings of the only one. The lead over
the first row is paired. With `--keep` each training is kept in a file, and what is
there is not trained again.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import cross_entropy, pad, silu

from eskin.learn.batches import Batch, BatchBuilder, build_sampler, cut_windows
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.evaluation import find_last_rows, predict_clips
from eskin.learn.metrics import bootstrap_mean
from eskin.learn.nn import RecogniserNetwork, SlotIndex
from eskin.learn.training import TrainConfig, Trainer
from eskin.live import NetworkConfig, compute_summary
from eskin.recording import NONE, find_recordings
from lab.baselines.estimators import GradientBoosting
from lab.baselines.hand import compute_statistics
from lab.json_lines import append_results, read_results
from lab.tables import format_head, format_row
from lab.weights import (
    OPTIONS,
    SHARES,
    SIMULATED,
    VALIDATION,
    Recipe,
    build_recorded_sets,
    generate,
)

VOCABULARY = (NONE, "double_pat", "grab", "poke", "stroke")


@dataclass(frozen=True)
class Part:
    """A part says what a network has, and how large it is."""

    sizes: Mapping[str, int] = field(default_factory=dict)
    """Sizes of the network, where they are not those of `SIZES`."""
    graph_alone: bool = False
    """Whether there is no summary view."""
    hides_summary: bool = False
    """Whether the graph view is not given the summary."""
    readings: int | None = None
    """Readings encoded in a window; as many as for the weights where None."""
    encoded: int | None = None
    """Windows encoded in a step; as many as for the weights where None."""
    head: Literal["statistics", "recurrent", "dilated"] = "statistics"
    """Head of the summary view; `statistics` is that of the recogniser."""


SIZES = {"width": 32, "layers": 3, "channels": 48}
"""Sizes of the network of both views."""

TREES = "trees on the summary"
PARTS = {
    "both views": Part(),
    "summary alone": Part({"width": 0}),
    "graph alone": Part(graph_alone=True, hides_summary=True),
    "graph with summary": Part(graph_alone=True),
    "one layer": Part({"layers": 1}),
    "no messages": Part({"layers": 0}),
    "all readings encoded": Part(readings=100, encoded=16),
    "twice as wide": Part({"width": 64, "channels": 96}),
    "both views, 160 channels": Part({"channels": 160}),
    "summary alone, 96 channels": Part({"width": 0, "channels": 96}),
    "summary alone, 160 channels": Part({"width": 0, "channels": 160}),
    "summary alone, recurrent": Part({"width": 0, "channels": 96}, head="recurrent"),
    "summary alone, dilated": Part({"width": 0, "channels": 64}, head="dilated"),
    TREES: Part(),
}
"""Rows by their names in the table."""

TREE_WINDOWS = 40_000
"""Number of augmented windows that trees are trained on."""


@dataclass(frozen=True)
class Command:
    """Measure what each part of the network is worth."""

    sets: Path
    """Folder of the sets, and of the prepared recordings."""
    socialtouch: Path = Path("../shared/data/socialtouch")
    """Folder of the SocialTouch set, as published."""
    only: tuple[str, ...] = tuple(PARTS)
    """Rows to train; the first is what the others are compared to."""
    seeds: int = 3
    """Number of trainings of each row."""
    epochs: int = 8
    """Epochs of a training."""
    steps: int = 250
    """Steps of an epoch."""
    workers: int = 1
    """Number of processes that prepare, and of threads that train."""
    zero_shot: bool = False
    """Whether no recorded person is trained on, and both are tested on."""
    keep: Path | None = None
    """File to which results are appended, and of which they are read."""

    def __post_init__(self) -> None:
        """Raise if a row is not known."""
        unknown = [name for name in self.only if name not in PARTS]
        if unknown:
            raise ValueError(
                f"--only has '{unknown[0]}'; allowed are {', '.join(PARTS)}; take those"
            )


@dataclass
class Result:
    """A result holds which clips of each test a trained row classified correctly."""

    row: str
    seed: int
    epochs: int
    """Epochs and steps of the training."""
    steps: int
    seconds: float
    """Duration of the training [s]."""
    zero_shot: bool = False
    """Whether no recorded person was trained on."""
    correct: dict[str, list[bool]] = field(default_factory=dict)
    """Whether each clip of each test is right."""


class SequenceHead(nn.Module):
    """A sequence head reads the slots of a window in order, and keeps no statistics.

    Its logits are those of the last output and of the greatest outputs of all slots.
    An absent slot is an input of zeros with a mark.
    """

    def __init__(self, inputs: int, channels: int, dropout: float) -> None:
        """Create a head for inputs of a number of channels."""
        super().__init__()
        self.project = nn.Linear(inputs + 1, channels)
        self.dropout = nn.Dropout(dropout)
        self.classify = nn.Linear(2 * channels, len(VOCABULARY))

    def filter(
        self, x: Float[Tensor, "window slot channel"]
    ) -> Float[Tensor, "window slot channel"]:
        """Return the outputs of all slots; each depends on no later one."""
        raise NotImplementedError

    def forward(
        self,
        e: Float[Tensor, "window slot input"],
        present: Float[Tensor, "window slot"],
    ) -> Float[Tensor, "window class"]:
        """Return the logits of windows; `present` is 1 where a slot holds a reading."""
        marked = torch.cat([e * present[..., None], present[..., None]], dim=2)
        out = self.filter(silu(self.project(marked)))
        both = torch.cat([out[:, -1], out.amax(dim=1)], dim=1)
        return self.classify(self.dropout(both))


class RecurrentHead(SequenceHead):
    """A recurrent head is a gated recurrent unit (Cho et al. 2014)."""

    def __init__(self, inputs: int, channels: int, dropout: float) -> None:
        """Create a head for inputs of a number of channels."""
        super().__init__(inputs, channels, dropout)
        self.unit = nn.GRU(channels, channels, batch_first=True)

    def filter(
        self, x: Float[Tensor, "window slot channel"]
    ) -> Float[Tensor, "window slot channel"]:
        """Return the state after each slot."""
        return self.unit(x)[0]


class DilatedHead(SequenceHead):
    """A dilated head has six residual causal convolutions (Bai et al. 2018).

    Their dilations are 1 to 32 slots, so that the last output sees 127 slots.
    """

    def __init__(self, inputs: int, channels: int, dropout: float) -> None:
        """Create a head for inputs of a number of channels."""
        super().__init__(inputs, channels, dropout)
        self.layers = nn.ModuleList(
            nn.Conv1d(channels, channels, kernel_size=3, dilation=2**n)
            for n in range(6)
        )

    def filter(
        self, x: Float[Tensor, "window slot channel"]
    ) -> Float[Tensor, "window slot channel"]:
        """Return the outputs of the last layer."""
        x = x.transpose(1, 2)
        for n, layer in enumerate(self.layers):
            x = x + silu(layer(pad(x, (2 * 2**n, 0))))
        return x.transpose(1, 2)


class PartNetwork(RecogniserNetwork):
    """A part network is the recogniser's, without some of it."""

    def __init__(self, config: NetworkConfig, part: Part) -> None:
        """Create a network of a part."""
        super().__init__(config, len(VOCABULARY), shear=False)
        self.part = part
        if part.head != "statistics":
            kind = RecurrentHead if part.head == "recurrent" else DilatedHead
            inputs = len(self.summary_mean)
            self.summary_head = kind(inputs, config.channels, config.dropout)

    def standardise(
        self, summary: Float[Tensor, "reading summary"]
    ) -> Float[Tensor, "reading summary"]:
        """Return the standardised summary; zeros where it is hidden."""
        found = super().standardise(summary)
        return torch.zeros_like(found) if self.part.hides_summary else found

    def classify(
        self, e: Float[Tensor, "reading feature"], slot_index: SlotIndex
    ) -> Float[Tensor, "view window class"]:
        """Return the logits of the views of the part."""
        if self.part.graph_alone:
            return self.graph_branch(e, slot_index)[None]
        return super().classify(e, slot_index)


class PartTrainer(Trainer):
    """A part trainer trains a part network."""

    network: PartNetwork

    def compute_loss(self, batch: Batch) -> Float[Tensor, ""]:
        """Return the loss of the recogniser, or of the graph view alone."""
        if not self.network.part.graph_alone:
            return super().compute_loss(batch)
        graphs, slot_index = batch.encoded.graphs, batch.encoded.slot_index
        logits = self.network.graph_branch(self.network.embed(graphs), slot_index)
        unused = sum(p.sum() for p in self.network.summary_head.parameters())
        labels, smoothing = batch.labels[: len(logits)], self.config.smoothing
        return cross_entropy(logits, labels, label_smoothing=smoothing) + 0.0 * unused


def read_config(command: Command, part: Part) -> TrainConfig:
    """Return the training of the weights, changed as a part says."""

    @dataclass(frozen=True)
    class Options:
        train: TrainConfig = field(default_factory=TrainConfig)

    words = OPTIONS[OPTIONS.index("--train.batch") :]
    config = tyro.cli(Options, args=[*words, "--train.shares", *SHARES]).train
    return replace(
        config,
        epochs=command.epochs,
        steps=command.steps,
        workers=command.workers,
        readings=part.readings or config.readings,
        encoded=part.encoded or config.encoded,
        network=replace(config.network, **{**SIZES, **part.sizes}),
    )


def load_sets(command: Command) -> tuple[Dataset, Dataset, dict[str, Dataset]]:
    """Return the sets to train on, to validate on and to test on."""

    def load(sets: dict[str, str]) -> Dataset:
        for folder, options in sets.items():
            generate(command.sets / folder, options.split(), command.workers)
        paths = find_recordings([command.sets / folder for folder in sets])
        pack = command.sets / "pack"
        config = TrainConfig().graph.without_shear()
        return prepare(paths, graph=config, pack=pack, workers=command.workers)

    first, other = (
        build_recorded_sets(Recipe("", (person,), 0, 0), command.socialtouch)
        for person in (0, 1)
    )
    tests = {
        "val": {"tuneval": VALIDATION["tuneval"]},
        "val-families": {"tunefam": VALIDATION["tunefam"]},
        "pairs": {"tunepairs": "--set pairs --seed 5 --clips 60"},
        "the other person": {"rec1": other["rec1"]},
    }
    if command.zero_shot:
        tests["person 0"] = {"rec0": first["rec0"]}
    train = SIMULATED | ({} if command.zero_shot else first)
    return (
        load(train),
        load(VALIDATION),
        {name: load(sets) for name, sets in tests.items()},
    )


def run(command: Command) -> tuple[list[Result], dict[str, list[str]]]:
    """Train the rows that are not kept; return results, and the person of each clip."""
    train, validation, tests = load_sets(command)
    results = read_results(command.keep, Result)
    zero_shot = command.zero_shot
    done = {(r.row, r.seed, r.epochs, r.steps, r.zero_shot) for r in results}
    for seed in range(command.seeds):
        for row in command.only:
            if (row, seed, command.epochs, command.steps, zero_shot) in done:
                continue
            fit = fit_trees if row == TREES else fit_network
            start = time.perf_counter()
            predict = fit(command, PARTS[row], train, validation, seed)
            seconds = time.perf_counter() - start
            result = Result(
                row, seed, command.epochs, command.steps, seconds, zero_shot
            )
            for name, test in tests.items():
                result.correct[name] = predict(test)
            results.append(result)
            append_results(command.keep, [result])
    people = {name: find_people(test) for name, test in tests.items()}
    wanted = command.epochs, command.steps, zero_shot
    chosen = [r for r in results if (r.epochs, r.steps, r.zero_shot) == wanted]
    return chosen, people


def predict_with(network: RecogniserNetwork, test: Dataset) -> list[bool]:
    """Tell which clips of a set a network classifies correctly."""
    found = predict_clips(network, test, VOCABULARY)
    return (found.predicted == found.truth).tolist()


Predictor = Callable[[Dataset], list[bool]]
"""Function that tells which clips of a set are classified correctly."""


def fit_network(
    command: Command, part: Part, train: Dataset, validation: Dataset, seed: int
) -> Predictor:
    """Train a part of the network."""
    config = read_config(command, part)
    trainer = PartTrainer(train, VOCABULARY, config, seed=seed, validation=validation)
    torch.manual_seed(seed)
    trainer.network = PartNetwork(config.network, part)
    return partial(predict_with, trainer.run(quiet=True))


def fit_trees(
    command: Command, part: Part, train: Dataset, validation: Dataset, seed: int
) -> Predictor:
    """Boost trees on statistics of the summary of augmented windows."""
    del part, validation
    config = read_config(command, Part())
    every = frozenset(range(len(train.recordings)))
    slots = config.network.slots
    sampler = build_sampler(train, VOCABULARY, every, slots, 0.0, config.shares)
    builder = BatchBuilder(train, sampler, config.augment, slots, shear=False)
    rng = np.random.default_rng(seed)
    rows, labels = [], []
    for _ in range(-(-TREE_WINDOWS // config.batch)):
        batch = builder.build(config.batch, 1, 1, rng)
        window, summary = batch.slot_index.window.numpy(), batch.summary.numpy()
        rows += [compute_row(summary[window == n]) for n in range(config.batch)]
        labels += batch.labels.tolist()
    trees = GradientBoosting(leaves=31)(seed).fit(np.stack(rows), np.array(labels))

    def predict(test: Dataset) -> list[bool]:
        clips = [(n, c) for n, cs in enumerate(test.clips) for c in cs]
        clips = [(n, clip) for n, clip in clips if clip.gesture in VOCABULARY]
        ends = np.array(list(find_last_rows(test, clips)), dtype=np.int64)
        truth = np.array([VOCABULARY.index(clip.gesture) for _, clip in clips])
        answer = np.full(len(clips), VOCABULARY.index(NONE))
        touched = np.flatnonzero(ends >= 0)
        found = ends[touched]
        windows = cut_windows(test, found, test.starts[found], slots)
        summary = compute_summary(test.graphs.select(windows.rows), shear=False)
        rows = [compute_row(summary[windows.window == n]) for n in range(len(found))]
        answer[touched] = trees.predict_proba(np.stack(rows)).argmax(axis=1)
        return (answer == truth).tolist()

    return predict


def compute_row(
    summary: Float[np.ndarray, "reading feature"],
) -> Float[np.ndarray, "column"]:
    """Return statistics over a window, its length, and its last reading."""
    if not len(summary):
        return np.zeros(7 * summary.shape[1] + 1)
    length = [float(len(summary))]
    return np.concatenate([compute_statistics(summary.T), summary[-1], length])


def find_people(test: Dataset) -> list[str]:
    """Return the person of each clip; its recording where all are of one person."""
    numbers = [
        n
        for n, clips in enumerate(test.clips)
        for clip in clips
        if clip.gesture in VOCABULARY
    ]
    people = [test.recordings[n].metadata.subject or str(n) for n in numbers]
    return people if len(set(people)) > 1 else [str(n) for n in numbers]


def format_table(
    results: list[Result], people: dict[str, list[str]], rows: tuple[str, ...]
) -> str:
    """Format accuracies with their intervals, and the leads over the first row."""
    lines = [
        format_head(
            ["row", "trainings", "s each", *people, "lead: " + ", ".join(people)]
        )
    ]
    means = {
        (row, name): np.mean([r.correct[name] for r in results if r.row == row], axis=0)
        for row in rows
        for name in people
        if any(r.row == row for r in results)
    }
    rows = tuple(row for row in rows if (row, next(iter(people))) in means)
    for row in rows:
        mine = [r for r in results if r.row == row]
        cells = [row, str(len(mine)), f"{np.mean([r.seconds for r in mine]):.0f}"]
        leads = []
        for name, members in people.items():
            values, first = means[row, name], means[rows[0], name]
            low, high = bootstrap_mean(values, np.array(members), seed=0)
            cells.append(f"{values.mean():.1%} ({low:.1%} to {high:.1%})")
            low, high = bootstrap_mean(values - first, np.array(members), seed=0)
            lead = 100 * (values - first).mean()
            leads.append(f"{lead:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]")
        lines.append(format_row([*cells, ", ".join(leads) if row != rows[0] else ""]))
    return "\n".join(lines)


def main() -> None:
    """Train, test and print the table."""
    command = tyro.cli(Command)
    torch.set_num_threads(1)
    results, people = run(command)
    print(format_table(results, people, command.only))


if __name__ == "__main__":
    main()
