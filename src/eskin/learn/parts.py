"""One recording made ready for learning: its touches as sequences of graphs."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from eskin.graph import GraphBatch, GraphConfig, GraphStream, join, no_graphs
from eskin.learn.fitting import Fit, true_touches
from eskin.learn.version import Version
from eskin.recording import Recording
from eskin.robot import recorded_robot
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline, TouchState
from eskin.touch.poses import LivePoses

NOWHERE = np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class Part:
    """The sequences of one recording laid end to end, one row a reading and touch."""

    graphs: GraphBatch
    """One graph a row."""

    stamps: Int[np.ndarray, "row"]
    """Of the row's reading [ns since the epoch]."""

    sequence: Int[np.ndarray, "row"]
    """The sequence of each row, counted from 0."""

    fits: tuple[Fit | None, ...] | None
    """The true touch that each sequence is of, None where it is of none; None where the
    recording does not know the truth."""


def part_of(
    recording: Recording,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: Version | None = None,
) -> Part:
    """Run a recording through the same calibration, contacts and graphs as live.

    Args:
        recording: what to run.
        pipeline: how counts become touches.
        graph: how touches become graphs.
        version: that is run, the recording as it is where None.
    """
    sequences = sequences_of(recording, pipeline, graph, version)
    touches = true_touches(recording) if recording.skin.calibrated else None
    lengths = [len(one.stamps) for one in sequences]
    return Part(
        graphs=join(
            [
                no_graphs(graph.fixed + graph.live),
                *(g for one in sequences for g in one.graphs),
            ]
        ),
        stamps=np.array([s for one in sequences for s in one.stamps], dtype=np.int64),
        sequence=np.repeat(np.arange(len(sequences)), lengths),
        fits=None
        if touches is None
        else tuple(
            touches.fit(np.array(s.stamps), np.array(s.centres), np.array(s.forces))
            for s in sequences
        ),
    )


@dataclass
class Sequence:
    """One sequence while it is being gathered."""

    graphs: list[GraphBatch] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    centres: list[Float[np.ndarray, "3"]] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)


def sequences_of(
    recording: Recording,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: Version | None = None,
) -> list[Sequence]:
    """All sequences of one recording, in the order in which they begin."""
    skin = recording.skin
    if version is not None:
        skin = version.skin(skin, recording.start)
    mounted = MountedSkin(skin, recorded_robot(recording.robot_name))
    poses = LivePoses(mounted, graph.posed)
    touches = TouchPipeline(mounted, recording.calibration, pipeline, poses)
    stream = GraphStream(mounted, graph, poses)
    found: list[Sequence] = []
    open_now: dict[int, Sequence] = {}
    for scan in version.scans(recording) if version else recording.scans():
        state = touches.push(scan)
        graphs = stream.push(state)
        centres = centres_of(state)
        for key in sorted(graphs.keys() - open_now.keys()):
            open_now[key] = Sequence()
            found.append(open_now[key])
        open_now = {key: open_now[key] for key in graphs}
        for key, batch in graphs.items():
            sequence, (centre, force) = open_now[key], centres.get(key, (NOWHERE, 0.0))
            sequence.graphs.append(batch)
            sequence.stamps.append(scan.stamp)
            sequence.centres.append(centre)
            sequence.forces.append(force)
    return found


def centres_of(state: TouchState) -> dict[int, tuple[Float[np.ndarray, "3"], float]]:
    """Centre [m] and force [N] of the strongest contact of each touch felt now."""
    return {
        touch.id: (touch.contact.p_world, touch.contact.force)
        for touch in state.touches
        if touch.last == state.reading.stamp
    }
