"""Measure accuracy over the number of examples a gesture.

    python -m lab.few_examples --work FOLDER
    python -m lab.few_examples --work FOLDER --source shearsense --held 1
    python -m lab.few_examples --work FOLDER --source simulated
    python -m lab.few_examples --work FOLDER --examples 1 --repeats 1 \
        --cap 4 --held 1 --epochs 1 --steps 4

The last form shows in three minutes that all of it runs; the others take some hours on
one core. With `--keep` the result of each run is kept in a file, and what is there is
not measured again.

Gestures are the 12 groups of SocialTouch, the 17 of ShearSense (its pressures, contact
by contact), or four of simulated people (of the set `test-s`), played as by a live
device. For each person and draw some repetitions of each group are held out, on
ShearSense those of whole recordings; of the others 1, 2, 5 and so on of each group are
learned from, then all. Tested on the held-out repetitions of the same person, and on
those of each other person. Three methods: starting from weights, starting from nothing,
and the nearest example by the mean, spread and maximum of the features of those
weights. Repetitions without a detected touch are wrong. Intervals are bootstrapped over
people and draws.
"""

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro
from jaxtyping import Float, Int

from eskin import load_model
from eskin.learn.checkpoint import to_network
from eskin.learn.evaluation import embed_rows, score_segments
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.training import TrainConfig, Trainer
from eskin.live import Model
from eskin.progress import track_progress
from eskin.recording import NONE
from lab.json_lines import append_results, read_results
from lab.recorded_examples import RecordedExamples, Source, build_examples
from lab.tables import format_head, format_row

METHODS = ("start", "nothing", "nearest")
Method = Literal["start", "nothing", "nearest"]
ALL = 0
"""Number of examples that stands for all that are not held out."""
BOOTSTRAPS = 2000


@dataclass(frozen=True)
class Command:
    """Measure accuracy over the number of examples a gesture."""

    work: Path
    """Folder of the recordings that are made, and of their prepared forms."""
    source: Source = "socialtouch"
    """Set of the repetitions."""
    data: Path | None = None
    """Folder of the set, as downloaded; in ../shared/data unless given."""
    model: str = "ur5"
    """Weights to start from."""
    examples: tuple[int, ...] = (1, 2, 5, 10, 20, ALL)
    """Numbers of examples of each group; 0 for all that are not held out."""
    repeats: int = 5
    """Number of draws of held-out repetitions and examples, for each person."""
    held: int = 8
    """Number of held-out repetitions of each group; of recordings on ShearSense."""
    cap: int | None = None
    """Greatest number of repetitions of a group and person; all unless given."""
    epochs: int = 10
    """Epochs of a training."""
    steps: int = 40
    """Steps of an epoch."""
    readings: int = 25
    """Readings of a window whose graphs are encoded."""
    workers: int = 1
    """Number of processes."""
    methods: tuple[Method, ...] = METHODS
    """Methods to compare."""
    keep: Path | None = None
    """File to which results are appended, and of which they are read."""

    @property
    def settings(self) -> str:
        """Return the settings that change the result of a method and draw."""
        return (
            f"{self.source}, {self.model}, {self.held} held out, "
            f"{self.cap or 'no'} cap, {self.epochs} x {self.steps} steps, "
            f"{self.readings} readings"
        )


@dataclass(frozen=True)
class Result:
    """Holds the accuracy of one draw."""

    method: Method
    """Method."""
    examples: int
    """Number of examples of each group; 0 for all."""
    person: str
    """Person that was learned from."""
    tested: str
    """Person that was tested."""
    draw: int
    """Number of the draw."""
    accuracy: float
    """Share of the held-out repetitions that were right."""
    settings: str
    """Settings of the command that change what is measured."""

    @property
    def run(self) -> "Run":
        """Return the run that it is a result of."""
        return self.person, self.draw, self.examples, self.method


def main() -> None:
    """Measure, and print the tables."""
    command = tyro.cli(Command)
    started = time.monotonic()
    results = run(command)
    for same in (True, False):
        print("\nsame person" if same else "\nanother person")
        print(format_table(command, results, same))
    print(f"\n{time.monotonic() - started:.0f} s")


Run = tuple[str, int, int, Method]
"""Person to learn from, draw, number of examples, and method."""


def run(command: Command) -> list[Result]:
    """Measure what is not kept, and return the results of all methods and draws."""
    people = find_people(load_examples(command), command.held)
    draws = range(command.repeats)
    runs = set(product(people, draws, command.examples, command.methods))
    kept = read_results(command.keep, Result)
    results = [r for r in kept if r.settings == command.settings and r.run in runs]
    missing = sorted(runs - {result.run for result in results})
    plans = [(replace(command, workers=1), one) for one in missing]
    with get_context("spawn").Pool(command.workers) as pool:
        parts = pool.imap_unordered(measure, plans)
        for found in track_progress(parts, "runs", len(plans)):
            append_results(command.keep, found)
            results += found
    return results


def find_people(examples: RecordedExamples, held: int) -> list[str]:
    """Return the people of whom some repetitions are left when some are held out."""
    return [
        name
        for name in sorted(set(examples.person))
        if any(len(examples.find(name, x)) > held for x in examples.vocabulary[1:])
    ]


@cache
def load_examples(command: Command) -> RecordedExamples:
    """Return all repetitions; their recordings are written unless they are there."""
    return build_examples(
        command.source,
        command.work / command.source,
        command.data,
        command.cap,
        command.workers,
    )


def measure(plan: tuple[Command, Run]) -> list[Result]:
    """Return the accuracies of one run, on the held-out repetitions of each person."""
    command, (person, draw, count, method) = plan
    torch.set_num_threads(1)
    examples, model = load_examples(command), load_model(command.model)
    people = sorted(set(examples.person))
    rng = np.random.default_rng([draw, people.index(person)])
    pool, tests = split(examples, person, command.held, rng)
    wanted = {n for held in tests.values() for n in held}
    learned = [n for group in pool for n in group[: count or None]]
    answers = answer(method, command, examples, model, learned, wanted, draw)
    results = []
    for tested, held in tests.items():
        truth = [examples.vocabulary.index(examples.group[n]) for n in held]
        right = float(np.mean(answers[held] == truth))
        one = Result(method, count, person, tested, draw, right, command.settings)
        results.append(one)
    return results


def split(
    examples: RecordedExamples, person: str, held: int, rng: np.random.Generator
) -> tuple[list[list[int]], dict[str, list[int]]]:
    """Return the examples of each group of a person, and what each person is tested on.

    Sources are in random order, those of one group that are held out first. Other
    people are tested on as many.
    """
    groups, people = examples.vocabulary[1:], sorted(set(examples.person))
    pool: list[list[int]] = []
    tests: dict[str, list[int]] = {name: [] for name in people}
    for name in people:
        for group in groups:
            parts = list(examples.find(name, group).values())
            order = [parts[n] for n in rng.permutation(len(parts))]
            tests[name] += [n for part in order[:held] for n in part]
            if name == person:
                pool.append([n for part in order[held:] for n in part])
    return pool, tests


def answer(
    method: Method,
    command: Command,
    examples: RecordedExamples,
    model: Model,
    learned: list[int],
    wanted: Collection[int],
    seed: int,
) -> Int[np.ndarray, "recording"]:
    """Return the classes of the wanted recordings, as learned from others."""
    if method == "nearest":
        return find_nearest(compute_features(command), examples, learned)
    config = TrainConfig(
        epochs=command.epochs,
        steps=command.steps,
        readings=command.readings,
        validation=0.0,
    )
    start = model if method == "start" else None
    if start is not None:
        config = replace(config, network=start.card.network)
    trainer = Trainer(
        examples.dataset, examples.vocabulary, config, learned, seed, start=start
    )
    return classify(trainer.run(quiet=True), examples, wanted)


def classify(
    network: RecogniserNetwork, examples: RecordedExamples, wanted: Collection[int]
) -> Int[np.ndarray, "recording"]:
    """Return the classes of the wanted recordings; `none` for others and no touch."""
    segments = [x for x in examples.dataset.labelled if x.recording in wanted]
    scores = score_segments(network, examples.dataset, segments)
    scores[:, examples.vocabulary.index(NONE)] = -np.inf
    found = np.full(len(examples.group), examples.vocabulary.index(NONE))
    found[[segment.recording for segment in segments]] = scores.argmax(axis=1)
    return found


@cache
def compute_features(command: Command) -> Float[np.ndarray, "recording feature"]:
    """Return the features of every recording by the weights; NaN without a touch.

    They are mean, spread and maximum over the labelled rows.
    """
    dataset = load_examples(command).dataset
    network = to_network(load_model(command.model))
    rows: dict[int, np.ndarray] = {}
    for segment in dataset.labelled:
        features = embed_rows(network, dataset, np.arange(segment.first, segment.end))
        rows[segment.recording] = features.detach().numpy()
    missing = np.full((1, next(iter(rows.values())).shape[1]), np.nan)
    whole = [rows.get(number, missing) for number in range(len(dataset.recordings))]
    return np.stack([describe_rows(each) for each in whole])


def describe_rows(
    rows: Float[np.ndarray, "row feature"],
) -> Float[np.ndarray, "three_features"]:
    """Return mean, spread and maximum of the features of some rows."""
    return np.concatenate([rows.mean(axis=0), rows.std(axis=0), rows.max(axis=0)])


def find_nearest(
    features: Float[np.ndarray, "recording feature"],
    examples: RecordedExamples,
    learned: Sequence[int],
) -> Int[np.ndarray, "recording"]:
    """Return the class of the nearest example of every recording."""
    learned = [n for n in learned if np.isfinite(features[n]).all()]
    known = features[learned]
    spread = known.std(axis=0) + 1e-6
    away = np.linalg.norm((features[:, None] - known) / spread, axis=-1)
    classes = np.array([examples.vocabulary.index(examples.group[n]) for n in learned])
    found = classes[np.nan_to_num(away, nan=np.inf).argmin(axis=1)]
    lost = ~np.isfinite(features).all(axis=1)
    return np.where(lost, examples.vocabulary.index(NONE), found)


def format_table(command: Command, results: Sequence[Result], same: bool) -> str:
    """Format accuracies with their intervals, a row for each number of examples."""
    rng = np.random.default_rng(0)
    lines = [format_head(["examples", *command.methods])]
    for count in command.examples:
        cells = []
        for method in command.methods:
            found = [
                result.accuracy
                for result in results
                if (result.method, result.examples) == (method, count)
                and (result.person == result.tested) == same
            ]
            cells.append(format_share(np.array(found), rng))
        lines.append(format_row([str(count or "all"), *cells]))
    return "\n".join(lines)


def format_share(shares: Float[np.ndarray, "draw"], rng: np.random.Generator) -> str:
    """Format a mean with its bootstrapped 95 % interval, in percent."""
    if not len(shares):
        return "-"
    draws = rng.choice(shares, (BOOTSTRAPS, len(shares))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    return f"{100 * shares.mean():.1f} ({100 * low:.1f} to {100 * high:.1f})"


if __name__ == "__main__":
    main()
