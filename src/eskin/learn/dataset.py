"""This module joins prepared recordings into one data set for training and scoring.

Contact graphs are laid end to end, in memory or, for sets larger than that, on disk.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

import numpy as np
from jaxtyping import Int
from joblib import Parallel, delayed

from eskin.errors import RecordingError
from eskin.learn.ground_truth import (
    Clip,
    LabelMatch,
    MissedGesture,
    Segment,
    build_labelled_segments,
    build_true_segments,
    match_labels,
    read_clips,
    warn_of_missed,
)
from eskin.learn.prepared_recording import (
    PreparedRecording,
    load_prepared,
    pack_recording,
    prepare_recording,
)
from eskin.learn.recording_transforms import RecordingTransform
from eskin.live import (
    GRAPH_FIELDS,
    NODE_FIELDS,
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
    check_labels,
    read_recording,
)
from eskin.touch import PipelineConfig
from eskin.units import format_count

NO_GRAPHS = create_empty_batch(0)

TAKES = 5
"""Number of takes of a gesture in one recording of which one is held out."""


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
        indices = range(len(self.recordings))
        originals = self.original_count
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

    def report_truncated(self, tell: Callable[[str], object]) -> None:
        """Tell the paths of the recordings whose end is missing."""
        for recording in self.recordings[: self.original_count]:
            if recording.truncated:
                tell(f"{recording.path} is cut or damaged: used up to there")

    def select_classes(self, asked: Sequence[str]) -> tuple[str, ...]:
        """Return `none` and the gestures to learn: those asked for, or all.

        Raises:
            RecordingError: if one of them has no label in the recordings.
        """
        known = self.vocabulary
        missing = sorted(set(asked) - set(known))
        if missing:
            raise RecordingError(
                f"no recording is labelled {', '.join(missing)}; labelled are "
                f"{', '.join(known)}; name some of these with --classes"
            )
        return (NONE, *(g for g in known[1:] if not asked or g in asked))

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
        RecordingError: if there is nothing to learn from, or labels cannot be right, as
            `check_labels` says.
    """
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    recordings = tuple(read_recording(path, overrides) for path in paths)
    check_labels([recording.label_set for recording in recordings], needed=True)
    pipeline = pipeline or PipelineConfig()
    graph = graph or GraphConfig()
    if not all(recording.skin.has_shear for recording in recordings):
        graph = graph.without_shear()
    total = len(recordings) * len(transforms)
    if pack is None:
        prepared = (
            prepare_recording(r, pipeline, graph, t)
            for t in transforms
            for r in recordings
        )
        tracking = closing(track_progress(prepared, "Reading", total))
    else:
        jobs = (
            delayed(pack_recording)(path, pack, pipeline, graph, t, overrides)
            for t in transforms
            for path in paths
        )
        files: Any = Parallel(n_jobs=workers, return_as="generator")(jobs)
        loaded = map(load_prepared, files)
        tracking = closing(track_progress(loaded, "Packing", total))
    copies = len(transforms)
    with tracking as parts:
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

    Raises:
        RecordingError: if labels lie beside the touches.
    """
    rows: list[PreparedRecording] = []

    def take_graphs() -> Iterator[GraphBatch]:
        for part in parts:
            rows.append(replace(part, graphs=NO_GRAPHS))
            yield part.graphs

    graphs = map_graphs(take_graphs(), folder) if folder else join_graphs(take_graphs())
    gestures: list[str] = []
    segments: list[Segment] = []
    matches: list[LabelMatch] = []
    missed: list[MissedGesture] = []
    sequences: list[np.ndarray] = []
    sequence_count = 0
    for index, (recording, part) in enumerate(zip(recordings, rows, strict=True)):
        offset = len(gestures)
        if part.touches is not None:
            added = build_true_segments(part.sequence, part.touches, index, offset)
        else:
            match = match_labels(recording, part.stamps, part.sequence)
            if index < len(recordings) // copies:
                matches.append(match)
            added = build_labelled_segments(
                match.labels, match.label_index, part.sequence, index, offset
            )
            if recording.metadata.partly_labelled:
                added = [segment for segment in added if segment.labelled]
            missed += [MissedGesture(each.gesture, index) for each in match.missed]
        segments += added
        names = [NONE] * len(part.stamps)
        for segment in added:
            first = segment.first - offset
            end = segment.end - offset
            names[first:end] = [segment.gesture] * (end - first)
        gestures += names
        sequences.append(part.sequence + sequence_count)
        sequence_count += int(part.sequence.max(initial=-1)) + 1
    check_labels([match.label_set for match in matches])
    warn_of_missed(matches)
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


def map_graphs(batches: Iterable[GraphBatch], folder: Path) -> GraphBatch:
    """Lay batches end to end in files, and return them memory-mapped, read-only.

    The files have no names, so the system deletes them with the last reference or
    process. Only one batch is in memory at a time. What is zero in all batches, as
    shear is where no skin measures it, takes no space.

    Args:
        batches: batches of one data set, whose arrays have equal types and widths.
        folder: folder on whose disk there is space.

    Raises:
        ValueError: if there is no batch.
        OSError: if the disk is full.
    """
    sizes: list[np.ndarray] = []
    with ExitStack() as files:
        fields = {
            name: MappedField(folder, files) for name in (*NODE_FIELDS, *GRAPH_FIELDS)
        }
        for batch in batches:
            for name, field in fields.items():
                field.append(getattr(batch, name))
            sizes.append(batch.sizes)
        if not sizes:
            raise ValueError("no graphs to join; give at least one batch")
        arrays = {name: field.map() for name, field in fields.items()}
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(sizes))]).astype(np.int64)
    return GraphBatch(**arrays, offsets=offsets)


class MappedField:
    """A mapped field collects the rows of an array in a file."""

    def __init__(self, folder: Path, files: ExitStack) -> None:
        """Create a field without rows, whose file is closed with `files`."""
        self.folder = folder
        self.files = files
        self.file: IO[bytes] | None = None
        self.count = 0
        self.like = np.zeros(0, np.float32)

    def append(self, rows: np.ndarray) -> None:
        """Append rows; those before the first that is not zero are not written."""
        self.like = rows[:0].copy()
        if self.file is None and rows.any():
            self.file = self.files.enter_context(TemporaryFile(dir=self.folder))
            self.file.truncate(self.count * self.row_bytes)
            self.file.seek(0, 2)
        if self.file is not None:
            self.file.write(np.ascontiguousarray(rows).data)
        self.count += len(rows)

    @property
    def row_bytes(self) -> int:
        """Size of a row."""
        return self.like.dtype.itemsize * int(np.prod(self.like.shape[1:]))

    def map(self) -> np.ndarray:
        """Return all rows, memory-mapped."""
        shape = self.count, *self.like.shape[1:]
        if self.file is None:
            return np.broadcast_to(self.like.dtype.type(0), shape)
        self.file.flush()
        mapped = np.memmap(self.file, self.like.dtype, "r", shape=shape)
        return mapped.view(np.ndarray)


@dataclass(frozen=True)
class Holdout:
    """A holdout divides recordings, by their indices, into training and validation."""

    train: frozenset[int]
    """Recordings to train on."""
    held: frozenset[int]
    """Recordings to validate on."""
    wanted: int
    """Number of recordings that should be held out."""

    def __str__(self) -> str:
        """Return the number held out, and why it may differ from the one asked for."""
        count = len(self.train) + len(self.held)
        recordings = f"recording{'s' * (count != 1)}"
        text = f"{len(self.held)} of {count} {recordings} held out for validation"
        if len(self.held) == self.wanted:
            return text
        return (
            f"{text}, {self.wanted} asked for: sessions are held out whole, at most "
            "half of all recordings, and training keeps every gesture"
        )


def hold_out(
    sessions: Mapping[int, tuple[str, str]],
    gestures: Mapping[int, set[str]],
    share: float,
    rng: np.random.Generator,
) -> Holdout:
    """Hold out whole sessions of a person, or recordings if there is one session.

    Every class keeps recordings to train on.

    Args:
        sessions: person and session of each recording, by its index.
        gestures: classes that each recording has examples of.
        share: share of the recordings to hold out.
        rng: source of the random order.
    """
    order = rng.permutation(sorted(sessions)).tolist()
    wanted = round(share * len(order))
    train = frozenset(order)
    held = frozenset[int]()
    for group in group_sessions(sessions, order):
        fits = len(held) + len(group) <= wanted
        if wanted and not held:
            fits = fits or 2 * len(group) <= len(order)
        rest = train - group
        if fits and find_classes(rest, gestures) == find_classes(train, gestures):
            train = rest
            held = held | group
    return Holdout(train, held, wanted)


def hold_out_takes(dataset: Dataset) -> tuple[Dataset, Dataset]:
    """Divide a data set into takes to train on, and one of `TAKES` of each gesture.

    It is for too few recordings to hold out one of them. Gestures that were not felt
    are of neither part.
    """
    counts: Counter[tuple[int, str]] = Counter()
    parts: tuple[list[Segment], list[Segment]] = ([], [])
    for segment in dataset.segments:
        key = segment.recording, segment.gesture
        # The third take and every `TAKES`th after it.
        parts[counts[key] % TAKES == 2].append(segment)
        counts[key] += 1
    train, held = (replace(dataset, segments=tuple(part), missed=()) for part in parts)
    return train, held


def group_sessions(
    sessions: Mapping[int, tuple[str, str]], order: list[int]
) -> list[frozenset[int]]:
    """Return the recordings of each session; each alone if all are of one."""
    groups: dict[tuple[str, str], set[int]] = {}
    for index in order:
        groups.setdefault(sessions[index], set()).add(index)
    if len(groups) < 2:
        return [frozenset({index}) for index in order]
    return [frozenset(group) for group in groups.values()]


def find_classes(
    recordings: frozenset[int], gestures: Mapping[int, set[str]]
) -> set[str]:
    """Return the classes that some recordings have examples of."""
    return {gesture for index in recordings for gesture in gestures.get(index, ())}


def find_sessions(
    dataset: Dataset, recordings: list[int]
) -> dict[int, tuple[str, str]]:
    """Return person and session of some recordings."""
    metadata = [dataset.recordings[index].metadata for index in recordings]
    pairs = [(each.subject, each.session) for each in metadata]
    return dict(zip(recordings, pairs, strict=True))


def find_gestures(dataset: Dataset, vocabulary: tuple[str, ...]) -> dict[int, set[str]]:
    """Return the classes that each recording has examples of."""
    gestures: dict[int, set[str]] = {}
    for segment in dataset.segments:
        if segment.gesture in vocabulary:
            gestures.setdefault(segment.recording, set()).add(segment.gesture)
    return gestures
