"""`eskin train`: train the recogniser on recordings."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import tyro

from eskin.cli.checks import check_writable, tell_cut
from eskin.errors import ModelError, RecordingError
from eskin.graph import GraphConfig
from eskin.learn.checkpoint import to_model
from eskin.learn.dataset import Dataset, hash_recordings, prepare
from eskin.learn.evaluation import check_fits, evaluate
from eskin.learn.events import choose_decision, trace_recordings
from eskin.learn.recording_transforms import Aging, AgingConfig
from eskin.learn.training import TrainConfig, Trainer
from eskin.model import Model, ModelCard, check_limits, load_model, save_model
from eskin.recording import NONE, find_recordings

SIZES = ("width", "layers", "channels")
"""Of a network, without which no weights of another fit."""


@dataclass(frozen=True)
class Command:
    """Train the recogniser on recordings."""

    data: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    out: Path
    """Where to write the model (.safetensors)."""

    val: tuple[Path, ...] = ()
    """Recordings to validate on; where none is given, some of the others."""

    streams: tuple[Path, ...] = ()
    """Recorded streams to choose on how sure is sure; the defaults where none is."""

    start: Path | None = None
    """A model to start from, of those that come with eskin or a file, with a network of
    the same sizes: its weights are taken wherever they fit."""

    test: tuple[Path, ...] = ()
    """Recordings to score the model on when it is done."""

    classes: tuple[str, ...] = ()
    """Gestures to learn; all that are labelled where none is named."""

    seed: int = 0
    """Decides everything that is drawn."""

    pack: Path | None = None
    """Folder that keeps prepared recordings, so that each is prepared once only."""

    skins: int = 0
    """Other skins to learn each recording of, besides the one that recorded it."""

    wear: AgingConfig = field(default_factory=AgingConfig)
    """How far those may be from it."""

    train: TrainConfig = field(default_factory=TrainConfig)
    """How to train."""

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, {"skins": (0, np.inf)})


def run(command: Command) -> dict[str, object]:
    """Train, write the model, and score it where test recordings are given.

    A training that is cut leaves what it has come to beside the model; the same command
    goes on from there.
    """
    started = time.monotonic()
    check_writable(command.out)
    paths = find_recordings(command.data)
    find_recordings(command.streams)  # Refused now rather than after the training.
    start = loaded_start(command)
    skins = tuple(Aging(command.wear, number) for number in range(command.skins))
    dataset = prepared(command, paths, command.train.graph_used, skins)
    vocabulary = chosen_classes(dataset, command.classes)
    validation, test = (
        prepared(command, find_recordings(data), trained_on(command, dataset))
        if data
        else None
        for data in (command.val, command.test)
    )
    trainer = Trainer(
        *(dataset, vocabulary, command.train),
        seed=command.seed,
        validation=validation,
        start=start,
    )
    tell_cut(dataset, validation, test)
    if validation is None:
        print(trainer.holdout)
    content = hash_recordings(paths)
    card = first_card(command, trainer, content)
    if test is not None:
        check_fits(card, test)
    kept = command.out.with_name(command.out.name + ".training")
    facts = f"{content} {vocabulary} {command.train} {command.seed} {skins}"
    facts += f" {hash_recordings(find_recordings(command.val))}" if command.val else ""
    facts += f" {start.digest}" if start else ""
    network = trainer.run(checkpoint=kept, facts=facts)
    right = trainer.validation_accuracy()
    card = replace(
        card,
        temperature=trainer.fit_temperature(),
        metrics={"val_accuracy": right} if trainer.held_out else {},
    )
    model = decided(to_model(network, card), command)
    scored = evaluate(network, card, test).segments.accuracy if test else None
    save_model(command.out, model)
    kept.unlink(missing_ok=True)
    result = {
        "val_accuracy": round(right, 4) if trainer.held_out else None,
        "test_accuracy": None if scored is None else round(scored, 4),
        "epochs": trainer.epochs,
        "seconds": round(time.monotonic() - started, 1),
    }
    print(f"{command.out}: " + ", ".join(f"{k} {v}" for k, v in result.items()))
    return result


def loaded_start(command: Command) -> Model | None:
    """The model to start from; None where none is named.

    Raises:
        ModelError: there is no such model, or its network has other sizes.
    """
    if command.start is None:
        return None
    model = load_model(command.start)
    theirs, ours = (
        {size: getattr(network, size) for size in SIZES}
        for network in (model.card.network, command.train.network)
    )
    if theirs != ours:
        flags = " ".join(f"--train.network.{size} {n}" for size, n in theirs.items())
        raise ModelError(
            f"--start {command.start} has a network of {told(theirs)}, the one to be "
            f"trained {told(ours)}; allowed are the same sizes; train with {flags}"
        )
    return model


def told(sizes: Mapping[str, int]) -> str:
    """Sizes of a network in words."""
    return ", ".join(f"{size} {number}" for size, number in sizes.items())


def first_card(command: Command, trainer: Trainer, content: str) -> ModelCard:
    """What is known of a model before it is trained."""
    return ModelCard(
        vocabulary=trainer.vocabulary,
        kind="shear" if trainer.shear else "pressure",
        network=command.train.network,
        graph=trainer.graph,
        training=flat(asdict(command.train)) | facts_of(command),
        data_digest=content,
    )


def facts_of(command: Command) -> dict[str, str]:
    """What else of the command the card tells."""
    facts = {"seed": str(command.seed), "skins": str(command.skins)}
    facts |= {"start": str(command.start)} if command.start else {}
    return facts | (flat(asdict(command.wear), "wear.") if command.skins else {})


def decided(model: Model, command: Command) -> Model:
    """The model with the decision that does best on the streams given."""
    if not command.streams:
        return model
    paths = find_recordings(command.streams)
    heard = list(trace_recordings(paths, model, command.train.workers))
    decision, score = choose_decision(heard)
    print(f"{decision}: F1 {score.total.f1:.3f} on {score.hours:.2f} h of streams")
    metrics = model.card.metrics | {"streams_f1": score.total.f1}
    return replace(model, card=replace(model.card, decision=decision, metrics=metrics))


def prepared(
    command: Command,
    paths: tuple[Path, ...],
    graph: GraphConfig,
    skins: tuple[Aging, ...] = (),
) -> Dataset:
    """Recordings made ready for learning."""
    workers = command.train.workers
    transforms = (None, *skins)
    return prepare(
        paths, graph=graph, pack=command.pack, workers=workers, transforms=transforms
    )


def trained_on(command: Command, dataset: Dataset) -> GraphConfig:
    """The graphs that the network takes."""
    shear = command.train.shear and dataset.has_shear
    return command.train.graph if shear else command.train.graph.without_shear()


def chosen_classes(dataset: Dataset, asked: tuple[str, ...]) -> tuple[str, ...]:
    """`none` and the gestures to learn.

    Raises:
        RecordingError: if one of them is never made in the recordings.
    """
    known = dataset.vocabulary
    missing = sorted(set(asked) - set(known))
    if missing:
        raise RecordingError(
            f"no recording is labelled {', '.join(missing)}; labelled are "
            f"{', '.join(known)}; name some of these with --classes"
        )
    return (NONE, *(g for g in known[1:] if not asked or g in asked))


def flat(config: dict[str, object], prefix: str = "") -> dict[str, str]:
    """A nested configuration as one level of text."""
    entries: dict[str, str] = {}
    for name, value in config.items():
        if isinstance(value, dict):
            entries |= flat(value, f"{prefix}{name}.")
        else:
            entries[prefix + name] = str(value)
    return entries
