"""A prepared recording holds the touches of one recording as sequences of graphs."""

import hashlib
import json
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from eskin.files import atomic_path
from eskin.graph import GraphBatch, GraphConfig, GraphStream, join, no_graphs
from eskin.learn.ground_truth import TouchLabel, read_true_touches
from eskin.learn.recording_transforms import RecordingTransform
from eskin.recording import Recording, read_recording
from eskin.robot import load_recorded_robot
from eskin.skin import MountedSkin
from eskin.touch import LinkPoseCache, PipelineConfig, TouchPipeline, TouchState

NAN_POSITION = np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """The sequences of one recording laid end to end, one row a reading and touch."""

    graphs: GraphBatch
    """One graph a row."""

    stamps: Int[np.ndarray, "row"]
    """Of the row's reading [ns since the epoch]."""

    sequence: Int[np.ndarray, "row"]
    """The sequence of each row, counted from 0."""

    fits: tuple[TouchLabel | None, ...] | None
    """The true touch that each sequence is of, None where it is of none; None where the
    recording does not know the truth."""


def prepare_recording(
    recording: Recording,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: RecordingTransform | None = None,
) -> PreparedRecording:
    """Run a recording through the same calibration, contacts and graphs as live.

    Args:
        recording: what to run.
        pipeline: how counts become touches.
        graph: how touches become graphs.
        version: that is run, the recording as it is where None.
    """
    sequences = gather_sequences(recording, pipeline, graph, version)
    touches = read_true_touches(recording) if recording.skin.calibrated else None
    lengths = [len(one.stamps) for one in sequences]
    return PreparedRecording(
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
class TouchSequence:
    """One sequence while it is being gathered."""

    graphs: list[GraphBatch] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    centres: list[Float[np.ndarray, "3"]] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)


def gather_sequences(
    recording: Recording,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: RecordingTransform | None = None,
) -> list[TouchSequence]:
    """All sequences of one recording, in the order in which they begin."""
    skin = recording.skin
    if version is not None:
        skin = version.skin(skin, recording.start)
    mounted = MountedSkin(skin, load_recorded_robot(recording.robot_name))
    poses = LinkPoseCache(mounted, graph.posed)
    touches = TouchPipeline(mounted, recording.calibration, pipeline, poses)
    stream = GraphStream(mounted, graph, poses)
    found: list[TouchSequence] = []
    open_now: dict[int, TouchSequence] = {}
    for scan in version.scans(recording) if version else recording.scans():
        state = touches.push(scan)
        graphs = stream.push(state)
        centres = find_contact_centres(state)
        for key in sorted(graphs.keys() - open_now.keys()):
            open_now[key] = TouchSequence()
            found.append(open_now[key])
        open_now = {key: open_now[key] for key in graphs}
        for key, batch in graphs.items():
            sequence, (centre, force) = (
                open_now[key],
                centres.get(key, (NAN_POSITION, 0.0)),
            )
            sequence.graphs.append(batch)
            sequence.stamps.append(scan.stamp)
            sequence.centres.append(centre)
            sequence.forces.append(force)
    return found


def find_contact_centres(
    state: TouchState,
) -> dict[int, tuple[Float[np.ndarray, "3"], float]]:
    """Centre [m] and force [N] of the strongest contact of each touch felt now."""
    return {
        touch.id: (touch.contact.p_world, touch.contact.force)
        for touch in state.touches
        if touch.last == state.reading.stamp
    }


FORMAT = 4
SHEAR = ("shear", "shear_before")
SMALL = {"taxels": np.int32, "neighbours": np.int16}
"""Fields that need fewer bytes on disk and in memory than while they are computed."""


def pack_recording(
    path: Path,
    folder: Path,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: RecordingTransform | None = None,
) -> Path:
    """The file of a prepared recording, made where it is not there yet.

    Its name is drawn from the recording's bytes and the settings, so that a file
    which is there is always the right one.
    """
    target = folder / f"{compute_pack_key(path, pipeline, graph, version)}.npz"
    if not target.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save_prepared(
            target, prepare_recording(read_recording(path), pipeline, graph, version)
        )
    return target


def compute_pack_key(
    path: Path,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: RecordingTransform | None = None,
) -> str:
    """Names a recording prepared with some settings."""
    with path.open("rb") as file:
        content = hashlib.file_digest(file, "sha256").hexdigest()
    facts = f"{FORMAT} {content} {pipeline} {graph}" + (
        f" {version}" if version else ""
    )
    return hashlib.sha256(facts.encode()).hexdigest()[:32]


def save_prepared(target: Path, part: PreparedRecording) -> None:
    """Write a prepared recording; whole or not at all."""
    shear = part.graphs.shear.any() or part.graphs.shear_before.any()
    arrays = {
        each.name: getattr(part.graphs, each.name)
        for each in fields(GraphBatch)
        if shear or each.name not in SHEAR
    }
    arrays |= {name: arrays[name].astype(dtype) for name, dtype in SMALL.items()}
    facts = np.frombuffer(json.dumps(part.fits).encode(), np.uint8)
    with atomic_path(target) as scratch:
        np.savez(
            scratch, stamps=part.stamps, sequence=part.sequence, fits=facts, **arrays
        )


def load_prepared(path: Path) -> PreparedRecording:
    """Read a prepared recording."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    stamps, sequence = arrays.pop("stamps"), arrays.pop("sequence")
    fits = json.loads(arrays.pop("fits").tobytes())
    nothing = np.broadcast_to(np.float32(0), arrays["positions"].shape)
    shear = {name: arrays.pop(name, nothing) for name in SHEAR}
    return PreparedRecording(
        graphs=GraphBatch(**arrays, **shear),
        stamps=stamps,
        sequence=sequence,
        fits=None
        if fits is None
        else tuple(None if fit is None else TouchLabel(*fit) for fit in fits),
    )
