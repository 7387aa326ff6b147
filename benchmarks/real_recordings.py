"""Gestures of people never trained on, on the public recordings.

    python -m benchmarks.real_recordings sleeve --data ../shared/data/sleeve
    python -m benchmarks.real_recordings shearsense --data ../shared/data/shearsense

Leaves one session (sleeve) or one participant (ShearSense) out at a time, trains the
recogniser with `eskin train`'s defaults on the others, and answers what was left out;
the classical classifiers answer the same examples from hand-made features. With
`--start ur5` a second recogniser, as large as that model, starts from its weights in
place of random ones, and what that adds is printed. Prints the tables of
docs/results.md.
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
    """Recognise the public recordings, leaving people or sessions out."""

    kind: tyro.conf.Positional[Literal["sleeve", "shearsense"]]
    """Which set."""

    data: Path
    """Its folder, as downloaded."""

    picture: Path | None = None
    """Where to draw the recogniser's confusions (.png)."""

    seed: int = 0
    """Decides everything that is drawn."""

    workers: int = 2
    """Processes to train in."""

    start: Path | None = None
    """A model to start a second recogniser from."""

    train: TrainConfig = field(default_factory=lambda: TrainConfig(validation=0.0))
    """How the recogniser is trained."""


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
        title = f"{command.kind}: {result.accuracy:.1%} right"
        draw_confusion(result.confusion, answers.vocabulary, command.picture, title)
    print(f"\n{time.monotonic() - started:.0f} s")


def sleeve(paths: tuple[Path, ...], command: Command) -> Answers:
    """Segments and instants, leaving one session out."""
    dataset = prepare(paths)
    groups = find_groups(dataset, "session")
    networks = train_folds(
        dataset, groups, command.train, command.seed, command.workers
    )
    segments = classify_segments(dataset, groups, networks, False, command.seed)
    print(table("Whole segments", segments))
    tell_start(dataset, groups, command, command.train, segments)
    instants = classify_instants(dataset, groups, networks, command.seed)
    print(table("Every instant, none among the classes", instants, whole=True))
    return segments


def shearsense(paths: tuple[Path, ...], command: Command) -> Answers:
    """Recordings, leaving one participant out, without and with shear."""
    pressure = without_one_person(paths, command, False)
    print(table("Recordings, pressure", pressure))
    both = without_one_person(paths, command, True)
    print(table("Recordings, pressure and shear", both))
    right = [a.predicted[OURS] == a.truth for a in (both, pressure)]
    print(f"\nShear adds {difference(*right)} points to the recogniser.")
    return both


def without_one_person(
    paths: tuple[Path, ...], command: Command, shear: bool
) -> Answers:
    """Recordings of each person, answered without having seen that person.

    Without shear nothing is known of it, not even which taxels it touches.
    """
    config = replace(command.train, shear=shear)
    dataset = prepare(paths, graph=config.graph_used)
    groups = find_groups(dataset, "subject")
    networks = train_folds(dataset, groups, config, command.seed, command.workers)
    answers = classify_segments(dataset, groups, networks, shear, command.seed)
    tell_start(dataset, groups, command, config, answers)
    return answers


def tell_start(
    dataset: Dataset,
    groups: list[str],
    command: Command,
    config: TrainConfig,
    scratch: Answers,
) -> None:
    """Train once more from a model's weights, and once as large from random ones."""
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
    """One row a method: accuracy, macro F1, each group, and the distance from ours.

    Args:
        title: of the table.
        answers: to score.
        whole: whether intervals draw whole recordings in place of single examples.
    """
    cluster = answers.recordings if whole else None
    names = sorted(set(answers.groups))
    rows = [
        f"\n**{title}** ({len(answers.truth)} examples, "
        f"{len(answers.vocabulary)} classes)\n",
        f"| method | accuracy | macro F1 | eskin ahead by | {' | '.join(names)} |",
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
    """Difference in accuracy with its paired bootstrap interval, in points."""
    low, high = bootstrap_difference(ours, theirs, cluster=cluster)
    mean = ours.mean() - theirs.mean()
    return f"{100 * mean:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"


if __name__ == "__main__":
    main()
