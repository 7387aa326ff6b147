"""Recordings made ready for learning: every reading tracked and its graphs laid out."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int
from rich.progress import track

from eskin.errors import RecordingError
from eskin.graph import GraphBatch, GraphConfig, GraphStream, join
from eskin.recording import Recording, label_instants, read_recording
from eskin.recording.labels import NONE
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline


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
    def has_shear(self) -> bool:
        """Whether every recording's skin measures shear."""
        return all(recording.skin.has_shear for recording in self.recordings)

    @property
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
        names = gestures_at(recordings[rows.recording], np.array(rows.stamps))
        segments += segments_of(names, rows.recording, len(gestures))
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


def gestures_at(recording: Recording, stamps: Int[np.ndarray, "row"]) -> list[str]:
    """The gesture at each stamp, by the truth where known, else by other labels."""
    truth = [label for label in recording.labels if label.source == "true"]
    labels = truth or list(recording.labels)
    names = [NONE, *sorted({label.gesture for label in labels} - {NONE})]
    return [names[i] for i in label_instants(labels, stamps, names)]


def segments_of(names: list[str], recording: int, offset: int) -> list[Segment]:
    """One segment for each run of one gesture."""
    array = np.array(names)
    breaks = np.flatnonzero(array[1:] != array[:-1]) + 1
    bounds = [0, *breaks.tolist(), len(names)]
    return [
        Segment(names[first], recording, offset + first, offset + end)
        for first, end in zip(bounds[:-1], bounds[1:], strict=True)
    ]


def digest(paths: Sequence[Path]) -> str:
    """SHA-256 over the recordings' bytes, whatever their order."""
    parts = sorted(hashlib.sha256(path.read_bytes()).hexdigest() for path in paths)
    return hashlib.sha256("".join(parts).encode()).hexdigest()
