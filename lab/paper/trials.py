"""This module trains the methods of the paper's experiments and sums up the answers.

A trial trains one method on one draw of a form of the paper's data set. Its answers are
kept in a file, so that parts share trials, and an interrupted run goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from eskin_paper_network import Distance, Pooling

from eskin.learn.config import AugmentConfig
from eskin.learn.metrics import bootstrap_accuracy, bootstrap_difference
from lab.baselines import FitConfig, PaperBaseline
from lab.comparison.examples import find_examples
from lab.comparison.methods import FIT_CONFIGS, METHODS, BaselineMethod, Method
from lab.comparison.results import AnsweredClips, MethodResult, TrainingTask
from lab.comparison.table import ENOUGH_GROUPS
from lab.simulated_sets import made_set

FORMS = {
    "paper": "as now",
    "paper-places": "few places",
    "paper-person": "few places, one person",
    "paper-folded": "folded poses",
}
"""Names of the sets as large as the paper's, and what they are called in tables."""

NEIGHBOURS = (4, 8, 16, 32)
"""Numbers of neighbours of Fig. 11."""

DISTANCES: dict[Distance, str] = {
    "kinematic": "kinematic, live edges",
    "geometric": "geometric, fixed edges",
    "patch": "inside patches alone",
    "none": "no distance",
}
"""Distances between taxels, and what they are called in tables."""


SLOWER_RATE = 1e-3
"""Learning rate of the paper's network with more neighbours than eight, whose messages
are larger sums, and with mean pooling: the usual rate does not train these."""

MEAN_PATIENCE = 30
"""Patience with mean pooling [epochs]: the mean over 2112 taxels of which few are
touched hardly changes, and the network answers by chance for many epochs at first."""


def build_paper_method(
    k: int = 8,
    pooling: Pooling = "max",
    distance: Distance = "kinematic",
    augment: AugmentConfig | None = None,
    on_touch: bool = False,
) -> Method:
    """Return the paper's network on every fourth reading, trained until it stops.

    Args:
        k: number of neighbours of a taxel inside its patch.
        pooling: pooling over the nodes of a reading.
        distance: distance between taxels.
        augment: limits of the augmentation, if any.
        on_touch: whether it sees the segmented touch alone.
    """
    config = replace(FIT_CONFIGS["paper"], augment=augment)
    if k > 8 or pooling == "mean":
        config = replace(config, rate=SLOWER_RATE)
    if pooling == "mean":
        config = replace(config, patience=MEAN_PATIENCE)
    make = partial(
        PaperBaseline,
        config=config,
        k=k,
        pooling=pooling,
        distance=distance,
        stride=4,
    )
    return BaselineMethod(make, on_touch)


def shorten_training(method: Method, epochs: int) -> Method:
    """Return a method whose network is trained for fewer epochs, if it is one."""
    if not isinstance(method, BaselineMethod) or not isinstance(method.make, partial):
        return method
    config = method.make.keywords.get("config")
    if config is None:
        return method
    make = partial(method.make, config=replace(config, epochs=epochs))
    return replace(method, make=make)


TEN_EPOCHS = FitConfig(epochs=10, batch=4, rate=5e-4, schedule="constant")
"""Training that was chosen for the paper's network before it was trained until it
stops."""


def build_at_every_reading(config: FitConfig) -> Method:
    """Return the paper's network on every reading.

    Args:
        config: settings of the training.
    """
    make = partial(
        PaperBaseline,
        config=config,
        k=8,
        pooling="max",
        distance="kinematic",
        stride=1,
    )
    return BaselineMethod(make)


def name_cell(k: int, pooling: Pooling) -> str:
    """Return the name of a method of Fig. 11; in Table II it has the paper's name."""
    return "paper" if (k, pooling) == (8, "max") else f"paper-k{k}-{pooling}"


def name_distance(distance: Distance) -> str:
    """Return the name of the paper's network with a distance between taxels."""
    return "paper" if distance == "kinematic" else f"paper-{distance}"


POOLINGS: tuple[Pooling, ...] = ("max", "mean")
TRIED: dict[str, Method] = {
    **METHODS,
    **{
        name_cell(k, pooling): build_paper_method(k, pooling)
        for k in NEIGHBOURS
        for pooling in POOLINGS
    },
    **{name_distance(each): build_paper_method(distance=each) for each in DISTANCES},
    "paper-ten-epochs": build_at_every_reading(TEN_EPOCHS),
    "paper-every-reading": build_at_every_reading(
        replace(TEN_EPOCHS, epochs=60, held_out=0.15, patience=10)
    ),
    "paper-augmented": build_paper_method(augment=AugmentConfig()),
    "paper-on-touch": build_paper_method(on_touch=True),
}
"""All methods that are tried, by name."""


@dataclass(frozen=True)
class Trial:
    """A trial names one training."""

    form: str
    """Name of the set, one of `FORMS`."""
    method: str
    """Name of the method, one of `TRIED`."""
    draw: int
    """Number of the draw of the set, and seed of the training."""


@dataclass(frozen=True)
class Place:
    """A place says where sets are, and how large they are."""

    sets: Path
    """Folder of the sets."""
    clips: int | None
    """Number of clips of a set; the paper's number if None."""
    people: int | None
    """Number of people of a set; the set's number if None."""
    workers: int
    """Number of processes."""
    epochs: int | None = None
    """Number of epochs of the paper's network; None trains it until it stops."""

    @property
    def results(self) -> Path:
        """Return the file of kept answers."""
        return self.sets / "kept" / "paper.jsonl"


def build_task(trial: Trial, place: Place) -> TrainingTask:
    """Return the training of a trial; its set is generated if it is missing."""
    people = 1 if trial.form == "paper-person" and place.people else place.people
    folder = made_set(
        place.sets,
        trial.form,
        clips=place.clips,
        people=people,
        seed=trial.draw,
        workers=place.workers,
    )
    pack = place.sets / "pack"
    train = find_examples([folder / "train"], pack, place.workers)
    test = find_examples([folder / "test"], pack, place.workers)
    method = TRIED[trial.method]
    if place.epochs is not None:
        method = shorten_training(method, place.epochs)
    return TrainingTask(trial.method, method, train, {"test": test}, trial.draw)


Answers = Mapping[Trial, MethodResult]
"""Answers of the trials that have been run."""


@dataclass(frozen=True)
class Accuracy:
    """An accuracy is a mean over clips of all draws, with its interval."""

    mean: float
    """Share of clips answered rightly."""
    low: float
    """Lower end of the 95 % bootstrap interval, over people where there are at least
    `ENOUGH_GROUPS`, else over clips."""
    high: float
    """Upper end."""
    draws: int
    """Number of draws."""

    def __str__(self) -> str:
        """Return the accuracy in percent, with its interval."""
        ends = f"{100 * self.low:.1f}-{100 * self.high:.1f}"
        return f"{100 * self.mean:.1f} ({ends})"


def join_answers(
    answers: Answers, form: str, method: str, test: str
) -> dict[int, AnsweredClips]:
    """Return the answers of a method on a form, by draw."""
    return {
        trial.draw: result.answered[test]
        for trial, result in answers.items()
        if (trial.form, trial.method) == (form, method) and test in result.answered
    }


def compute_accuracy(
    answers: Answers, form: str, method: str, test: str
) -> Accuracy | None:
    """Return the accuracy of a method on a form; None without answers.

    Args:
        answers: answers of trials.
        form: name of the set.
        method: name of the method.
        test: `val` or `test`.
    """
    found = join_answers(answers, form, method, test)
    if not found:
        return None
    correct = np.concatenate([each.correct for each in found.values()])
    interval = bootstrap_accuracy(correct, list_clusters(found))
    return Accuracy(float(correct.mean()), *interval, len(found))


def format_lead(answers: Answers, form: str, method: str, other: str) -> str:
    """Return how many points a method is ahead on the test, paired; empty without."""
    ours = join_answers(answers, form, method, "test")
    theirs = join_answers(answers, form, other, "test")
    both = sorted(ours.keys() & theirs.keys())
    if not both:
        return ""
    one = np.concatenate([ours[draw].correct for draw in both])
    two = np.concatenate([theirs[draw].correct for draw in both])
    clusters = list_clusters({draw: ours[draw] for draw in both})
    low, high = bootstrap_difference(one, two, cluster=clusters)
    points = 100 * float(one.mean() - two.mean())
    return f"{points:+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"


def list_clusters(found: Mapping[int, AnsweredClips]) -> Sequence[str]:
    """Return the units that intervals draw: people, or clips where people are few."""
    people = [f"{draw} {name}" for draw, each in found.items() for name in each.people]
    if len(set(people)) >= ENOUGH_GROUPS:
        return people
    return [str(number) for number in range(len(people))]
