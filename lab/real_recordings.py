"""Cross-validate the recogniser and baselines on the public recordings.

    python -m lab.real_recordings sleeve --data ../shared/data/sleeve
    python -m lab.real_recordings shearsense --data ../shared/data/shearsense
    python -m lab.real_recordings socialtouch --data ../shared/data/socialtouch

One session (sleeve) or one participant (ShearSense, SocialTouch) is held out at a time.
The recogniser is trained with the defaults of `eskin train` on the others and tested on
the held-out one; classical classifiers are tested on the same examples with hand-made
features, and a convolutional network on the pressures of all taxels. With `--start ur5`
a second recogniser of the size of that model starts from its weights instead of random
ones, and the gain is printed. The command prints the
tables of docs/results.md.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from eskin.learn.dataset import Dataset, prepare
from eskin.learn.metrics import (
    bootstrap_difference,
    compute_group_accuracies,
    score_predictions,
)
from eskin.learn.plots import draw_confusion
from eskin.learn.sets import (
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
)
from eskin.learn.sets.socialtouch import find_group
from eskin.learn.training import TrainConfig
from eskin.live import load_model
from eskin.recording import NONE, find_recordings
from lab.crossvalidation import (
    Answers,
    classify_instants,
    classify_segments,
    find_groups,
    train_folds,
)

OURS = "eskin"

Measure = Callable[[tuple[Path, ...], "Command"], Answers]


@dataclass(frozen=True)
class Command:
    """Cross-validate on the public recordings, with people or sessions held out."""

    kind: tyro.conf.Positional[Literal["sleeve", "shearsense", "socialtouch"]]
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
    convert, measure = KINDS[command.kind]
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


def socialtouch(paths: tuple[Path, ...], command: Command) -> Answers:
    """Classify repetitions as gestures, then as groups, with a person held out."""
    dataset = prepare(paths, graph=command.train.select_graph())
    gestures = cross_validate(dataset, "subject", command, command.train)
    print(table("Repetitions, all gestures", gestures))
    grouped = rename_gestures(dataset, find_group)
    groups = cross_validate(grouped, "subject", command, command.train)
    print(table("Repetitions, groups of gestures", groups))
    return groups


def rename_gestures(dataset: Dataset, rename: Callable[[str], str]) -> Dataset:
    """Return a data set whose gestures other than `none` have other names."""
    names = {
        name: name if name == NONE else rename(name) for name in dataset.vocabulary
    }
    return replace(
        dataset,
        gestures=tuple(names[name] for name in dataset.gestures),
        segments=tuple(
            replace(segment, gesture=names[segment.gesture])
            for segment in dataset.segments
        ),
    )


def classify_held_out_people(
    paths: tuple[Path, ...], command: Command, shear: bool
) -> Answers:
    """Classify the recordings of each person with training on the others.

    Without shear no shear information is used, not even which taxels it touches.
    """
    config = replace(command.train, shear=shear)
    dataset = prepare(paths, graph=config.select_graph())
    return cross_validate(dataset, "subject", command, config)


def cross_validate(
    dataset: Dataset, by: str, command: Command, config: TrainConfig
) -> Answers:
    """Classify segments of each group, a person or a session, by all the others."""
    groups = find_groups(dataset, by)
    networks = train_folds(dataset, groups, config, command.seed, command.workers)
    answers = classify_segments(dataset, groups, networks, config.shear, command.seed)
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


KINDS: dict[str, tuple[Callable[[Path, Path], object], Measure]] = {
    "sleeve": (convert_sleeve, sleeve),
    "shearsense": (convert_shearsense, shearsense),
    "socialtouch": (convert_socialtouch, socialtouch),
}
"""Conversion and measurement of each data set, by name."""


if __name__ == "__main__":
    main()
