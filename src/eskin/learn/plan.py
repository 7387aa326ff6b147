"""This module holds what determines a trained model: recordings, options, and a start.

A plan is made once from the options of a command or a call. Before anything is
prepared it is resolved: its files are read, and the sizes of the network are settled.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from eskin.errors import ModelError
from eskin.learn.config import TrainConfig
from eskin.learn.recording_transforms import Aging, AgingConfig
from eskin.live import Model, ModelCard, NetworkConfig, load_model
from eskin.recording import NO_OVERRIDES, Overrides

SIZES = ("width", "layers", "channels")
"""Sizes of a network that must be equal for weights to fit another one."""


@dataclass(frozen=True)
class TrainingPlan:
    """A training plan holds all that determines a model."""

    recordings: tuple[Path, ...]
    """Recordings to train on."""
    start: Model | str | Path | None = None
    """Model to start from, its name or its path."""
    validation: tuple[Path, ...] = ()
    """Recordings to validate on; where there are none, some of the others."""
    streams: tuple[Path, ...] = ()
    """Recordings to choose the decision thresholds on."""
    test: tuple[Path, ...] = ()
    """Recordings to score the trained model on."""
    classes: tuple[str, ...] = ()
    """Gestures to learn; all that are labelled where none is named."""
    seed: int = 0
    """Random seed."""
    config: TrainConfig = field(default_factory=TrainConfig)
    """Settings of the training."""
    overrides: Overrides = NO_OVERRIDES
    """Values in place of what the recordings hold."""
    pack: Path | None = None
    """Folder that keeps prepared recordings."""
    skins: int = 0
    """Number of other skins on which each recording is learned too."""
    wear: AgingConfig = field(default_factory=AgingConfig)
    """Limits of the differences between those skins and the recorded one."""

    @property
    def agings(self) -> tuple[Aging, ...]:
        """Return the transforms to those other skins."""
        return tuple(Aging(self.wear, number) for number in range(self.skins))

    @property
    def start_name(self) -> str:
        """Return the name of the model to start from; empty for one without a file."""
        return "" if isinstance(self.start, Model | None) else str(self.start)


@dataclass(frozen=True)
class ResolvedPlan:
    """A resolved plan holds what the files of a plan hold, besides the plan."""

    plan: TrainingPlan
    """The plan, whose network has the sizes of the model to start from."""
    start: Model | None
    """The model to start from."""
    content: str
    """Digest of the recordings to train on."""

    @property
    def facts(self) -> str:
        """Return a description of data and settings, which a checkpoint must share."""
        plan = self.plan
        facts = f"{self.content} {plan.classes} {plan.config} {plan.seed} {plan.skins}"
        facts += f" {plan.wear}" if plan.skins else ""
        facts += f" {hash_recordings(plan.validation)}" if plan.validation else ""
        facts += f" {self.start.digest}" if self.start else ""
        return f"{facts} {plan.overrides.digest}"

    def build_card(self, vocabulary: tuple[str, ...], has_shear: bool) -> ModelCard:
        """Return the card of a model that is trained by this plan.

        Args:
            vocabulary: classes that it recognises.
            has_shear: whether every skin measures shear.
        """
        plan = self.plan
        options = {"seed": str(plan.seed), "skins": str(plan.skins)}
        if self.start is not None:
            options["start"] = Path(plan.start_name).stem
            options["start_digest"] = self.start.digest
        if plan.overrides.digest:
            options["overrides"] = plan.overrides.digest
        if plan.skins:
            options |= flatten_config(asdict(plan.wear), "wear.")
        config = plan.config
        return ModelCard(
            vocabulary=vocabulary,
            kind="shear" if config.shear and has_shear else "pressure",
            network=config.network,
            training=flatten_config(asdict(config)) | options,
            graph=config.select_graph(has_shear),
            data_digest=self.content,
        )


def resolve_plan(plan: TrainingPlan) -> ResolvedPlan:
    """Load the model to start from, take its sizes, and digest the recordings.

    Raises:
        ModelError: there is no such model, or other sizes than its own are asked for.
    """
    start = plan.start
    if start is not None and not isinstance(start, Model):
        start = load_model(start)
    if start is not None:
        plan = take_sizes(plan, start)
    return ResolvedPlan(plan, start, hash_recordings(plan.recordings))


def take_sizes(plan: TrainingPlan, start: Model) -> TrainingPlan:
    """Return the plan with a network of the sizes of the model to start from.

    Raises:
        ModelError: when other sizes are asked for.
    """
    asked = plan.config.network
    usual = NetworkConfig()
    theirs = {size: getattr(start.card.network, size) for size in SIZES}
    ours = {size: getattr(asked, size) for size in SIZES}
    if any(ours[size] not in (theirs[size], getattr(usual, size)) for size in SIZES):
        raise ModelError(
            f"--start {plan.start_name} has a network of {format_sizes(theirs)}, the "
            f"one asked for {format_sizes(ours)}; allowed are the same sizes; leave "
            "out " + " ".join(f"--train.network.{size}" for size in SIZES)
        )
    network = replace(asked, **theirs)
    return replace(plan, config=replace(plan.config, network=network))


def format_sizes(sizes: Mapping[str, int]) -> str:
    """Format the sizes of a network for an error message."""
    return ", ".join(f"{size} {number}" for size, number in sizes.items())


def hash_recordings(paths: Sequence[Path]) -> str:
    """Return SHA-256 over the bytes of recordings, whatever their order."""
    parts = sorted(hashlib.sha256(path.read_bytes()).hexdigest() for path in paths)
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def flatten_config(config: dict[str, object], prefix: str = "") -> dict[str, str]:
    """Flatten a nested configuration to one level of text."""
    entries: dict[str, str] = {}
    for name, value in config.items():
        if isinstance(value, dict):
            entries |= flatten_config(value, f"{prefix}{name}.")
        else:
            entries[prefix + name] = str(value)
    return entries
