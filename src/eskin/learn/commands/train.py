"""`eskin train` trains the recogniser on recordings."""

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import NOT_NEGATIVE, check_writable, load_overrides
from eskin.learn.config import TrainConfig
from eskin.learn.recording_transforms import AgingConfig
from eskin.live import Model
from eskin.recording import find_recordings
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.learn.metrics import ClassificationScore
    from eskin.learn.processes import Processes


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
    """Robot in place of the recorded one: a URDF file or a preset's name."""

    pack: Path | None = None
    """Folder that keeps prepared recordings, so that each is prepared only once."""

    skins: Annotated[int, NOT_NEGATIVE] = 0
    """Number of other skins, simulated by augmentation, on which each recording is
    learned too."""

    wear: AgingConfig = field(default_factory=AgingConfig)
    """Limits of the differences between those skins and the recorded one."""

    train: TrainConfig = field(default_factory=TrainConfig)
    """Options of the training."""


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
    from eskin.learn.commands.models import run_training
    from eskin.learn.plan import TrainingPlan

    started = time.monotonic()
    if processes.is_first:
        check_writable(command.out)
    plan = TrainingPlan(
        recordings=find_recordings(command.data),
        start=command.start,
        validation=find_recordings(command.val),
        streams=find_recordings(command.streams),
        test=find_recordings(command.test),
        classes=command.classes,
        seed=command.seed,
        config=command.train,
        overrides=load_overrides(command.calibration, command.robot_urdf),
        pack=command.pack,
        skins=command.skins,
        wear=command.wear,
    )
    kept = command.out.with_name(command.out.name + ".training")
    tell = print if processes.is_first else skip_line
    done = run_training(plan, kept, processes, tell)
    if not processes.is_first:
        return {}
    path = save_or_keep(command.out, done.model)
    if not done.stopped:
        kept.unlink(missing_ok=True)
    accuracy = done.model.card.metrics.get("val_accuracy")
    result = {
        "val_accuracy": None if accuracy is None else round(accuracy, 4),
        "test_accuracy": done.test and round(done.test.segments.accuracy, 4),
        "epochs": done.epochs,
        "seconds": round(time.monotonic() - started, 1),
    }
    known = (f"{key} {value}" for key, value in result.items() if value is not None)
    print(f"{path}: " + ", ".join(known))
    if accuracy is None:
        print("no accuracy is known: no recording was held out; give --val or --test")
    if done.held_out is not None:
        print(describe_held_out(done.held_out))
    if done.stopped:
        epochs = format_count(done.epochs, "epoch")
        print(f"stopped after {epochs}: {path} is the best so far")
        raise KeyboardInterrupt
    print(f"then: eskin run --source SOURCE --skin SKIN --model {path}")
    return result


def describe_held_out(score: "ClassificationScore") -> str:
    """Describe how many gestures that were not trained on are recognised, by class."""
    made = score.confusion.sum(axis=1).tolist()
    right = score.confusion.diagonal().tolist()
    parts = [
        f"{name} {right[n]} of {made[n]}"
        for n, name in enumerate(score.per_class)
        if made[n]
    ]
    return (
        f"validation: {', '.join(parts)} recognised; val_accuracy is the share of "
        "right windows of up to 2 s, drawn from these"
    )


def skip_line(line: str) -> None:
    """Print nothing, as every process but the first."""


def save_or_keep(path: Path, model: Model) -> Path:
    """Write a model, elsewhere if its disk does not take it; return where it is.

    Raises:
        OSError: it can be written nowhere.
    """
    try:
        model.save(path)
    except OSError as error:
        other = Path(tempfile.mkdtemp(prefix="eskin-")) / path.name
        model.save(other)
        print(f"{path} cannot be written ({error.strerror}); the model is {other}")
        return other
    return path
