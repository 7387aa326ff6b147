"""`eskin train` trains the recogniser on recordings."""

import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import NOT_NEGATIVE, check_writable, load_overrides
from eskin.errors import ModelError, RecordingError
from eskin.learn.commands.evaluate import report_truncated
from eskin.learn.config import TrainConfig
from eskin.learn.dataset import Dataset, hash_recordings, hold_out_takes, prepare
from eskin.learn.events import choose_decision, trace_recordings
from eskin.learn.recording_transforms import Aging, AgingConfig
from eskin.live import (
    GraphConfig,
    Model,
    ModelCard,
    NetworkConfig,
    load_model,
    save_model,
)
from eskin.recording import NONE, Overrides, find_recordings
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.learn.processes import Processes
    from eskin.learn.training import Trainer

SIZES = ("width", "layers", "channels")
"""Sizes of a network that must be equal for weights to fit another one."""


@dataclass(frozen=True)
class TrainCommand:
    """Train the recogniser on recordings."""

    data: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    out: Path
    """Path of the model to write (.safetensors)."""

    val: tuple[Path, ...] = ()
    """Recordings to validate on; by default some of the others are held out."""

    streams: tuple[Path, ...] = ()
    """Recordings to choose the decision thresholds on, streams or clips, also of other
    devices; without any, the defaults are kept."""

    start: Path | None = None
    """Model to start from: a name of weights that come with eskin, or a file. The
    network has its sizes; its weights and the scale of its inputs are taken, all of
    them for the same gestures; for others, the last layers are new."""

    test: tuple[Path, ...] = ()
    """Recordings to score the trained model on."""

    classes: tuple[str, ...] = ()
    """Gestures to learn; by default all that are labelled."""

    seed: int = 0
    """Random seed."""

    calibration: Path | None = None
    """Calibration file, as eskin calibrate writes it, to use in place of the recorded
    ones."""

    robot_urdf: str | None = None
    """Robot of recordings that lack their URDF: a URDF file or a preset's name."""

    pack: Path | None = None
    """Folder that keeps prepared recordings, so that each is prepared only once."""

    skins: Annotated[int, NOT_NEGATIVE] = 0
    """Number of other skins, simulated by augmentation, on which each recording is
    learned too."""

    wear: AgingConfig = field(default_factory=AgingConfig)
    """Limits of the differences between those skins and the recorded one."""

    train: TrainConfig = field(default_factory=TrainConfig)
    """Options of the training."""

    def load_overrides(self) -> Overrides:
        """Load what is used in place of what the recordings hold."""
        return load_overrides(self.calibration, self.robot_urdf)


def run(command: TrainCommand) -> dict[str, object]:
    """Train, write the model, and score it if test recordings are given.

    An interrupted training leaves its state beside the model, from which the same
    command continues. `torchrun` lets several processes train; the first one prepares
    recordings, and writes and scores the model.
    """
    from eskin.learn.processes import join_processes

    with join_processes() as processes:
        return train(command, processes)


def train(command: TrainCommand, processes: "Processes") -> dict[str, object]:
    """Train as one of some processes; only the first one returns a result."""
    from eskin.learn.checkpoint import to_model
    from eskin.learn.evaluation import check_fits, evaluate
    from eskin.learn.training import Trainer

    started = time.monotonic()
    if processes.is_first:
        check_writable(command.out)
    paths = find_recordings(command.data)
    find_recordings(command.streams)  # Refused now rather than after the training.
    start = load_start(command)
    command = take_sizes(command, start)
    skins = tuple(Aging(command.wear, number) for number in range(command.skins))
    with processes.first_alone():
        dataset = prepare_dataset(command, paths, command.train.select_graph(), skins)
        graph = command.train.select_graph(dataset.has_shear)
        validation, test = (
            prepare_dataset(command, find_recordings(data), graph) if data else None
            for data in (command.val, command.test)
        )
    vocabulary = select_classes(dataset, command.classes)
    share, takes = command.train.validation, ()
    if validation is None and share and round(share * dataset.original_count) == 0:
        part, held = hold_out_takes(dataset)
        if takes := held.labelled:
            dataset, validation = part, held
    trainer = Trainer(
        dataset,
        vocabulary,
        command.train,
        seed=command.seed,
        validation=validation,
        start=start,
        processes=processes,
    )
    if processes.is_first:
        report_truncated(dataset, validation, test)
        if validation is None:
            print(trainer.holdout)
        if takes:
            print(
                f"{format_count(len(takes), 'take')} held out for validation, of the "
                "recordings that are trained on: other people and days may do worse"
            )
    content = hash_recordings(paths)
    card = build_card(command, trainer, content, start)
    if test is not None:
        check_fits(card, test)
    kept = command.out.with_name(command.out.name + ".training")
    facts = f"{content} {vocabulary} {command.train} {command.seed} {skins}"
    facts += f" {hash_recordings(find_recordings(command.val))}" if command.val else ""
    facts += f" {start.digest}" if start else ""
    facts += f" {card.training.get('overrides', '')}"
    network = trainer.run(checkpoint=kept, facts=facts)
    if not processes.is_first:
        return {}
    accuracy = trainer.validation_accuracy()
    card = replace(
        card,
        temperature=trainer.fit_temperature(),
        metrics={"val_accuracy": accuracy} if trainer.held_out else {},
    )
    model = set_decision(to_model(network, card), command)
    scored = evaluate(network, card, test).segments.accuracy if test else None
    path = save_or_keep(command.out, model)
    if not trainer.stopped:
        kept.unlink(missing_ok=True)
    result = {
        "val_accuracy": round(accuracy, 4) if trainer.held_out else None,
        "test_accuracy": None if scored is None else round(scored, 4),
        "epochs": trainer.epochs,
        "seconds": round(time.monotonic() - started, 1),
    }
    known = (f"{key} {value}" for key, value in result.items() if value is not None)
    print(f"{path}: " + ", ".join(known))
    if trainer.held_out is None:
        print("no accuracy is known: no recording was held out; give --val or --test")
    if trainer.stopped:
        epochs = format_count(trainer.epochs, "epoch")
        print(f"stopped after {epochs}: {path} is the best so far")
        raise KeyboardInterrupt
    return result


def save_or_keep(path: Path, model: Model) -> Path:
    """Write a model, elsewhere if its disk does not take it; return where it is.

    Raises:
        OSError: it can be written nowhere.
    """
    try:
        save_model(path, model)
    except OSError as error:
        other = Path(tempfile.mkdtemp(prefix="eskin-")) / path.name
        save_model(other, model)
        print(f"{path} cannot be written ({error.strerror}); the model is {other}")
        return other
    return path


def load_start(command: TrainCommand) -> Model | None:
    """Load the model to start from; return None if none is named.

    Raises:
        ModelError: when there is no such model.
    """
    return None if command.start is None else load_model(command.start)


def take_sizes(command: TrainCommand, start: Model | None) -> TrainCommand:
    """Return the command with a network of the sizes of the model to start from.

    Raises:
        ModelError: when other sizes are asked for.
    """
    if start is None:
        return command
    asked, usual = command.train.network, NetworkConfig()
    theirs = {size: getattr(start.card.network, size) for size in SIZES}
    ours = {size: getattr(asked, size) for size in SIZES}
    if any(ours[size] not in (theirs[size], getattr(usual, size)) for size in SIZES):
        raise ModelError(
            f"--start {command.start} has a network of {format_sizes(theirs)}, the one "
            f"asked for {format_sizes(ours)}; allowed are the same sizes; leave out "
            + " ".join(f"--train.network.{size}" for size in SIZES)
        )
    network = replace(asked, **theirs)
    return replace(command, train=replace(command.train, network=network))


def format_sizes(sizes: Mapping[str, int]) -> str:
    """Format the sizes of a network for an error message."""
    return ", ".join(f"{size} {number}" for size, number in sizes.items())


def build_card(
    command: TrainCommand, trainer: "Trainer", content: str, start: Model | None
) -> ModelCard:
    """Build the card of a model before it is trained."""
    return ModelCard(
        vocabulary=trainer.vocabulary,
        kind="shear" if trainer.shear else "pressure",
        network=command.train.network,
        graph=trainer.graph,
        training=flatten(asdict(command.train)) | describe_command(command, start),
        data_digest=content,
    )


def describe_command(command: TrainCommand, start: Model | None) -> dict[str, str]:
    """Return the options of the command that the card stores besides the training."""
    facts = {"seed": str(command.seed), "skins": str(command.skins)}
    if start is not None and command.start is not None:
        facts |= {"start": command.start.stem, "start_digest": start.digest}
    overrides = command.load_overrides()
    if overrides.digest:
        facts["overrides"] = overrides.digest
    return facts | (flatten(asdict(command.wear), "wear.") if command.skins else {})


def set_decision(model: Model, command: TrainCommand) -> Model:
    """Return the model with the decision that scores best on the streams given."""
    if not command.streams:
        return model
    paths = find_recordings(command.streams)
    overrides = command.load_overrides()
    traces = list(trace_recordings(paths, model, command.train.workers, overrides))
    decision, score = choose_decision(traces)
    print(f"{decision}: F1 {score.total.f1:.3f} on {score.hours:.2f} h of streams")
    metrics = model.card.metrics | {"streams_f1": score.total.f1}
    return replace(model, card=replace(model.card, decision=decision, metrics=metrics))


def prepare_dataset(
    command: TrainCommand,
    paths: tuple[Path, ...],
    graph: GraphConfig,
    skins: tuple[Aging, ...] = (),
) -> Dataset:
    """Prepare recordings for training."""
    workers = command.train.workers
    transforms = (None, *skins)
    return prepare(
        paths,
        graph=graph,
        pack=command.pack,
        workers=workers,
        transforms=transforms,
        overrides=command.load_overrides(),
    )


def select_classes(dataset: Dataset, asked: tuple[str, ...]) -> tuple[str, ...]:
    """Return `none` and the gestures to learn.

    Raises:
        RecordingError: if one of them has no label in the recordings.
    """
    known = dataset.vocabulary
    missing = sorted(set(asked) - set(known))
    if missing:
        raise RecordingError(
            f"no recording is labelled {', '.join(missing)}; labelled are "
            f"{', '.join(known)}; name some of these with --classes"
        )
    return (NONE, *(g for g in known[1:] if not asked or g in asked))


def flatten(config: dict[str, object], prefix: str = "") -> dict[str, str]:
    """Flatten a nested configuration to one level of text."""
    entries: dict[str, str] = {}
    for name, value in config.items():
        if isinstance(value, dict):
            entries |= flatten(value, f"{prefix}{name}.")
        else:
            entries[prefix + name] = str(value)
    return entries
