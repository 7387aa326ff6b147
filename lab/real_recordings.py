"""Cross-validate the recogniser and baselines on the public recordings.

    python -m lab.real_recordings sleeve --data ../shared/data/sleeve
    python -m lab.real_recordings shearsense --data ../shared/data/shearsense
    python -m lab.real_recordings socialtouch --data ../shared/data/socialtouch
    python -m lab.real_recordings capfingerid --data ../shared/data/capfingerid
    python -m lab.real_recordings recordings --data FOLDER

The same with `cost` and `haart`; `recordings` are those of `eskin convert`. One session
(sleeve) or one person (all others) is held out at a time.
The recogniser is trained with the defaults of `eskin train` on the others and tested on
the held-out one; classical classifiers are tested on the same examples with hand-made
features, and a convolutional network on the pressures of all taxels. The command prints
the tables of docs/results.md.
"""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
import torch
import tyro
from jaxtyping import Bool, Float, Int
from joblib import Parallel, delayed
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from eskin.errors import RecordingError
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.evaluation import find_window_ends, score_segments
from eskin.learn.ground_truth import Segment
from eskin.learn.metrics import (
    bootstrap_difference,
    compute_group_accuracies,
    score_predictions,
)
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.sets import (
    LAYOUTS,
    SetName,
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
    convert_table,
)
from eskin.learn.sets.socialtouch import find_group
from eskin.learn.training import TrainConfig, Trainer
from eskin.live import PRESSURE_SUMMARY, SLOT_NS, compute_summary
from eskin.recording import NONE, find_recordings
from eskin.skin import MountedSkin
from lab.baselines import FitConfig, SkinWindows, build_baseline
from lab.baselines.estimators import (
    Estimator,
    GradientBoosting,
    NearestNeighbours,
    RandomForest,
    SupportVectors,
)
from lab.baselines.hand import compute_features
from lab.baselines.interface import READINGS, STEP_NS
from lab.baselines.series import COLUMNS, SERIES, align_series
from lab.tables import format_head, format_row


@final
@dataclass(frozen=True)
class Standardised:
    """Standardises features for another estimator."""

    of: Callable[[int], Estimator]
    """Function that builds the other estimator from a seed."""

    def __call__(self, seed: int) -> Estimator:
        """Build an estimator."""
        return make_pipeline(StandardScaler(), self.of(seed))


ON_FEATURES: dict[str, Callable[[int], Estimator]] = {
    "random forest": RandomForest(),
    "boosting": GradientBoosting(),
    "SVM": Standardised(SupportVectors()),
    "kNN": Standardised(NearestNeighbours()),
}
"""Estimators compared with the recogniser on features of whole segments, by name."""
ON_SERIES = {name: SERIES[name] for name in ("minirocket", "quant")}
"""Classifiers of series, on the windows in which the recogniser scores a segment."""

OURS = "eskin"
"""Name of the recogniser."""

CNN = "3D-CNN"
"""Name of the network compared with the recogniser on the pressures of all taxels."""

CNN_FIT = FitConfig(epochs=20, batch=32)
"""Settings of its training."""


@dataclass(frozen=True)
class Answers:
    """Holds the true class and the predictions of every method for each example."""

    truth: Int[np.ndarray, "example"]
    """True classes, as indices into `vocabulary`."""

    predicted: dict[str, Int[np.ndarray, "example"]]
    """Predictions by method; `eskin` is the recogniser."""

    groups: tuple[str, ...]
    """Person or session of each example."""

    vocabulary: tuple[str, ...]
    """Classes."""


Networks = dict[str, RecogniserNetwork]


def find_groups(dataset: Dataset, by: str) -> list[str]:
    """Return the group of each recording: `subject` or `session`.

    Raises:
        RecordingError: if there are fewer than two groups.
    """
    groups = [str(getattr(r.metadata, by)) for r in dataset.recordings]
    if len(set(groups)) < 2:
        raise RecordingError(
            f"all recordings have {by} '{groups[0]}'; leaving one out needs at least "
            f"two; give recordings of more than one {by}"
        )
    return groups


def train_folds(
    dataset: Dataset,
    groups: Sequence[str],
    config: TrainConfig,
    seed: int = 0,
    workers: int = 1,
) -> Networks:
    """Return one network for each group, trained on all the others.

    The result does not depend on the number of workers.

    Args:
        dataset: data set to divide.
        groups: group of each recording.
        config: settings of the training.
        seed: seed of every training.
        workers: number of processes.
    """
    names = sorted(set(groups))
    train = delayed(train_without)
    jobs = (train(dataset, groups, name, config, seed) for name in names)
    networks: Any = Parallel(n_jobs=workers, verbose=10)(jobs)
    return dict(zip(names, networks, strict=True))


def train_without(
    dataset: Dataset,
    groups: Sequence[str],
    held: str,
    config: TrainConfig,
    seed: int,
) -> RecogniserNetwork:
    """Return a network trained without one group."""
    torch.set_num_threads(1)
    others = [i for i, group in enumerate(groups) if group != held]
    trainer = Trainer(dataset, dataset.vocabulary, config, others, seed)
    return trainer.run(quiet=True)


@dataclass(frozen=True)
class Examples:
    """Holds segments in the forms that the methods take."""

    segments: tuple[Segment, ...]
    """Labelled segments."""
    truth: Int[np.ndarray, "segment"]
    """Their classes."""
    columns: list[int]
    """Columns of these classes in the scores of the recogniser."""
    features: Float[np.ndarray, "segment feature"]
    """Hand-made features of the segments."""
    series: Float[np.ndarray, "window channel 100"]
    """Series in the windows of the segments."""
    windows: SkinWindows
    """Pressures in these windows."""
    segment: Int[np.ndarray, "window"]
    """Index of the segment of each window."""


def classify_segments(
    dataset: Dataset,
    groups: Sequence[str],
    networks: Networks,
    shear: bool,
    seed: int,
    workers: int = 1,
) -> Answers:
    """Classify whole labelled segments with methods trained on other groups.

    The result does not depend on the number of workers.
    """
    segments = dataset.labelled
    spoken = {segment.gesture for segment in segments}
    vocabulary = tuple(name for name in dataset.vocabulary if name in spoken)
    truth = np.array([vocabulary.index(s.gesture) for s in segments])
    group = np.array([groups[s.recording] for s in segments])
    rows = (np.arange(s.first, s.end) for s in segments)
    examples = Examples(
        segments,
        truth,
        [dataset.vocabulary.index(name) for name in vocabulary],
        np.array([compute_features(dataset, each, shear) for each in rows]),
        cut_series(dataset, segments, shear),
        *cut_skin_windows(dataset, segments),
    )
    classify = delayed(classify_held_out)
    outs = [group == held for held in networks]
    jobs = (
        classify(dataset, examples, out, network, seed)
        for out, network in zip(outs, networks.values(), strict=True)
    )
    folds: Any = Parallel(n_jobs=workers)(jobs)
    predicted = {name: np.zeros_like(truth) for name in folds[0]}
    for out, found in zip(outs, folds, strict=True):
        for name, classes in found.items():
            predicted[name][out] = classes
    return Answers(truth, predicted, tuple(group.tolist()), vocabulary)


def classify_held_out(
    dataset: Dataset,
    examples: Examples,
    out: Bool[np.ndarray, "segment"],
    network: RecogniserNetwork,
    seed: int,
) -> dict[str, Int[np.ndarray, "held"]]:
    """Return the classes that each method gives to the segments held out."""
    torch.set_num_threads(1)
    truth, segment, windows = examples.truth, examples.segment, examples.windows
    chosen = [s for s, o in zip(examples.segments, out, strict=True) if o]
    scores = score_segments(network, dataset, chosen)[:, examples.columns]
    predicted = {OURS: scores.argmax(axis=1)}
    for name, make in ON_FEATURES.items():
        model = make(seed).fit(examples.features[~out], truth[~out])
        predicted[name] = model.predict(examples.features[out])
    within = out[segment]
    labels = truth[segment[~within]]
    for name, make in ON_SERIES.items():
        model = make(seed).fit(examples.series[~within], labels)
        found = model.predict_proba(examples.series[within])
        best = sum_windows(found, segment[within]).argmax(axis=1)
        predicted[name] = model.classes_[best]
    known, labels = np.unique(labels, return_inverse=True)
    cnn = build_baseline("3d-cnn", mount_skin(dataset), CNN_FIT)
    cnn.fit(windows.select(~within), labels, seed)
    found = cnn.predict_probabilities(windows.select(within))
    predicted[CNN] = known[sum_windows(found, segment[within]).argmax(axis=1)]
    return predicted


def sum_windows(
    probabilities: Float[np.ndarray, "window class"], segment: Int[np.ndarray, "window"]
) -> Float[np.ndarray, "segment class"]:
    """Return the sums of log-probabilities over the windows of each segment."""
    starts = np.unique(segment, return_index=True)[1]
    return np.add.reduceat(np.log(probabilities + 1e-9), starts, axis=0)


def cut_series(
    dataset: Dataset, segments: Sequence[Segment], shear: bool
) -> Float[np.ndarray, "window channel 100"]:
    """Return the series in the windows of segments, those of `cut_skin_windows`."""
    series = []
    for segment in segments:
        rows = np.arange(segment.first, segment.end)
        summary = compute_summary(dataset.graphs.select(rows), shear)
        columns = [*COLUMNS, *range(len(PRESSURE_SUMMARY), summary.shape[1])]
        slots = dataset.stamps[rows] // SLOT_NS
        for end in find_window_ends(dataset, segment) - segment.first + 1:
            series.append(align_series(summary[:end, columns], slots[:end]))
    return np.stack(series)


def mount_skin(dataset: Dataset) -> MountedSkin:
    """Return the skin of all recordings on its robot."""
    first = dataset.recordings[0]
    return MountedSkin(first.skin, first.load_robot())


def cut_skin_windows(
    dataset: Dataset, segments: Sequence[Segment]
) -> tuple[SkinWindows, Int[np.ndarray, "window"]]:
    """Return the pressures of all taxels in the windows of segments, at 50 Hz.

    The windows are those in which the recogniser scores a segment; the time before the
    segment is zero. Readings between two are interpolated.

    Returns:
        the windows, and the index of each one's segment.
    """
    taxels = dataset.recordings[0].skin.count
    pressures: list[Float[np.ndarray, "100 taxel"]] = []
    indices: list[int] = []
    for index, segment in enumerate(segments):
        rows = np.arange(segment.first, segment.end)
        graphs = dataset.graphs.select(rows)
        images = np.zeros((len(rows), taxels), np.float32)
        images[graphs.graph_index, graphs.taxels] = graphs.pressure
        stamps = dataset.stamps[rows]
        for end in find_window_ends(dataset, segment) - segment.first:
            times = stamps[end] - STEP_NS * np.arange(READINGS)[::-1]
            place = np.interp(times, stamps, np.arange(len(rows)))
            low = place.astype(np.int64)
            high, part = np.minimum(low + 1, len(rows) - 1), (place - low)[:, None]
            window = (1 - part) * images[low] + part * images[high]
            window[times < stamps[0]] = 0.0
            pressures.append(window.astype(np.float16))
            indices.append(index)
    joints = np.zeros((len(pressures), READINGS, 0), np.float32)
    return SkinWindows(np.stack(pressures), joints), np.array(indices)


@dataclass(frozen=True)
class Command:
    """Cross-validate on the public recordings, with people or sessions held out."""

    kind: tyro.conf.Positional[Literal[SetName, "recordings"]]
    """Data set."""
    data: Path
    """Folder of the data set, as downloaded."""
    seed: int = 0
    """Random seed."""
    workers: int = 2
    """Number of processes for training and for the other methods."""
    train: TrainConfig = field(default_factory=lambda: TrainConfig(validation=0.0))
    """Settings of the training."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    started = time.monotonic()
    if command.kind == "recordings":
        people(find_recordings((command.data,)), command)
    else:
        convert, measure = KINDS[command.kind]
        with tempfile.TemporaryDirectory() as folder:
            convert(command.data, Path(folder))
            measure(find_recordings((Path(folder),)), command)
    print(f"\n{time.monotonic() - started:.0f} s")


def sleeve(paths: tuple[Path, ...], command: Command) -> None:
    """Classify segments, with one session held out."""
    config = replace(command.train, shear=False)
    answers = cross_validate(prepare(paths), "session", command, config)
    print(table("Whole segments", answers))


def shearsense(paths: tuple[Path, ...], command: Command) -> None:
    """Classify recordings without and with shear, with one participant held out."""
    # Without shear not even which taxels it touches is used.
    pressure, both = (
        cross_validate(
            prepare(paths, graph=config.select_graph()), "subject", command, config
        )
        for config in (replace(command.train, shear=each) for each in (False, True))
    )
    print(table("Recordings, pressure", pressure))
    print(table("Recordings, pressure and shear", both))
    right = [a.predicted[OURS] == a.truth for a in (both, pressure)]
    print(f"\nShear adds {difference(*right)} points to the recogniser.")


def socialtouch(paths: tuple[Path, ...], command: Command) -> None:
    """Classify repetitions as gestures, then as groups, with a person held out."""
    dataset = prepare(paths, graph=command.train.select_graph())
    gestures = cross_validate(dataset, "subject", command, command.train)
    print(table("Repetitions, all gestures", gestures))
    grouped = rename_gestures(dataset, find_group)
    groups = cross_validate(grouped, "subject", command, command.train)
    print(table("Repetitions, groups of gestures", groups))


def people(paths: tuple[Path, ...], command: Command) -> None:
    """Classify labelled repetitions, with one person held out."""
    config = replace(command.train, shear=False)
    dataset = prepare(paths, graph=config.select_graph())
    print(table("Repetitions", cross_validate(dataset, "subject", command, config)))


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


def cross_validate(
    dataset: Dataset, by: str, command: Command, config: TrainConfig
) -> Answers:
    """Classify segments of each group, a person or a session, by all the others."""
    groups = find_groups(dataset, by)
    seed, workers = command.seed, command.workers
    networks = train_folds(dataset, groups, config, seed, workers)
    return classify_segments(dataset, groups, networks, config.shear, seed, workers)


HEAD = ("method", "accuracy", "macro F1", "difference of eskin [95 % interval]")


def table(title: str, answers: Answers) -> str:
    """Format accuracy, macro F1, groups and the difference of eskin, by method."""
    names = sorted(set(answers.groups))
    rows = [
        f"\n**{title}** ({len(answers.truth)} examples, "
        f"{len(answers.vocabulary)} classes)\n",
        format_head([*HEAD, *names]),
    ]
    ours = answers.predicted[OURS] == answers.truth
    for name, predicted in answers.predicted.items():
        result = score_predictions(answers.truth, predicted, answers.vocabulary)
        right = predicted == answers.truth
        groups = compute_group_accuracies(right, answers.groups)
        ahead = "" if name == OURS else difference(ours, right)
        cells = [
            name,
            f"{result.accuracy:.1%}",
            f"{result.macro_f1:.3f}",
            ahead,
            *(f"{groups[group]:.1%}" for group in names),
        ]
        rows.append(format_row(cells))
    return "\n".join(rows)


def difference(ours: np.ndarray, theirs: np.ndarray) -> str:
    """Format a difference of accuracies with its paired bootstrap interval."""
    low, high = bootstrap_difference(ours, theirs)
    mean = ours.mean() - theirs.mean()
    return f"{100 * mean:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"


KINDS = {
    "sleeve": (convert_sleeve, sleeve),
    "shearsense": (convert_shearsense, shearsense),
    "socialtouch": (convert_socialtouch, socialtouch),
} | {
    name: (partial(convert_table, layout=layout, name=name), people)
    for name, layout in LAYOUTS.items()
}
"""Conversion and measurement of each data set, by name."""


if __name__ == "__main__":
    main()
