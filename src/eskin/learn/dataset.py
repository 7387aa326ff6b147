"""A data set holds prepared recordings laid end to end, ready for learning."""

import hashlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Int
from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import track

from eskin.errors import RecordingError
from eskin.graph import GraphBatch, GraphConfig, join
from eskin.learn.ground_truth import (
    Clip,
    MissedGesture,
    Segment,
    build_labelled_segments,
    build_true_segments,
    extend_labels,
    find_label_indices,
    find_missed_gestures,
    read_clips,
)
from eskin.learn.prepared_recording import (
    PreparedRecording,
    load_prepared,
    pack_recording,
    prepare_recording,
)
from eskin.learn.recording_transforms import RecordingTransform
from eskin.recording import NONE, Recording, read_recording
from eskin.touch import PipelineConfig

T = TypeVar("T")


def track_progress(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    """The same items; until the last, a bar stands on the terminal if there is one.

    Args:
        items: as they get ready.
        what: is done.
        total: how many there are.
    """
    console = Console(stderr=True)
    silent = not console.is_terminal
    yield from track(
        items, what, total, console=console, transient=True, disable=silent
    )


@dataclass(frozen=True, eq=False)
class Dataset:
    """Sequences of graphs, one row a reading and touch, laid end to end."""

    recordings: tuple[Recording, ...]
    """Where the rows come from."""

    graphs: GraphBatch
    """One graph a row."""

    stamps: Int[np.ndarray, "row"]
    """Of the row's reading [ns since the epoch]."""

    sequence: Int[np.ndarray, "row"]
    """The sequence of each row, counted from 0; rows of one sequence are neighbours."""

    recording: Int[np.ndarray, "row"]
    """Index into `recordings`."""

    gestures: tuple[str, ...]
    """The gesture at each row, `none` where there was none."""

    segments: tuple[Segment, ...]
    """The labelled gestures, in the order of the rows."""

    missed: tuple[MissedGesture, ...] = ()
    """The labelled gestures that nothing was detected of."""

    clips: tuple[tuple[Clip, ...], ...] = ()
    """The clips of each recording; none where it is no file of a set of clips."""

    versions: int = 1
    """How often `recordings` is repeated, once for each version of them."""

    @property
    def own(self) -> int:
        """Number of recordings; the others are further versions of these."""
        return len(self.recordings) // self.versions

    def with_copies(self, recordings: Collection[int]) -> frozenset[int]:
        """Some of the recordings in their first version, and in all others."""
        every = range(len(self.recordings))
        return frozenset(index for index in every if index % self.own in recordings)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """`none`, then every gesture that occurs, sorted."""
        return (NONE, *sorted(set(self.gestures) - {NONE}))

    @property
    def labelled(self) -> tuple[Segment, ...]:
        """The segments that a label speaks of: what is scored."""
        return tuple(segment for segment in self.segments if segment.labelled)

    @property
    def has_shear(self) -> bool:
        """Whether every recording's skin measures shear."""
        return all(recording.skin.has_shear for recording in self.recordings)

    @cached_property
    def starts(self) -> Int[np.ndarray, "row"]:
        """First row of the sequence of each row."""
        return np.searchsorted(self.sequence, self.sequence)


def prepare(
    paths: Sequence[Path],
    pipeline: PipelineConfig | None = None,
    graph: GraphConfig | None = None,
    pack: Path | None = None,
    workers: int = 1,
    versions: Sequence[RecordingTransform | None] = (None,),
) -> Dataset:
    """Run recordings through the same calibration, contacts and graphs as live.

    Where one of them has no shear, that of the others is not looked at.

    Args:
        paths: the recordings.
        pipeline: how counts become touches.
        graph: how touches become graphs.
        pack: folder that keeps prepared recordings, to be prepared once only.
        workers: how many processes prepare them; more than one needs `pack`.
        versions: of each of them; None is as it was recorded.

    Raises:
        RecordingError: if there is nothing to learn from.
    """
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    recordings = tuple(read_recording(path) for path in paths)
    pipeline, graph = pipeline or PipelineConfig(), graph or GraphConfig()
    if not all(recording.skin.has_shear for recording in recordings):
        graph = graph.without_shear()
    total = len(recordings) * len(versions)
    if pack is None:
        made = (
            prepare_recording(r, pipeline, graph, v)
            for v in versions
            for r in recordings
        )
        parts = list(track_progress(made, "Reading", total))
    else:
        make = delayed(pack_recording)
        jobs = (
            make(path, pack, pipeline, graph, v) for v in versions for path in paths
        )
        files: Any = Parallel(n_jobs=workers, return_as="generator")(jobs)
        parts = [
            load_prepared(file) for file in track_progress(files, "Packing", total)
        ]
    if not any(len(part.stamps) for part in parts):
        raise RecordingError(
            f"no touch in {len(paths)} recordings; allowed are recordings of touches; "
            "check that they were converted, and the thresholds"
        )
    return concatenate_recordings(recordings * len(versions), parts, len(versions))


def concatenate_recordings(
    recordings: tuple[Recording, ...],
    parts: Sequence[PreparedRecording],
    versions: int = 1,
) -> Dataset:
    """Join prepared recordings into one data set.

    Args:
        recordings: what was prepared, the same again for every version.
        parts: of each of them.
        versions: how many there are.
    """
    gestures: list[str] = []
    segments: list[Segment] = []
    missed: list[MissedGesture] = []
    sequences: list[np.ndarray] = []
    begun = 0
    for index, (recording, part) in enumerate(zip(recordings, parts, strict=True)):
        offset = len(gestures)
        if part.fits is not None:
            found = build_true_segments(part.sequence, part.fits, index, offset)
        else:
            labels = extend_labels(recording)
            places = find_label_indices(labels, part.stamps)
            found = build_labelled_segments(
                labels, places, part.sequence, index, offset
            )
            felt = set(places.tolist())
            missed += [
                MissedGesture(gesture, index)
                for gesture in find_missed_gestures(recording, labels, felt)
            ]
        segments += found
        gestures += [s.gesture for s in found for _ in range(s.first, s.end)]
        sequences.append(part.sequence + begun)
        begun += int(part.sequence.max(initial=-1)) + 1
    return Dataset(
        recordings=recordings,
        graphs=join([part.graphs for part in parts]),
        stamps=np.concatenate([part.stamps for part in parts]),
        sequence=np.concatenate(sequences),
        recording=np.repeat(np.arange(len(parts)), [len(p.stamps) for p in parts]),
        gestures=tuple(gestures),
        segments=tuple(segments),
        missed=tuple(missed),
        clips=tuple(read_clips(recording.path) for recording in recordings),
        versions=versions,
    )


def hash_recordings(paths: Sequence[Path]) -> str:
    """SHA-256 over the recordings' bytes, whatever their order."""
    parts = sorted(hashlib.sha256(path.read_bytes()).hexdigest() for path in paths)
    return hashlib.sha256("".join(parts).encode()).hexdigest()
