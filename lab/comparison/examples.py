"""This module loads the clips of generated sets that all methods are compared on."""

import hashlib
import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from joblib import Parallel, delayed

from eskin.errors import RecordingError
from eskin.files import atomic_path
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.ground_truth import Clip, read_clips
from eskin.learn.prepared_recording import compute_file_key
from eskin.live import GraphConfig
from eskin.recording import Recording, find_recordings, read_recording
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline
from lab.baselines import READINGS, SkinWindows

LARGEST_PRESSURE = 300.0
"""Pressure to which windows are clipped [kPa], three times the largest of social touch
(98 kPa, Silvera-Tawil et al.). A saturated voltage divider reads without bound."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Examples are clips, as graphs of touches and as windows of the whole skin."""

    paths: tuple[Path, ...]
    """Paths of the recordings."""
    pack: Path
    """Folder that keeps prepared recordings."""
    workers: int = 1
    """Number of processes that prepare them."""

    @cached_property
    def clips(self) -> tuple[tuple[int, Clip], ...]:
        """Return all clips, each with the index of its recording."""
        numbered = enumerate(self.paths)
        return tuple((n, clip) for n, path in numbered for clip in read_clips(path))

    @cached_property
    def gestures(self) -> tuple[str, ...]:
        """Return the gestures that the clips were generated for, sorted."""
        return tuple(sorted({clip.gesture for _, clip in self.clips}))

    @cached_property
    def sessions(self) -> dict[int, tuple[str, str]]:
        """Return person and session of each recording."""
        metadata = [read_recording(path).metadata for path in self.paths]
        return {n: (each.subject, each.session) for n, each in enumerate(metadata)}

    @cached_property
    def people(self) -> tuple[str, ...]:
        """Return the person of each clip."""
        return tuple(self.sessions[n][0] for n, _ in self.clips)

    @cached_property
    def mounted(self) -> MountedSkin:
        """Return the skin of the clips on its robot."""
        first = read_recording(self.paths[0])
        return MountedSkin(first.skin, first.load_robot())

    @property
    def place(self) -> str:
        """Return the last two names of the folder that holds all recordings."""
        folder = os.path.commonpath([path.resolve().parent for path in self.paths])
        return "/".join(Path(folder).parts[-2:])

    @cached_property
    def digest(self) -> str:
        """Return a digest of recordings and clips, wherever they are."""
        hashes = [hashlib.sha256(path.read_bytes()).hexdigest() for path in self.paths]
        hashes += [str(self.clips)]
        return hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]

    def truth(self, vocabulary: Sequence[str]) -> Int[np.ndarray, "clip"]:
        """Return the true class of each clip, as an index into a vocabulary."""
        return np.array([vocabulary.index(clip.gesture) for _, clip in self.clips])

    def dataset(self, graph: GraphConfig) -> Dataset:
        """Return the clips' touches as graphs."""
        plain = graph.without_shear()
        return prepare(self.paths, None, plain, self.pack, self.workers)

    @cached_property
    def windows(self) -> SkinWindows:
        """Return pressures of all taxels and joint positions in each clip."""
        load = delayed(load_windows)
        jobs = (load(path, self.pack) for path in self.paths)
        parts: Any = Parallel(n_jobs=self.workers)(jobs)
        return SkinWindows(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))

    def select(self, recordings: Collection[int]) -> "Examples":
        """Return the examples of some of the recordings."""
        return replace(self, paths=tuple(self.paths[n] for n in sorted(recordings)))


def find_examples(places: Sequence[Path], pack: Path, workers: int = 1) -> Examples:
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
            f"{bare} is of no set of clips; allowed are sets of clips; make one with: "
            "eskin generate OUT --set paper"
        )
    return Examples(paths, pack, workers)


def load_windows(path: Path, pack: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the windows of a recording's clips; cut them unless they are on disk."""
    key = compute_file_key(__name__, path, str(PipelineConfig()), None)
    target = pack / f"{key}.windows.npz"
    if not target.exists():
        pressure, q = cut_clip_windows(path)
        with atomic_path(target) as part:
            np.savez(part, pressure=pressure, q=q)
    with np.load(target) as arrays:
        return arrays["pressure"], arrays["q"]


def cut_clip_windows(
    path: Path,
) -> tuple[Float[np.ndarray, "clip 100 taxel"], Float[np.ndarray, "clip 100 joint"]]:
    """Return pressure [kPa] (float16) and joint positions [rad] of clips.

    Counts go through the same calibration, fault detection and crosstalk removal as
    live. Taxels that are invalid, or whose pressure may be noise alone, read zero, and
    none reads more than `LARGEST_PRESSURE`; a missing reading repeats the one before.
    """
    recording, clips = read_recording(path), read_clips(path)
    taxels, joints = recording.skin.count, len(recording.joint_names)
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
        above = reading.pressure >= pipeline.faults.noise.limits.floor
        bounded = np.minimum(reading.pressure, LARGEST_PRESSURE)
        felt = np.where(reading.valid & above, bounded, 0.0)
        yield reading.stamp, felt, reading.q
