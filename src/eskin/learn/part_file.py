"""Prepared recordings kept on disk, so that each is run through the pipeline once."""

import hashlib
import json
from dataclasses import fields
from pathlib import Path

import numpy as np

from eskin.files import atomic_path
from eskin.graph import GraphBatch, GraphConfig
from eskin.learn.fitting import Fit
from eskin.learn.parts import Part, part_of
from eskin.learn.version import Version
from eskin.recording import read_recording
from eskin.touch import PipelineConfig

FORMAT = 4
SHEAR = ("shear", "shear_before")
SMALL = {"taxels": np.int32, "neighbours": np.int16}
"""Fields that need fewer bytes on disk and in memory than while they are computed."""


def packed_part(
    path: Path,
    folder: Path,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: Version | None = None,
) -> Path:
    """The file of a prepared recording, made where it is not there yet.

    Its name is drawn from the recording's bytes and the settings, so that a file
    which is there is always the right one.
    """
    target = folder / f"{key_of(path, pipeline, graph, version)}.npz"
    if not target.exists():
        folder.mkdir(parents=True, exist_ok=True)
        save_part(target, part_of(read_recording(path), pipeline, graph, version))
    return target


def key_of(
    path: Path,
    pipeline: PipelineConfig,
    graph: GraphConfig,
    version: Version | None = None,
) -> str:
    """Names a recording prepared with some settings."""
    with path.open("rb") as file:
        content = hashlib.file_digest(file, "sha256").hexdigest()
    facts = f"{FORMAT} {content} {pipeline} {graph}" + (
        f" {version}" if version else ""
    )
    return hashlib.sha256(facts.encode()).hexdigest()[:32]


def save_part(target: Path, part: Part) -> None:
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


def load_part(path: Path) -> Part:
    """Read a prepared recording."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    stamps, sequence = arrays.pop("stamps"), arrays.pop("sequence")
    fits = json.loads(arrays.pop("fits").tobytes())
    nothing = np.broadcast_to(np.float32(0), arrays["positions"].shape)
    shear = {name: arrays.pop(name, nothing) for name in SHEAR}
    return Part(
        graphs=GraphBatch(**arrays, **shear),
        stamps=stamps,
        sequence=sequence,
        fits=None
        if fits is None
        else tuple(None if fit is None else Fit(*fit) for fit in fits),
    )
