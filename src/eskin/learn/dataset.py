"""Recordings made ready for learning: every reading tracked and its graphs laid out."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int
from rich.progress import track

from eskin.errors import RecordingError
from eskin.graph import GraphBatch, GraphConfig, GraphStream, join
from eskin.recording import (
    NONE,
    Label,
    Recording,
    label_instants,
    read_recording,
    sort_labels,
)
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline

LINGER_NS = 600_000_000
"""How long after its end a gesture on a calibrated skin is still asked for [ns]."""

LATEST = 2**63 - 1
"""Later than every stamp [ns]."""


@dataclass(frozen=True)
class Segment:
    """One labelled gesture in one sequence of graphs."""

    gesture: str
    """What was done."""

    recording: int
    """Index into `Dataset.recordings`."""

    first: int
    """Its first row."""

    end: int
    """The row behind its last one."""

    labelled: bool
    """Whether a label says so; where there is none, it is `none` by silence."""


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
) -> Dataset:
    """Run recordings through the same calibration, contacts and graphs as live.

    Raises:
        RecordingError: if there is nothing to learn from.
    """
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    rows: list[Rows] = []
    recordings = tuple(read_recording(path) for path in paths)
    for index, recording in enumerate(
        track(recordings, description="Reading", disable=len(paths) < 2)
    ):
        rows += sequences_of(recording, index, pipeline, graph)
    if not rows:
        raise RecordingError(
            f"no touch in {len(paths)} recordings; allowed are recordings of touches; "
            "check that they were converted, and the thresholds"
        )
    return lay_end_to_end(recordings, rows)


@dataclass
class Rows:
    """One sequence while it is being gathered."""

    recording: int
    graphs: list[GraphBatch]
    stamps: list[int]


def sequences_of(
    recording: Recording,
    index: int,
    pipeline: PipelineConfig | None,
    graph: GraphConfig | None,
) -> list[Rows]:
    """All sequences of one recording."""
    mounted = MountedSkin(recording.skin, load_robot(recording.robot_name))
    touches = TouchPipeline(mounted, recording.calibration, pipeline)
    stream = GraphStream(mounted, graph)
    found: dict[int, Rows] = {}
    for scan in recording.scans():
        for key, batch in stream.push(touches.push(scan)).items():
            rows = found.setdefault(key, Rows(index, [], []))
            rows.graphs.append(batch)
            rows.stamps.append(scan.stamp)
    return list(found.values())


def lay_end_to_end(recordings: tuple[Recording, ...], sequences: list[Rows]) -> Dataset:
    """Join sequences into one data set."""
    gestures: list[str] = []
    segments: list[Segment] = []
    for rows in sequences:
        labels, stamps = labels_of(recordings[rows.recording]), np.array(rows.stamps)
        names = gestures_at(labels, stamps)
        spoken = [(stamps >= label.start) & (stamps < label.end) for label in labels]
        silent = ~np.any(spoken, axis=0) if spoken else np.ones(len(names), dtype=bool)
        segments += segments_of(names, silent, rows.recording, len(gestures))
        gestures += names
    lengths = [len(rows.stamps) for rows in sequences]
    return Dataset(
        recordings=recordings,
        graphs=join([graph for rows in sequences for graph in rows.graphs]),
        stamps=np.concatenate([np.array(rows.stamps) for rows in sequences]),
        sequence=np.repeat(np.arange(len(sequences)), lengths),
        recording=np.repeat([rows.recording for rows in sequences], lengths),
        gestures=tuple(gestures),
        segments=tuple(segments),
    )


def labels_of(recording: Recording) -> list[Label]:
    """Its true labels; where the truth is not known the automatic ones, else the rough.

    On a calibrated skin a label lasts 0.6 s longer, or until the next one: a touch
    keeps its gesture until it closes.
    """
    sources = ("true", "auto", "range")
    best = (sort_labels(recording.labels, source) for source in sources)
    truth = next((labels for labels in best if labels), ())
    if not recording.skin.calibrated:
        return list(truth)
    nexts = [label.start for label in truth[1:]] + [LATEST]
    return [
        replace(label, end=max(label.end, min(label.end + LINGER_NS, start)))
        for label, start in zip(truth, nexts, strict=True)
    ]


def gestures_at(labels: list[Label], stamps: Int[np.ndarray, "row"]) -> list[str]:
    """The gesture at each stamp."""
    names = [NONE, *sorted({label.gesture for label in labels} - {NONE})]
    return [names[i] for i in label_instants(labels, stamps, names)]


def segments_of(
    names: list[str],
    silent: Bool[np.ndarray, "row"],
    recording: int,
    offset: int,
) -> list[Segment]:
    """One segment for each run of one gesture.

    Args:
        names: the gesture at each row.
        silent: where no label says anything.
        recording: the recording of the rows.
        offset: the place of the first row in the data set.
    """
    array = np.array(names)
    breaks = np.flatnonzero(array[1:] != array[:-1]) + 1
    bounds = [0, *breaks.tolist(), len(names)]
    return [
        Segment(
            names[first], recording, offset + first, offset + end, not silent[first]
        )
        for first, end in zip(bounds[:-1], bounds[1:], strict=True)
    ]


def digest(paths: Sequence[Path]) -> str:
    """SHA-256 over the recordings' bytes, whatever their order."""
    parts = sorted(hashlib.sha256(path.read_bytes()).hexdigest() for path in paths)
    return hashlib.sha256("".join(parts).encode()).hexdigest()
