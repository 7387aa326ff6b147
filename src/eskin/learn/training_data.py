"""This module reads what a training plan names: data to train, validate and test on."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from eskin.learn.dataset import Dataset, hold_out_takes, prepare
from eskin.learn.plan import TrainingPlan
from eskin.learn.processes import Processes
from eskin.learn.recording_transforms import Aging
from eskin.live import GraphConfig
from eskin.units import format_count


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Training data are the data sets of a plan, and the classes to learn."""

    dataset: Dataset
    """Data set to train on."""
    vocabulary: tuple[str, ...]
    """Classes to learn, `none` first."""
    validation: Dataset | None
    """Data set to validate on; where None, recordings of the other are held out."""
    test: Dataset | None
    """Data set to score the trained model on; None without one."""


def read_training_data(
    plan: TrainingPlan, processes: Processes, tell: Callable[[str], object]
) -> TrainingData:
    """Read and prepare the recordings of a plan, and choose the classes to learn.

    Where too few recordings are given to hold out one of them, takes of each gesture
    are held out to validate on.

    Args:
        plan: what to train.
        processes: processes that train together; the first one prepares recordings.
        tell: takes lines about what is held out, and what was left out.

    Raises:
        RecordingError: recordings cannot be learned from.
    """
    config = plan.config
    with processes.first_alone():
        dataset = prepare_recordings(
            plan, plan.recordings, config.select_graph(), plan.agings
        )
        graph = config.select_graph(dataset.has_shear)
        validation, test = (
            prepare_recordings(plan, paths, graph) if paths else None
            for paths in (plan.validation, plan.test)
        )
    for each in (dataset, validation, test):
        if each is not None:
            each.report_truncated(tell)
    vocabulary = dataset.select_classes(plan.classes)
    share = config.validation
    if validation is None and share and round(share * dataset.original_count) == 0:
        part, held = hold_out_takes(dataset)
        if takes := held.labelled:
            dataset = part
            validation = held
            tell(
                f"{format_count(len(takes), 'take')} held out for validation, of the "
                "recordings that are trained on: other people and days may do worse"
            )
    return TrainingData(dataset, vocabulary, validation, test)


def prepare_recordings(
    plan: TrainingPlan,
    paths: tuple[Path, ...],
    graph: GraphConfig,
    agings: tuple[Aging, ...] = (),
) -> Dataset:
    """Prepare recordings of a plan."""
    return prepare(
        paths,
        graph=graph,
        pack=plan.pack,
        workers=plan.config.workers,
        transforms=(None, *agings),
        overrides=plan.overrides,
    )
