"""This module trains and scores models on recordings, each in one call.

Commands, examples and notebooks call these functions, so that there is one way.
"""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
from jaxtyping import Int

from eskin.errors import RecordingError
from eskin.files import shorten
from eskin.learn.checkpoint import load_checkpoint, to_model, to_network
from eskin.learn.config import TrainConfig
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.evaluation import (
    Evaluation,
    check_fits,
    score_dataset,
    score_held_out,
)
from eskin.learn.events import choose_decision, trace_recordings
from eskin.learn.live_answers import gather_answers
from eskin.learn.metrics import ClassificationScore, bound_accuracy, label_counts
from eskin.learn.plan import TrainingPlan, resolve_plan
from eskin.learn.processes import ALONE, Processes
from eskin.learn.training import Trainer
from eskin.learn.training_data import read_training_data
from eskin.live import ESKIN, Model, load_model
from eskin.progress import show_line
from eskin.recording import Recording, find_recordings, read_recording

logger = logging.getLogger(__name__)

Places = str | Path | Recording | Iterable[str | Path | Recording]
"""Recordings, their paths, or folders of them; one or several."""


def train(
    recordings: Places,
    start: Model | str | Path | None = None,
    *,
    validation: Places = (),
    streams: Places = (),
    classes: Sequence[str] = (),
    seed: int = 0,
    config: TrainConfig | None = None,
) -> Model:
    """Train a recogniser on labelled recordings.

    Args:
        recordings: recordings, their paths, or folders of them.
        start: model to start from, its name or its path, whose weights and sizes are
            taken.
        validation: recordings to validate on; by default some of the others are held
            out, in whole sessions.
        streams: recordings to choose the decision thresholds on; without any, the
            defaults are kept.
        classes: gestures to learn; by default all that are labelled.
        seed: random seed.
        config: settings of the training, such as
            `eskin.TrainConfig(epochs=2, steps=5)`.

    Returns:
        The model, to be used by `eskin.Recognizer` or saved by `Model.save`. Its
        `card.metrics` hold `val_accuracy`, where recordings were held out.

    Raises:
        RecordingError: recordings cannot be learned from, or their labels cannot be
            right.
        ModelError: there is no such model to start from, or training diverged.
        ValueError: the settings are no `eskin.TrainConfig`.
    """
    config = check_config(config)
    plan = TrainingPlan(
        list_paths(recordings),
        start,
        validation=list_paths(validation),
        streams=list_paths(streams),
        classes=tuple(classes),
        seed=seed,
        config=config,
    )
    return run_training(plan).model


def check_config(config: TrainConfig | None) -> TrainConfig:
    """Return the settings of a training, the defaults for None.

    Raises:
        ValueError: they are something else, such as a dictionary.
    """
    if config is None:
        return TrainConfig()
    if not isinstance(config, TrainConfig):
        raise ValueError(
            f"config is {shorten(config)}; allowed is an eskin.TrainConfig; give for "
            "example config=eskin.TrainConfig(epochs=2, steps=5)"
        )
    return config


def evaluate(model: Model | str | Path, recordings: Places) -> Evaluation:
    """Score a model on labelled recordings, gesture by gesture.

    Args:
        model: model, its name, or the path of its file.
        recordings: recordings, their paths, or folders of them.

    Returns:
        The scores, such as `segments.accuracy` with its `interval`, `per_subject` and
        `segments.label_confusion()`.

    Raises:
        RecordingError: the recordings have no labels, or some that cannot be right.
        SkinMismatchError: the recordings lack what the model needs, or hold gestures
            that it does not know.
    """
    model = model if isinstance(model, Model) else load_model(model)
    card = model.card
    dataset = prepare(list_paths(recordings), card.pipeline, card.graph_used)
    return evaluate_model(model, dataset)


def cross_validate(
    recordings: Places,
    start: Model | str | Path | None = None,
    *,
    by: Literal["subject", "session"] = "subject",
    classes: Sequence[str] = (),
    seed: int = 0,
    config: TrainConfig | None = None,
) -> "CrossValidation":
    """Hold out each person in turn: train on all others, and score on that one.

    Who is held out is printed to stderr, with how many are still to come.

    Args:
        recordings: labelled recordings, their paths, or folders of them.
        start: model to start from, as for `train`.
        by: what is held out at a time: all recordings of a person (`subject`), or of
            a session.
        classes: gestures to learn; by default all that are labelled.
        seed: random seed.
        config: settings of each training, as for `train`.

    Raises:
        RecordingError: all recordings are of one person, or as for `train`.
        ValueError: the settings are no `eskin.TrainConfig`.
    """
    config = check_config(config)
    origins = {path: read_recording(path).metadata for path in list_paths(recordings)}
    groups: dict[str, list[Path]] = {}
    for path, origin in origins.items():
        groups.setdefault(getattr(origin, by), []).append(path)
    if len(groups) < 2:
        several = len({origin.session for origin in origins.values()}) > 1
        raise RecordingError(
            f"all recordings have {by} '{next(iter(groups), '')}'; allowed are two and "
            f"more to hold one out; give recordings of more than one {by}"
            + (', or hold out a session at a time with by="session"' if several else "")
        )
    found = {}
    with TemporaryDirectory(prefix="eskin-") as pack:
        for number, held in enumerate(sorted(groups), 1):
            show_line(f"{by} {number} of {len(groups)} is held out: {held}")
            others = [path for name in groups if name != held for path in groups[name]]
            plan = TrainingPlan(
                tuple(others),
                start,
                classes=tuple(classes),
                seed=seed,
                config=config,
                pack=Path(pack),
                test=tuple(groups[held]),
            )
            test = run_training(plan).test
            assert test is not None
            found[held] = test
    return CrossValidation(found)


@dataclass(frozen=True)
class CrossValidation:
    """A cross-validation holds the scores of each person by a model of all others."""

    evaluations: Mapping[str, Evaluation]
    """Evaluations by the name of the person, or session."""

    @property
    def per_subject(self) -> dict[str, float]:
        """Return the accuracy on the gestures of each person, or session."""
        pairs = self.evaluations.items()
        return {name: each.segments.accuracy for name, each in pairs}

    @property
    def accuracy(self) -> float:
        """Return the accuracy on the gestures of all."""
        confusion = self.confusion
        return float(np.trace(confusion) / confusion.sum())

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of that on further people, or sessions."""
        correct: list[bool] = []
        cluster: list[str] = []
        for name, each in self.evaluations.items():
            confusion = each.segments.confusion
            right = int(np.trace(confusion))
            wrong = int(confusion.sum()) - right
            correct += [True] * right + [False] * wrong
            cluster += [name] * (right + wrong)
        return bound_accuracy(np.array(correct), cluster)

    @property
    def confusion(self) -> Int[np.ndarray, "class class"]:
        """Return the counts of all gestures by true and predicted class."""
        return np.sum([e.segments.confusion for e in self.evaluations.values()], axis=0)

    def label_confusion(self) -> Any:  # noqa: ANN401
        """Return those counts with the names of the classes, as `label_counts`."""
        first = next(iter(self.evaluations.values()))
        return label_counts(self.confusion, tuple(first.segments.per_class))


@dataclass(frozen=True)
class Training:
    """A training holds the model that it gave."""

    model: Model
    """The model."""
    epochs: int
    """Number of epochs that were trained."""
    stopped: bool
    """Whether it was interrupted, so that it can be continued."""
    test: Evaluation | None
    """Scores on the recordings to test on."""
    held_out: ClassificationScore | None = None
    """Score of the gestures that were held out; None without any, and for clips."""


def list_paths(places: Places) -> tuple[Path, ...]:
    """Return the paths of recordings, and of all below folders."""
    several = [places] if isinstance(places, str | Path | Recording) else places
    return find_recordings(
        place.path if isinstance(place, Recording) else place for place in several
    )


def run_training(
    plan: TrainingPlan,
    checkpoint: Path | None = None,
    processes: Processes = ALONE,
    tell: Callable[[str], object] = logger.info,
) -> Training:
    """Train a model, as one of some processes.

    Args:
        plan: what to train.
        checkpoint: file from which an interrupted training continues; the caller
            removes it.
        processes: processes that train together; the first one prepares recordings.
        tell: takes lines about held-out and about left-out recordings.

    Raises:
        RecordingError: recordings cannot be learned from.
        ModelError: the model to start from cannot be used, the checkpoint is of
            another training, or training diverged.
    """
    resolved = resolve_plan(plan)
    plan = resolved.plan
    facts = resolved.facts
    if checkpoint is not None and processes.is_first:
        # Refused before recordings are prepared, which takes minutes.
        load_checkpoint(checkpoint, f"{facts} {processes.count}")
    data = read_training_data(plan, processes, tell)
    card = resolved.build_card(data.vocabulary, data.dataset.has_shear)
    if data.test is not None:
        check_fits(card, data.test)
    trainer = Trainer(
        data.dataset,
        data.vocabulary,
        plan.config,
        seed=plan.seed,
        validation=data.validation,
        start=resolved.start,
        processes=processes,
    )
    if data.validation is None:
        tell(str(trainer.holdout))
    network = trainer.run(checkpoint=checkpoint, facts=facts)
    if not processes.is_first:
        return Training(Model({}, card), trainer.epochs, trainer.stopped, None)
    accuracy, temperature = trainer.score_held_out()
    card = replace(
        card,
        temperature=temperature,
        metrics={"val_accuracy": accuracy} if trainer.held_out else {},
    )
    model = set_decision(to_model(network, card), plan, tell)
    scores = None
    if data.test is not None:
        scores = score_dataset(network, card, data.test)
    held = None
    if trainer.held_out is not None:
        recordings = trainer.held_recordings
        held = score_held_out(network, card, trainer.held_out.dataset, recordings)
    return Training(model, trainer.epochs, trainer.stopped, scores, held)


def evaluate_model(model: Model, dataset: Dataset) -> Evaluation:
    """Score a model, of eskin's own or of another package, on prepared recordings.

    Raises:
        RecordingError: if the recordings have no labels.
        SkinMismatchError: if the recordings lack what the model needs, or hold
            gestures that it does not know.
    """
    if model.card.recogniser == ESKIN:
        network = to_network(model)
    else:
        network = gather_answers(model, dataset)
    return score_dataset(network, model.card, dataset)


def set_decision(
    model: Model, plan: TrainingPlan, tell: Callable[[str], object]
) -> Model:
    """Return the model with the decision that scores best on the streams given."""
    if not plan.streams:
        return model
    workers = plan.config.workers
    traces = list(trace_recordings(plan.streams, model, workers, plan.overrides))
    decision, score = choose_decision(traces)
    tell(f"{decision}: F1 {score.total.f1:.3f} on {score.hours:.2f} h of streams")
    metrics = model.card.metrics | {"streams_f1": score.total.f1}
    return replace(model, card=replace(model.card, decision=decision, metrics=metrics))
