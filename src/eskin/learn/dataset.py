"""This module joins prepared recordings into one data set for training and scoring."""

import hashlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from joblib import Parallel, delayed

from eskin.errors import RecordingError
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
from eskin.learn.mapped_graphs import map_graphs
from eskin.learn.prepared_recording import (
    PreparedRecording,
    load_prepared,
    pack_recording,
    prepare_recording,
)
from eskin.learn.recording_transforms import RecordingTransform
from eskin.live import (
    GraphBatch,
    GraphConfig,
    create_empty_batch,
    join_graphs,
)
from eskin.progress import track_progress
from eskin.recording import (
    NO_OVERRIDES,
    NONE,
    Overrides,
    Recording,
    read_recording,
)
from eskin.touch import PipelineConfig
from eskin.units import format_count

NO_GRAPHS = create_empty_batch(0)


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set holds sequences of graphs laid end to end.

    One row is one reading of one touch.
    """

    recordings: tuple[Recording, ...]
    """Recordings that the rows come from; transformed copies follow the originals."""
    graphs: GraphBatch
    """Contact graph of each row."""
    stamps: Int[np.ndarray, "row"]
    """Stamp of each row's reading [ns since the epoch]."""
    sequence: Int[np.ndarray, "row"]
    """Number of the sequence of each row, counted from 0; rows of one sequence are
    neighbours."""
    recording: Int[np.ndarray, "row"]
    """Index of each row's recording in `recordings`."""
    gestures: tuple[str, ...]
    """Gesture of each row, `none` where there was none."""
    segments: tuple[Segment, ...]
    """Segments of one gesture, in the order of the rows."""
    missed: tuple[MissedGesture, ...] = ()
    """Labelled gestures during which no touch was detected."""
    clips: tuple[tuple[Clip, ...], ...] = ()
    """Clips of each recording; empty for one that is not part of a set of clips."""
    copies: int = 1
    """Number of times that the recordings are repeated, each by another transform."""

    @property
    def original_count(self) -> int:
        """Return the number of recordings without their transformed copies."""
        return len(self.recordings) // self.copies

    def with_copies(self, recordings: Collection[int]) -> frozenset[int]:
        """Return the indices of some recordings and of all their copies."""
        indices, originals = range(len(self.recordings)), self.original_count
        return frozenset(n for n in indices if n % originals in recordings)

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Return `none`, then every gesture that occurs, sorted."""
        return (NONE, *sorted(set(self.gestures) - {NONE}))

    @property
    def labelled(self) -> tuple[Segment, ...]:
        """Return the segments whose gesture is labelled: those to score."""
        return tuple(segment for segment in self.segments if segment.labelled)

    @property
    def has_shear(self) -> bool:
        """Tell whether the skin of every recording measures shear."""
        return all(recording.skin.has_shear for recording in self.recordings)

    @cached_property
    def starts(self) -> Int[np.ndarray, "row"]:
        """Return the first row of the sequence of each row."""
        return np.searchsorted(self.sequence, self.sequence)


def prepare(
    paths: Sequence[Path],
    pipeline: PipelineConfig | None = None,
    graph: GraphConfig | None = None,
    pack: Path | None = None,
    workers: int = 1,
    transforms: Sequence[RecordingTransform | None] = (None,),
    overrides: Overrides = NO_OVERRIDES,
) -> Dataset:
    """Replay recordings through the same calibration, contacts and graphs as live.

    Where one of them has no shear, that of the others is not used.

    Args:
        paths: paths of the recordings.
        pipeline: how counts become touches.
        graph: how touches become graphs.
        pack: folder that keeps prepared recordings, to be prepared once only.
        workers: how many processes prepare them; more than one needs `pack`.
        transforms: transforms, one copy of the recordings each; None changes nothing.
        overrides: what to use in place of what the recordings hold.

    Raises:
        RecordingError: if there is nothing to learn from.
    """
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    recordings = tuple(read_recording(path, overrides) for path in paths)
    pipeline, graph = pipeline or PipelineConfig(), graph or GraphConfig()
    if not all(recording.skin.has_shear for recording in recordings):
        graph = graph.without_shear()
    total = len(recordings) * len(transforms)
    if pack is None:
        prepared = (
            prepare_recording(r, pipeline, graph, t)
            for t in transforms
            for r in recordings
        )
        parts = track_progress(prepared, "Reading", total)
    else:
        jobs = (
            delayed(pack_recording)(path, pack, pipeline, graph, t, overrides)
            for t in transforms
            for path in paths
        )
        files: Any = Parallel(n_jobs=workers, return_as="generator")(jobs)
        parts = map(load_prepared, track_progress(files, "Packing", total))
    copies = len(transforms)
    dataset = concatenate_recordings(recordings * copies, parts, copies, pack)
    if not len(dataset.stamps):
        raise RecordingError(
            f"no touch in {format_count(len(paths), 'recording')}; allowed are "
            "recordings of touches; check that they were converted, and the thresholds"
        )
    return dataset


def concatenate_recordings(
    recordings: tuple[Recording, ...],
    parts: Iterable[PreparedRecording],
    copies: int = 1,
    folder: Path | None = None,
) -> Dataset:
    """Join prepared recordings into one data set.

    Args:
        recordings: recordings, all of them again for every copy.
        parts: their prepared forms.
        copies: number of copies.
        folder: folder on whose disk the graphs are laid; in memory where None.
    """
    rows: list[PreparedRecording] = []

    def take_graphs() -> Iterator[GraphBatch]:
        for part in parts:
            rows.append(replace(part, graphs=NO_GRAPHS))
            yield part.graphs

    graphs = map_graphs(take_graphs(), folder) if folder else join_graphs(take_graphs())
    gestures: list[str] = []
    segments: list[Segment] = []
    missed: list[MissedGesture] = []
    sequences: list[np.ndarray] = []
    sequence_count = 0
    for index, (recording, part) in enumerate(zip(recordings, rows, strict=True)):
        offset = len(gestures)
        if part.touches is not None:
            added = build_true_segments(part.sequence, part.touches, index, offset)
        else:
            labels = extend_labels(recording)
            label_index = find_label_indices(labels, part.stamps)
            added = build_labelled_segments(
                labels, label_index, part.sequence, index, offset
            )
            if recording.metadata.partly_labelled:
                added = [segment for segment in added if segment.labelled]
            detected = set(label_index.tolist())
            missed += [
                MissedGesture(gesture, index)
                for gesture in find_missed_gestures(recording, labels, detected)
            ]
        segments += added
        names = [NONE] * len(part.stamps)
        for segment in added:
            first, end = segment.first - offset, segment.end - offset
            names[first:end] = [segment.gesture] * (end - first)
        gestures += names
        sequences.append(part.sequence + sequence_count)
        sequence_count += int(part.sequence.max(initial=-1)) + 1
    return Dataset(
        recordings=recordings,
        graphs=graphs,
        stamps=np.concatenate([part.stamps for part in rows]),
        sequence=np.concatenate(sequences),
        recording=np.repeat(np.arange(len(rows)), [len(p.stamps) for p in rows]),
        gestures=tuple(gestures),
        segments=tuple(segments),
        missed=tuple(missed),
        clips=tuple(read_clips(recording.path) for recording in recordings),
        copies=copies,
    )


def hash_recordings(paths: Sequence[Path]) -> str:
    """Return SHA-256 over the bytes of recordings, whatever their order."""
    parts = sorted(hashlib.sha256(path.read_bytes()).hexdigest() for path in paths)
    return hashlib.sha256("".join(parts).encode()).hexdigest()
