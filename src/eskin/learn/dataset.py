"""Recordings made ready for learning: every reading tracked and its graphs laid out."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Int
from rich.progress import track

from eskin.errors import RecordingError
from eskin.graph import GraphBatch, GraphConfig, GraphStream, join
from eskin.learn.segments import (
    Missed,
    Segment,
    gestures_at,
    labels_of,
    missed_gestures,
    places_at,
    segments_of,
)
from eskin.recording import NONE, Recording, read_recording
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline


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

    missed: tuple[Missed, ...] = ()
    """The labelled gestures that nothing was detected of."""

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

    Where one of them has no shear, that of the others is not looked at.

    Raises:
        RecordingError: if there is nothing to learn from.
    """
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    rows: list[Rows] = []
    recordings = tuple(read_recording(path) for path in paths)
    graph = graph or GraphConfig()
    if not all(recording.skin.has_shear for recording in recordings):
        graph = graph.without_shear()
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
    labels = [labels_of(recording) for recording in recordings]
    felt: list[set[int]] = [set() for _ in recordings]
    for rows in sequences:
        own = labels[rows.recording]
        places = places_at(own, np.array(rows.stamps))
        segments += segments_of(own, places, rows.recording, len(gestures))
        gestures += gestures_at(own, places)
        felt[rows.recording] |= set(places.tolist())
    lengths = [len(rows.stamps) for rows in sequences]
    return Dataset(
        recordings=recordings,
        graphs=join([graph for rows in sequences for graph in rows.graphs]),
        stamps=np.concatenate([np.array(rows.stamps) for rows in sequences]),
        sequence=np.repeat(np.arange(len(sequences)), lengths),
        recording=np.repeat([rows.recording for rows in sequences], lengths),
        gestures=tuple(gestures),
        segments=tuple(segments),
        missed=tuple(
            Missed(gesture, index)
            for index, recording in enumerate(recordings)
            for gesture in missed_gestures(recording, labels[index], felt[index])
        ),
    )


def digest(paths: Sequence[Path]) -> str:
    """SHA-256 over the recordings' bytes, whatever their order."""
    parts = sorted(hashlib.sha256(path.read_bytes()).hexdigest() for path in paths)
    return hashlib.sha256("".join(parts).encode()).hexdigest()
