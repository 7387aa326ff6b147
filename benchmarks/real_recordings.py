"""Cross-validate the recogniser and baselines on the public recordings.

    python -m benchmarks.real_recordings sleeve --data ../shared/data/sleeve
    python -m benchmarks.real_recordings shearsense --data ../shared/data/shearsense

One session (sleeve) or one participant (ShearSense) is held out at a time. The
recogniser is trained with the defaults of `eskin train` on the others and tested on the
held-out one; classical classifiers are tested on the same examples with hand-made
features. With `--start ur5` a second recogniser of the size of that model starts from
its weights instead of random ones, and the gain is printed. The command prints the
tables of docs/results.md.
"""

import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from benchmarks.crossvalidation import (
    Answers,
    classify_instants,
    classify_segments,
    find_groups,
    train_folds,
)
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.metrics import (
    bootstrap_difference,
    compute_group_accuracies,
    score_predictions,
)
from eskin.learn.plots import draw_confusion
from eskin.learn.training import TrainConfig
from eskin.model import load_model
from eskin.recording import convert_shearsense, convert_sleeve, find_recordings

OURS = "eskin"


@dataclass(frozen=True)
class Command:
    """Cross-validate on the public recordings, with people or sessions held out."""

    kind: tyro.conf.Positional[Literal["sleeve", "shearsense"]]
    """Data set."""
    data: Path
    """Folder of the data set, as downloaded."""
    picture: Path | None = None
    """Path of the picture of the recogniser's confusions (.png)."""
    seed: int = 0
    """Random seed."""
    workers: int = 2
    """Number of processes for training."""
    start: Path | None = None
    """Model to start a second recogniser from."""
    train: TrainConfig = field(default_factory=lambda: TrainConfig(validation=0.0))
    """Settings of the training."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    started = time.monotonic()
    convert = convert_sleeve if command.kind == "sleeve" else convert_shearsense
    measure = sleeve if command.kind == "sleeve" else shearsense
    with tempfile.TemporaryDirectory() as folder:
        convert(command.data, Path(folder))
        answers = measure(find_recordings((Path(folder),)), command)
    if command.picture is not None:
        result = score_predictions(
            answers.truth, answers.predicted[OURS], answers.vocabulary
        )
        title = f"{command.kind}: accuracy {result.accuracy:.1%}"
        draw_confusion(result.confusion, answers.vocabulary, command.picture, title)
    print(f"\n{time.monotonic() - started:.0f} s")


def sleeve(paths: tuple[Path, ...], command: Command) -> Answers:
    """Classify segments and instants, with one session held out."""
    dataset = prepare(paths)
    groups = find_groups(dataset, "session")
    networks = train_folds(
        dataset, groups, command.train, command.seed, command.workers
    )
    segments = classify_segments(dataset, groups, networks, False, command.seed)
    print(table("Whole segments", segments))
    print_start_gain(dataset, groups, command, command.train, segments)
    instants = classify_instants(dataset, groups, networks, command.seed)
    print(table("Every instant, with the class none", instants, whole=True))
    return segments


def shearsense(paths: tuple[Path, ...], command: Command) -> Answers:
    """Classify recordings without and with shear, with one participant held out."""
    pressure = classify_held_out_people(paths, command, False)
    print(table("Recordings, pressure", pressure))
    both = classify_held_out_people(paths, command, True)
    print(table("Recordings, pressure and shear", both))
    right = [a.predicted[OURS] == a.truth for a in (both, pressure)]
    print(f"\nShear adds {difference(*right)} points to the recogniser.")
    return both


def classify_held_out_people(
    paths: tuple[Path, ...], command: Command, shear: bool
) -> Answers:
    """Classify the recordings of each person with training on the others.

    Without shear no shear information is used, not even which taxels it touches.
    """
    config = replace(command.train, shear=shear)
    dataset = prepare(paths, graph=config.graph_used)
    groups = find_groups(dataset, "subject")
    networks = train_folds(dataset, groups, config, command.seed, command.workers)
    answers = classify_segments(dataset, groups, networks, shear, command.seed)
    print_start_gain(dataset, groups, command, config, answers)
    return answers


def print_start_gain(
    dataset: Dataset,
    groups: list[str],
    command: Command,
    config: TrainConfig,
    scratch: Answers,
) -> None:
    """Train from a model's weights, and from random ones of its size; print both."""
    if command.start is None:
        return
    model = load_model(command.start)
    config = replace(config, network=model.card.network)
    started, large = (
        classify_segments(
            dataset,
            groups,
            train_folds(dataset, groups, config, command.seed, command.workers, start),
            config.shear,
            command.seed,
        )
        for start in (model, None)
    )
    rights = [a.predicted[OURS] == a.truth for a in (started, large, scratch)]
    print(
        f"\nStarted from {command.start}: {rights[0].mean():.1%}; as large from random "
        f"weights: {rights[1].mean():.1%}. The start adds {difference(*rights[:2])} "
        f"points to that, {difference(rights[0], rights[2])} to the one above."
    )


def table(title: str, answers: Answers, whole: bool = False) -> str:
    """Format accuracy, macro F1, groups and the difference of eskin, by method.

    Args:
        title: title of the table.
        answers: answers to score.
        whole: whether the bootstrap draws whole recordings, not single examples.
    """
    cluster = answers.recordings if whole else None
    names = sorted(set(answers.groups))
    rows = [
        f"\n**{title}** ({len(answers.truth)} examples, "
        f"{len(answers.vocabulary)} classes)\n",
        "| method | accuracy | macro F1 | difference of eskin [95 % interval] | "
        f"{' | '.join(names)} |",
        "|---" * (4 + len(names)) + "|",
    ]
    ours = answers.predicted[OURS] == answers.truth
    for name, predicted in answers.predicted.items():
        result = score_predictions(answers.truth, predicted, answers.vocabulary)
        right = predicted == answers.truth
        groups = compute_group_accuracies(right, answers.groups)
        ahead = "" if name == OURS else difference(ours, right, cluster)
        cells = [
            name,
            f"{result.accuracy:.1%}",
            f"{result.macro_f1:.3f}",
            ahead,
            *(f"{groups[group]:.1%}" for group in names),
        ]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def difference(
    ours: np.ndarray, theirs: np.ndarray, cluster: tuple[int, ...] | None = None
) -> str:
    """Format a difference of accuracies with its paired bootstrap interval."""
    low, high = bootstrap_difference(ours, theirs, cluster=cluster)
    mean = ours.mean() - theirs.mean()
    return f"{100 * mean:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"


if __name__ == "__main__":
    main()
