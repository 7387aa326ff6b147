"""This module turns one recording into sequences of contact graphs, kept on disk.

Sequences are computed by the same calibration, contacts and graphs as live, and packed
into files whose names depend on the recording and the settings.
"""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import digest_code
from eskin.files import atomic_path
from eskin.learn.ground_truth import TouchLabel, read_true_touches
from eskin.learn.recording_transforms import RecordingTransform
from eskin.live import (
    SHEAR_FIELDS,
    GraphBatch,
    GraphConfig,
    GraphStream,
    create_empty_batch,
    join_graphs,
)
from eskin.recording import NO_OVERRIDES, Overrides, Recording, read_recording
from eskin.skin import MountedSkin
from eskin.touch import (
    LinkPoseCache,
    PipelineConfig,
    TouchPipeline,
    TouchState,
)

NAN_POSITION = np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """A prepared recording holds one row for each reading of each touch.

    Rows of one sequence, the readings of one touch, are neighbours.
    """

    graphs: GraphBatch
    """Contact graph of each row."""
    stamps: Int[np.ndarray, "row"]
    """Stamp of each row's reading [ns since the epoch]."""
    sequence: Int[np.ndarray, "row"]
    """Number of the sequence of each row, counted from 0."""
    touches: tuple[TouchLabel | None, ...] | None
    """True touch of each sequence, None for one of no true touch; None instead of the
    tuple where the recording does not hold the truth."""


def prepare_recording(
    recording: Recording,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    transform: RecordingTransform | None = None,
) -> PreparedRecording:
    """Compute the sequences of a recording as they would be live.

    Args:
        recording: recording to replay.
        pipeline: how counts become touches.
        graph: how touches become graphs.
        transform: transform of the recording; None leaves it as it was recorded.
    """
    sequences = gather_sequences(recording, pipeline, graph, transform)
    truth = read_true_touches(recording) if recording.skin.calibrated else None
    touches = None
    if truth is not None:
        touches = tuple(
            truth.identify(np.array(s.stamps), np.array(s.centres), np.array(s.forces))
            for s in sequences
        )
    empty = create_empty_batch(graph.fixed + graph.live)
    lengths = [len(s.stamps) for s in sequences]
    return PreparedRecording(
        graphs=join_graphs([empty, *(g for s in sequences for g in s.graphs)]),
        stamps=np.array([n for s in sequences for n in s.stamps], dtype=np.int64),
        sequence=np.repeat(np.arange(len(sequences)), lengths),
        touches=touches,
    )


@dataclass
class TouchSequence:
    """A touch sequence collects the rows of one touch while a recording is replayed."""

    confirmed: bool
    """Whether there was enough evidence of a touch; live, no other is recognised."""
    graphs: list[GraphBatch] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    centres: list[Float[np.ndarray, "3"]] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)


def gather_sequences(
    recording: Recording,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    transform: RecordingTransform | None = None,
) -> list[TouchSequence]:
    """Return the sequences of confirmed touches in the order in which they begin."""
    skin = recording.skin
    if transform is not None:
        skin = transform.transform_skin(skin, recording.start)
    mounted = MountedSkin(skin, recording.load_robot())
    poses = LinkPoseCache(mounted, graph.posed)
    touches = TouchPipeline(mounted, recording.calibration, pipeline, poses)
    stream = GraphStream(mounted, graph, poses)
    sequences: dict[int, TouchSequence] = {}
    scans = transform.transform_scans(recording) if transform else recording.scans()
    for scan in scans:
        state = touches.push_scan(scan)
        centres = find_contact_centres(state)
        for key, batch in stream.build_graphs(state).items():
            sequence = sequences.setdefault(key, TouchSequence(not skin.calibrated))
            centre, force = centres.get(key, (NAN_POSITION, 0.0))
            sequence.graphs.append(batch)
            sequence.stamps.append(scan.stamp)
            sequence.centres.append(centre)
            sequence.forces.append(force)
        for touch in state.open if skin.calibrated else ():
            sequences[touch.id].confirmed = True
    return [sequences[key] for key in sorted(sequences) if sequences[key].confirmed]


def find_contact_centres(
    state: TouchState,
) -> dict[int, tuple[Float[np.ndarray, "3"], float]]:
    """Return centre [m] and force [N] of the strongest contact of each touch.

    Touches without contact at the state's reading are left out.
    """
    return {
        touch.id: (touch.contact.p_world, touch.contact.force)
        for touch in state.touches
        if touch.last == state.reading.stamp
    }


SMALL = {"taxels": np.int32, "neighbours": np.int16}
"""Fields that are stored as smaller integers."""


def pack_recording(
    path: Path,
    folder: Path,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    transform: RecordingTransform | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> Path:
    """Return the file of a prepared recording, and write it if it is missing.

    Its name is a digest of the recording's bytes, the settings and the code, so an
    existing file is always up to date.
    """
    key = compute_pack_key(path, pipeline, graph, transform, overrides)
    target = folder / f"{key}.npz"
    if not target.exists():
        recording = read_recording(path, overrides)
        save_prepared(target, prepare_recording(recording, pipeline, graph, transform))
    return target


def compute_pack_key(
    path: Path,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    transform: RecordingTransform | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> str:
    """Return the file name, without suffix, of a recording prepared with settings."""
    settings = f"{pipeline} {graph}"
    if overrides.digest:
        settings += f" {overrides.digest}"
    return compute_file_key(__name__, path, settings, transform)


def compute_file_key(
    module: str, path: Path, settings: str, transform: RecordingTransform | None
) -> str:
    """Return a digest of a recording, a module's code, settings and a transform."""
    with path.open("rb") as file:
        content = hashlib.file_digest(file, "sha256").hexdigest()
    text = f"{digest_code(module)} {content} {settings}"
    text += f" {transform.key}" if transform else ""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def save_prepared(target: Path, prepared: PreparedRecording) -> None:
    """Write a prepared recording, whole or not at all."""
    shear = prepared.graphs.shear.any() or prepared.graphs.shear_before.any()
    arrays = {
        name: array
        for name, array in prepared.graphs._asdict().items()
        if shear or name not in SHEAR_FIELDS
    }
    arrays |= {name: arrays[name].astype(dtype) for name, dtype in SMALL.items()}
    arrays |= {"stamps": prepared.stamps, "sequence": prepared.sequence}
    touches = np.frombuffer(json.dumps(prepared.touches).encode(), np.uint8)
    with atomic_path(target) as part:
        np.savez(part, fits=touches, **arrays)


def load_prepared(path: Path) -> PreparedRecording:
    """Load a prepared recording from its file."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    stamps = arrays.pop("stamps")
    sequence = arrays.pop("sequence")
    touches = json.loads(arrays.pop("fits").tobytes())
    if touches is not None:
        touches = tuple(each and TouchLabel(*each) for each in touches)
    nothing = np.broadcast_to(np.float32(0), arrays["positions"].shape)
    shear = {name: arrays.pop(name, nothing) for name in SHEAR_FIELDS}
    return PreparedRecording(GraphBatch(**arrays, **shear), stamps, sequence, touches)
