"""This module defines the examples that all methods are compared on.

A method takes examples as graphs of touches, as descriptions of these touches or as
windows of the whole skin, and does not know what kind of examples they are: the clips
of generated sets, below, or labelled segments (see `lab.comparison.segments`).
"""

import hashlib
import os
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self, final

import numpy as np
from jaxtyping import Bool, Float, Int
from joblib import Parallel, delayed

from eskin.compiled import digest_code
from eskin.errors import RecordingError
from eskin.files import atomic_path
from eskin.learn.dataset import Dataset, concatenate_recordings, prepare
from eskin.learn.evaluation import find_last_rows
from eskin.learn.ground_truth import Clip, read_clips
from eskin.learn.prepared_recording import (
    compute_file_key,
    load_prepared,
    pack_recording,
)
from eskin.live import GraphConfig
from eskin.recording import Recording, find_recordings, read_recording
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline
from lab.baselines.interface import READINGS, SkinWindows
from lab.comparison.touches import (
    Arrays,
    Form,
    TouchRows,
    TouchSpan,
    describe_touches,
    join_touch_rows,
    number_examples,
    select_rows,
)

LARGEST_PRESSURE = 300.0
"""Pressure to which windows are clipped [kPa], three times the largest of social touch
(98 kPa, Silvera-Tawil et al.). A saturated voltage divider reads without bound."""

Part = Literal["windows", "touches"]
"""Part of the arrays of a recording's examples, in a file of its own."""


@dataclass(frozen=True, eq=False)
class Examples(ABC):
    """Examples are parts of recordings in which one gesture is made."""

    paths: tuple[Path, ...]
    """Paths of the recordings."""
    pack: Path
    """Folder that keeps prepared recordings."""
    workers: int = 1
    """Number of processes that prepare them."""

    @property
    @abstractmethod
    def has_shear(self) -> bool:
        """Return whether methods use shear."""

    @property
    @abstractmethod
    def settings(self) -> str:
        """Return all that determines the examples besides recordings and code."""

    @abstractmethod
    def find_labels(self) -> tuple[str, ...]:
        """Return the gesture of each example."""

    @abstractmethod
    def find_recordings(self) -> tuple[int, ...]:
        """Return the index of each example's recording."""

    @abstractmethod
    def name_groups(self) -> dict[int, str]:
        """Return the person of each recording, or the session."""

    @abstractmethod
    def find_touches(self, dataset: Dataset) -> list[TouchSpan | None]:
        """Return the touch of each example, None for one without.

        Args:
            dataset: data set of all recordings, or of one.
        """

    @abstractmethod
    def of_touches(self) -> Self:
        """Return the same examples with windows of their touches alone."""

    @abstractmethod
    def cut_windows(self, path: Path) -> Arrays:
        """Return the windows of a recording's examples.

        Returns:
            `count`, the number of examples; for each window `pressure` [kPa] (float16),
            joint positions `q` [rad] (float32) and the index `example`, ascending.
        """

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Return the gesture of each example."""
        return self.find_labels()

    @cached_property
    def recordings(self) -> tuple[int, ...]:
        """Return the index of each example's recording."""
        return self.find_recordings()

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """Return the person of each example, or the session."""
        names = self.name_groups()
        return tuple(names[n] for n in self.recordings)

    @property
    def count(self) -> int:
        """Return the number of examples."""
        return len(self.labels)

    @cached_property
    def gestures(self) -> tuple[str, ...]:
        """Return the gestures of the examples, sorted."""
        return tuple(sorted(set(self.labels)))

    @cached_property
    def sessions(self) -> dict[int, tuple[str, str]]:
        """Return person and session of each recording."""
        metadata = [read_recording(path).metadata for path in self.paths]
        return {n: (each.subject, each.session) for n, each in enumerate(metadata)}

    @cached_property
    def mounted(self) -> MountedSkin:
        """Return the skin of the recordings on its robot."""
        first = read_recording(self.paths[0])
        return MountedSkin(first.skin, first.load_robot())

    @property
    def place(self) -> str:
        """Return the last two names of the folder that holds all recordings."""
        folder = os.path.commonpath([path.resolve().parent for path in self.paths])
        return "/".join(Path(folder).parts[-2:])

    @cached_property
    def digest(self) -> str:
        """Return a digest of recordings, settings and code, wherever they are."""
        hashes = [hashlib.sha256(path.read_bytes()).hexdigest() for path in self.paths]
        hashes += [digest_code(type(self).__module__), self.settings]
        return hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]

    def truth(self, vocabulary: Sequence[str]) -> Int[np.ndarray, "example"]:
        """Return the true class of each example, as an index into a vocabulary."""
        return np.array([vocabulary.index(gesture) for gesture in self.labels])

    def dataset(self, graph: GraphConfig) -> Dataset:
        """Return the touches in all recordings as graphs."""
        graph = graph if self.has_shear else graph.without_shear()
        return prepare(self.paths, None, graph, self.pack, self.workers)

    def touch_rows(self, form: Form) -> TouchRows:
        """Return the touches of the examples in one form."""
        names = ("count", form, f"{form}_example")
        return join_touch_rows(self.load_arrays("touches", names), form)

    @cached_property
    def windows(self) -> SkinWindows:
        """Return pressures of all taxels and joint positions in each window."""
        parts = self.load_arrays("windows", ("pressure", "q"))
        return SkinWindows(
            np.concatenate([part["pressure"] for part in parts]),
            np.concatenate([part["q"] for part in parts]),
            self.window_example,
        )

    @cached_property
    def window_example(self) -> Int[np.ndarray, "window"]:
        """Return the index of each window's example, ascending."""
        parts = self.load_arrays("windows", ("count", "example"))
        return number_examples(parts, "example")

    def load_arrays(self, part: Part, names: Collection[str]) -> list[Arrays]:
        """Return arrays of each recording by name; make those that are not on disk."""
        load = delayed(load_recording)
        jobs = (load(replace(self, paths=(p,)), part, names) for p in self.paths)
        parts: Any = Parallel(n_jobs=self.workers)(jobs)
        return parts

    def cut_touches(self, path: Path) -> Arrays:
        """Return the touches of a recording's examples in every form."""
        dataset = self.load_dataset(path)
        return describe_touches(dataset, self.find_touches(dataset), self.has_shear)

    def load_dataset(self, path: Path) -> Dataset:
        """Return the touches in one of the recordings as graphs, if it has any."""
        graph = GraphConfig() if self.has_shear else GraphConfig().without_shear()
        packed = load_prepared(pack_recording(path, self.pack, PipelineConfig(), graph))
        return concatenate_recordings((read_recording(path),), [packed])

    def select(self, recordings: Collection[int]) -> Self:
        """Return the examples of some of the recordings."""
        return replace(self, paths=tuple(self.paths[n] for n in sorted(recordings)))


def load_recording(examples: Examples, part: Part, names: Collection[str]) -> Arrays:
    """Return arrays of the only recording of examples; make them if not on disk."""
    (path,) = examples.paths
    settings = f"{PipelineConfig()} {examples.settings}"
    key = compute_file_key(type(examples).__module__, path, settings, None)
    target = examples.pack / f"{key}.{part}.npz"
    if not target.exists():
        cut = examples.cut_windows if part == "windows" else examples.cut_touches
        made: dict[str, Any] = cut(path)
        with atomic_path(target) as unfinished:
            np.savez(unfinished, **made)
    with np.load(target) as arrays:
        return {name: arrays[name] for name in names}


@final
@dataclass(frozen=True, eq=False)
class ClipExamples(Examples):
    """These examples are the clips of generated sets, of one window each."""

    touch_alone: bool = False
    """Whether taxels outside the touch of a clip read zero in its window."""

    @property
    def has_shear(self) -> bool:
        """Return whether methods use shear: the skins of generated sets have none."""
        return False

    @property
    def settings(self) -> str:
        """Return the clips, and whether windows hold the touch alone."""
        return f"{self.clips}{' of touches' if self.touch_alone else ''}"

    @cached_property
    def clips(self) -> tuple[tuple[int, Clip], ...]:
        """Return all clips, each with the index of its recording."""
        numbered = enumerate(self.paths)
        return tuple((n, clip) for n, path in numbered for clip in read_clips(path))

    def find_labels(self) -> tuple[str, ...]:
        """Return the gesture that each clip was generated for."""
        return tuple(clip.gesture for _, clip in self.clips)

    def find_recordings(self) -> tuple[int, ...]:
        """Return the index of each clip's recording."""
        return tuple(n for n, _ in self.clips)

    def name_groups(self) -> dict[int, str]:
        """Return the person of each recording."""
        return {n: person for n, (person, _) in self.sessions.items()}

    def find_touches(self, dataset: Dataset) -> list[TouchSpan | None]:
        """Return the touch of largest impulse of each clip."""
        clips = [(n, clip) for n, some in enumerate(dataset.clips) for clip in some]
        starts = dataset.starts
        ends = find_last_rows(dataset, clips)
        return [TouchSpan(int(starts[n]), (n,)) if n >= 0 else None for n in ends]

    def of_touches(self) -> "ClipExamples":
        """Return the same clips with windows of their touches alone."""
        return replace(self, touch_alone=True)

    def mark_touches(self, path: Path) -> Bool[np.ndarray, "clip 100 taxel"]:
        """Return which taxels belong to the touch of each clip, reading by reading."""
        dataset = self.load_dataset(path)
        clips = dataset.clips[0]
        taxels = dataset.recordings[0].skin.count
        marks = np.zeros((len(clips), READINGS, taxels), bool)
        touches = self.find_touches(dataset)
        for mark, clip, touch in zip(marks, clips, touches, strict=True):
            if touch is None:
                continue
            rows = select_rows(touch)
            graphs = dataset.graphs.select(rows)
            ages = dataset.stamps[rows] - clip.start
            slots = (ages * READINGS // (clip.end - clip.start)).clip(0, READINGS - 1)
            mark[slots[graphs.graph_index], graphs.taxels] = True
        return marks

    def cut_windows(self, path: Path) -> Arrays:
        """Return the window that each clip of a recording is."""
        pressure, q = cut_clip_windows(path)
        if self.touch_alone:
            pressure = np.where(self.mark_touches(path), pressure, 0.0)
        count = len(pressure)
        return {
            "count": np.array(count),
            "pressure": pressure,
            "q": q,
            "example": np.arange(count),
        }


def find_examples(places: Sequence[Path], pack: Path, workers: int = 1) -> ClipExamples:
    """Return the clips of recordings, or of folders of them.

    Args:
        places: paths of recordings and folders.
        pack: folder that keeps prepared recordings.
        workers: number of processes that prepare them.

    Raises:
        RecordingError: if there is none, or one that is not of a set of clips.
    """
    paths = find_recordings(places)
    bare = next((path for path in paths if not read_clips(path)), None)
    if bare is not None:
        raise RecordingError(
            f"{bare} is of no set of clips; allowed are sets of clips; make one with "
            "eskin generate OUT --set paper, or give labelled recordings as "
            "--recordings"
        )
    return ClipExamples(paths, pack, workers)


def cut_clip_windows(
    path: Path,
) -> tuple[Float[np.ndarray, "clip 100 taxel"], Float[np.ndarray, "clip 100 joint"]]:
    """Return pressure [kPa] (float16) and joint positions [rad] of clips.

    Counts go through the same calibration, fault detection and crosstalk removal as
    live. Taxels that are invalid, or whose pressure may be noise alone, read zero, and
    none reads more than `LARGEST_PRESSURE`; a missing reading repeats the one before.
    """
    recording = read_recording(path)
    clips = read_clips(path)
    taxels = recording.skin.count
    joints = len(recording.joint_names)
    pressure = np.zeros((len(clips), READINGS, taxels), np.float16)
    q = np.zeros((len(clips), READINGS, joints), np.float32)
    starts = np.array([clip.start for clip in clips])
    begun = np.zeros(len(clips), dtype=bool)
    for stamp, felt, positions in read_pressures(recording):
        n = int(np.searchsorted(starts, stamp, "right")) - 1
        if n < 0 or stamp >= clips[n].end:
            continue
        length = clips[n].end - clips[n].start
        slot = (stamp - clips[n].start) * READINGS // length
        pressure[n, slot:] = felt
        q[n, slot if begun[n] else 0 :] = positions
        begun[n] = True
    return pressure, q


def read_pressures(
    recording: Recording,
) -> Iterator[tuple[int, Float[np.ndarray, "taxel"], Float[np.ndarray, "joint"]]]:
    """Yield stamp [ns], pressure [kPa] and joint positions [rad] of every reading."""
    mounted = MountedSkin(recording.skin, recording.load_robot())
    pipeline = TouchPipeline(mounted, recording.calibration)
    for scan in recording.scans():
        reading, _ = pipeline.calibrate(scan)
        above = reading.pressure >= pipeline.front_end.floor
        bounded = np.minimum(reading.pressure, LARGEST_PRESSURE)
        felt = np.where(reading.valid & above, bounded, 0.0)
        yield reading.stamp, felt, reading.q
