"""This module takes labelled segments of recordings as examples, in folds by group.

A segment is classified in windows of two seconds that end every half second, as
`eskin.learn.evaluation.score_segments` does; the answers of windows are averaged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import RecordingError, SkinMismatchError
from eskin.learn.dataset import Dataset
from eskin.learn.evaluation import find_window_ends
from eskin.learn.ground_truth import Segment
from eskin.live import GraphConfig
from eskin.recording import (
    Recording,
    check_labels,
    find_recordings,
    read_recording,
)
from eskin.units import format_count
from lab.baselines.interface import READINGS, STEP_NS
from lab.comparison.examples import Examples
from lab.comparison.touches import Arrays, TouchSpan

Group = Literal["subject", "session"]
"""Part of the recordings that is held out at a time."""


@final
@dataclass(frozen=True, eq=False)
class SegmentExamples(Examples):
    """These examples are the labelled segments of recordings.

    A segment is of one touch on a calibrated skin, and of the whole skin on others.
    """

    hold_out: Group = "subject"
    """Part of the recordings that is held out at a time."""
    shear: bool = True
    """Whether methods use shear where the skin measures it."""
    names: tuple[tuple[str, str], ...] = ()
    """Gestures with other names, each with that name; several may share one."""

    @property
    def has_shear(self) -> bool:
        """Return whether methods use shear."""
        return self.shear and self.mounted.skin.has_shear

    @property
    def settings(self) -> str:
        """Return the held-out part, whether shear is used, and names of gestures."""
        return f"{self.hold_out} {self.has_shear} {self.names}"

    @property
    def place(self) -> str:
        """Return names of the folder and of the groups."""
        groups = " ".join(sorted(set(self.name_groups().values())))
        words = f"{super().place}, {self.hold_out} {groups}"
        words += ", with shear" if self.has_shear else ""
        return words + (", renamed" if self.names else "")

    def find_labels(self) -> tuple[str, ...]:
        """Return the gesture of each segment."""
        parts = self.load_arrays("windows", ("label",))
        names = dict(self.names)
        found = np.concatenate([part["label"] for part in parts]).tolist()
        return tuple(str(names.get(name, name)) for name in found)

    def find_recordings(self) -> tuple[int, ...]:
        """Return the index of each segment's recording."""
        parts = self.load_arrays("windows", ("count",))
        return tuple(n for n, part in enumerate(parts) for _ in range(part["count"]))

    def name_groups(self) -> dict[int, str]:
        """Return the person of each recording, or the session."""
        column = 0 if self.hold_out == "subject" else 1
        return {n: names[column] for n, names in self.sessions.items()}

    def find_touches(self, dataset: Dataset) -> list[TouchSpan | None]:
        """Return the rows of each segment."""
        return [
            TouchSpan(each.first, tuple(find_window_ends(dataset, each).tolist()))
            for each in dataset.labelled
        ]

    def dataset(self, graph: GraphConfig) -> Dataset:
        """Return all recordings as graphs, their gestures renamed."""
        return rename_gestures(super().dataset(graph), dict(self.names))

    def of_touches(self) -> "SegmentExamples":
        """Return the same segments, whose windows are of their touches alone."""
        return self

    def cut_windows(self, path: Path) -> Arrays:
        """Return the windows of a recording's segments, and the gestures `label`."""
        dataset = self.load_dataset(path)
        segments = dataset.labelled
        windows = [cut_segment_windows(dataset, segment) for segment in segments]
        taxels = dataset.recordings[0].skin.count
        stamps = [np.zeros((0, READINGS), np.int64), *(each.stamps for each in windows)]
        pressure = [np.zeros((0, READINGS, taxels), np.float16)]
        pressure += [each.pressure for each in windows]
        numbers = [np.full(len(each.stamps), n) for n, each in enumerate(windows)]
        return {
            "count": np.array(len(segments)),
            "label": np.array([each.gesture for each in segments], str),
            "pressure": np.concatenate(pressure),
            "q": read_joint_positions(dataset.recordings[0], np.concatenate(stamps)),
            "example": np.concatenate([np.zeros(0, np.int64), *numbers]),
        }

    def split_folds(self) -> dict[str, tuple["SegmentExamples", "SegmentExamples"]]:
        """Return examples to train on and to test on, by the group that is held out."""
        groups = self.name_groups()
        folds = {}
        for held in sorted(set(groups.values())):
            inside = [n for n, group in groups.items() if group == held]
            others = [n for n, group in groups.items() if group != held]
            folds[held] = (self.select(others), self.select(inside))
        return folds


@dataclass(frozen=True, eq=False)
class SegmentWindows:
    """Segment windows hold the pressures of one segment, the oldest reading first."""

    pressure: Float[np.ndarray, "window 100 taxel"]
    """Pressure of each taxel of the touch, zero for the others [kPa] (float16)."""
    stamps: Int[np.ndarray, "window 100"]
    """Stamps of the readings [ns since the epoch]."""


def cut_segment_windows(dataset: Dataset, segment: Segment) -> SegmentWindows:
    """Return the pressures in the windows of a segment, at 50 Hz.

    Readings between two are interpolated; those before the segment are zero.
    """
    rows = np.arange(segment.first, segment.end)
    graphs = dataset.graphs.select(rows)
    taxels = dataset.recordings[segment.recording].skin.count
    images = np.zeros((len(rows), taxels), np.float32)
    images[graphs.graph_index, graphs.taxels] = graphs.pressure
    stamps = dataset.stamps[rows]
    ends = dataset.stamps[find_window_ends(dataset, segment)]
    times = ends[:, None] - STEP_NS * np.arange(READINGS)[::-1]
    place = np.interp(times, stamps, np.arange(len(rows)))
    low = place.astype(np.int64)
    high = np.minimum(low + 1, len(rows) - 1)
    part = (place - low)[..., None]
    pressure = (1 - part) * images[low] + part * images[high]
    pressure[times < stamps[0]] = 0.0
    return SegmentWindows(pressure.astype(np.float16), times)


def read_joint_positions(
    recording: Recording, stamps: Int[np.ndarray, "window 100"]
) -> Float[np.ndarray, "window 100 joint"]:
    """Return the joint positions of a recording at some stamps [rad] (float32)."""
    if not recording.joint_names:
        return np.zeros((*stamps.shape, 0), np.float32)
    pairs = [(scan.stamp, scan.q) for scan in recording.scans()]
    known = np.array([stamp for stamp, _ in pairs])
    columns = np.array([q for _, q in pairs]).T
    found = [np.interp(stamps, known, column) for column in columns]
    return np.stack(found, axis=-1).astype(np.float32)


def rename_gestures(dataset: Dataset, names: Mapping[str, str]) -> Dataset:
    """Return a data set in which some gestures have other names."""
    return replace(
        dataset,
        gestures=tuple(names.get(name, name) for name in dataset.gestures),
        segments=tuple(
            replace(segment, gesture=names.get(segment.gesture, segment.gesture))
            for segment in dataset.segments
        ),
    )


def find_segments(
    places: Sequence[Path],
    pack: Path,
    hold_out: Group = "subject",
    shear: bool = True,
    names: Mapping[str, str] | None = None,
    workers: int = 1,
) -> SegmentExamples:
    """Return the labelled segments of recordings, or of folders of them.

    Args:
        places: paths of recordings and folders.
        pack: folder that keeps prepared recordings.
        hold_out: part of the recordings that is held out at a time.
        shear: whether methods use shear where the skin measures it.
        names: other names of gestures.
        workers: number of processes that prepare recordings.

    Raises:
        RecordingError: if there is no recording, or all are of one group, or of one
            gesture, or one that is renamed is not in them, or labels cannot be right.
        SkinMismatchError: if they are of several skins or robots.
    """
    paths = find_recordings(places)
    examples = SegmentExamples(
        paths, pack, workers, hold_out, shear, tuple((names or {}).items())
    )
    check_one_skin(paths)
    check_labels([read_recording(path).label_set for path in paths])
    groups = set(examples.name_groups().values())
    if len(groups) < 2:
        raise RecordingError(
            f"all recordings have {hold_out} '{groups.pop()}'; leaving one out needs "
            f"at least two; give recordings of more than one {hold_out}"
        )
    unknown = set(names or {}) - set(replace(examples, names=()).gestures)
    if unknown:
        raise RecordingError(
            f"no gesture {', '.join(sorted(unknown))} to rename; allowed are "
            f"{', '.join(replace(examples, names=()).gestures)}"
        )
    if len(examples.gestures) < 2:
        raise RecordingError(
            f"{format_count(len(paths), 'recording')} with labels of gestures "
            f"{', '.join(examples.gestures) or 'none'}; allowed are two gestures and "
            "more; label them with: eskin label REC"
        )
    return examples


def check_one_skin(paths: Sequence[Path]) -> None:
    """Raise if recordings are of several skins, or of several robots."""
    first = read_recording(paths[0])
    for path in paths[1:]:
        other = read_recording(path)
        same = np.array_equal(first.skin.positions, other.skin.positions)
        same = same and first.skin.has_shear == other.skin.has_shear
        if not same or first.joint_names != other.joint_names:
            raise SkinMismatchError(
                f"{path} is of skin '{other.skin.name}', and {paths[0]} of "
                f"'{first.skin.name}' or of another shape or robot; allowed is one "
                "skin; compare the recordings of each skin apart"
            )
