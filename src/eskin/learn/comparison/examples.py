"""Clips of generated sets, as every method is given them."""

import hashlib
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
from eskin.graph import GraphConfig
from eskin.learn.baselines import READINGS, SkinWindows
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.ground_truth import Clip, read_clips
from eskin.learn.recording_transforms import Aging, AgingConfig, RecordingTransform
from eskin.recording import Recording, find_recordings, read_recording
from eskin.robot import load_recorded_robot
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline

FORMAT = 1
"""Of the files that keep windows."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Clips, for methods that see touches and for those that see the whole skin."""

    paths: tuple[Path, ...]
    """The recordings."""

    pack: Path
    """Folder that keeps what was prepared of them."""

    workers: int = 1
    """How many processes prepare."""

    harm: RecordingTransform | None = None
    """What harms them; nothing where None."""

    @cached_property
    def every(self) -> tuple[tuple[int, Clip], ...]:
        """All clips, each with the index of its recording."""
        numbered = enumerate(self.paths)
        return tuple((n, clip) for n, path in numbered for clip in read_clips(path))

    @cached_property
    def gestures(self) -> tuple[str, ...]:
        """What the clips were made for, sorted."""
        return tuple(sorted({clip.gesture for _, clip in self.every}))

    @cached_property
    def sittings(self) -> dict[int, tuple[str, str]]:
        """Person and session of each recording."""
        facts = [read_recording(path).metadata for path in self.paths]
        return {n: (each.subject, each.session) for n, each in enumerate(facts)}

    @cached_property
    def people(self) -> tuple[str, ...]:
        """Who made each clip."""
        return tuple(self.sittings[n][0] for n, _ in self.every)

    @cached_property
    def mounted(self) -> MountedSkin:
        """The skin of the clips on its robot."""
        first = read_recording(self.paths[0])
        return MountedSkin(first.skin, load_recorded_robot(first.robot_name))

    @cached_property
    def digest(self) -> str:
        """Names recordings and clips, wherever they are, and what harms them."""
        hashes = [hashlib.sha256(path.read_bytes()).hexdigest() for path in self.paths]
        hashes += [str(self.every)]
        hashes += [str(self.harm)] if self.harm else []
        return hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]

    def truth(self, vocabulary: Sequence[str]) -> Int[np.ndarray, "clip"]:
        """What each clip was made for, as an index into a vocabulary."""
        return np.array([vocabulary.index(clip.gesture) for _, clip in self.every])

    def dataset(self, graph: GraphConfig, skins: int = 0) -> Dataset:
        """The touches of the clips as graphs, felt by so many worn skins besides."""
        others = (Aging(AgingConfig(), number) for number in range(skins))
        transforms, plain = (self.harm, *others), graph.without_shear()
        return prepare(self.paths, None, plain, self.pack, self.workers, transforms)

    @cached_property
    def windows(self) -> SkinWindows:
        """All taxels in the two seconds of each clip, wherever they lie."""
        harm = None if self.harm is None or self.harm.moves_taxels else self.harm
        jobs = (delayed(load_windows)(path, self.pack, harm) for path in self.paths)
        parts: Any = Parallel(n_jobs=self.workers)(jobs)
        return SkinWindows(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))

    def find_windows_on(
        self, mounted: MountedSkin
    ) -> Iterator[tuple[MountedSkin, SkinWindows]]:
        """The windows in order, each with where its skin is believed to lie.

        Args:
            mounted: where it lies.
        """
        if self.harm is None or not self.harm.moves_taxels:
            yield mounted, self.windows
            return
        for n, path in enumerate(self.paths):
            skin = self.harm.transform_skin(mounted.skin, read_recording(path).start)
            yield MountedSkin(skin, mounted.robot), self.only([n]).windows

    def only(self, recordings: Collection[int]) -> "Examples":
        """Those of some of the recordings."""
        return replace(self, paths=tuple(self.paths[n] for n in sorted(recordings)))


def find_examples(places: Sequence[Path], pack: Path, workers: int = 1) -> Examples:
    """The clips of recordings, or of folders of them.

    Args:
        places: recordings and folders.
        pack: folder that keeps what was prepared of them.
        workers: how many processes prepare.

    Raises:
        RecordingError: there is no recording, or one that is not of a set of clips.
    """
    paths = find_recordings(places)
    bare = next((path for path in paths if not read_clips(path)), None)
    if bare is not None:
        raise RecordingError(
            f"{bare} is of no set of clips; allowed are sets of clips; make one with: "
            "eskin generate OUT --set paper"
        )
    return Examples(paths, pack, workers)


def load_windows(
    path: Path, pack: Path, harm: RecordingTransform | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The windows of the clips of a recording, made where they are not there yet."""
    with path.open("rb") as file:
        content = hashlib.file_digest(file, "sha256").hexdigest()
    facts = f"{FORMAT} {content} {PipelineConfig()}" + (f" {harm}" if harm else "")
    target = pack / f"{hashlib.sha256(facts.encode()).hexdigest()[:32]}.windows.npz"
    if not target.exists():
        pressure, q = cut_clip_windows(path, harm)
        with atomic_path(target) as part:
            np.savez(part, pressure=pressure, q=q)
    with np.load(target) as arrays:
        return arrays["pressure"], arrays["q"]


def cut_clip_windows(
    path: Path, harm: RecordingTransform | None = None
) -> tuple[
    Float[np.ndarray, "clip 100 taxel"],
    Float[np.ndarray, "clip 100 joint"],
]:
    """Pressure [kPa] (float16) and joint positions [rad] in the clips of a recording.

    Counts go through the same calibration, faults and crosstalk as live. What is not
    valid reads zero; where no reading came, the window shows the one before.
    """
    recording = read_recording(path)
    clips = read_clips(path)
    taxels, joints = recording.skin.count, len(recording.joint_names)
    pressure = np.zeros((len(clips), READINGS, taxels), np.float16)
    q = np.zeros((len(clips), READINGS, joints), np.float32)
    starts = np.array([clip.start for clip in clips])
    begun = np.zeros(len(clips), dtype=bool)
    for stamp, felt, positions in read_pressures(recording, harm):
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
    recording: Recording, harm: RecordingTransform | None = None
) -> Iterator[tuple[int, Float[np.ndarray, "taxel"], Float[np.ndarray, "joint"]]]:
    """Stamp [ns], pressure [kPa] and joint positions [rad] of every reading."""
    mounted = MountedSkin(recording.skin, load_recorded_robot(recording.robot_name))
    pipeline = TouchPipeline(mounted, recording.calibration)
    for scan in harm.transform_scans(recording) if harm else recording.scans():
        reading, _ = pipeline.calibrate(scan)
        felt = np.where(reading.valid, reading.pressure, 0.0)
        yield reading.stamp, felt, reading.q
