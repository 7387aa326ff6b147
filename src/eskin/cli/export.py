"""`eskin export` writes models and recordings for other programs."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from eskin.cli.checks import check_folder, check_writable
from eskin.errors import EskinError
from eskin.registry import EXPORTS, load_function
from eskin.units import format_count

NOUNS = {
    "recordings": "recording",
    "messages": "message",
    "readings": "reading",
    "touches": "touch",
}
"""Names of one of what is written, by the keys of the result."""


@dataclass(frozen=True)
class ExportCommand:
    """Write a model as ONNX, or recordings as a bag of ROS 2 or as Parquet tables."""

    sources: tyro.conf.Positional[tuple[str, ...]]
    """Name of weights that come with eskin or a model file, for --onnx; recordings, or
    folders of them, for the others."""

    onnx: Path | None = None
    """File for one step of the network, of any numbers of taxels and edges."""

    rosbag: Path | None = None
    """New folder for a bag, with metadata.yaml, that `ros2 bag` opens."""

    parquet: Path | None = None
    """New folder for readings.parquet, one row a reading, and touches.parquet, one row
    a touch."""


def run(command: ExportCommand) -> dict[str, object]:
    """Write one format; return the error of the network, or what was written."""
    given = [name for name in ("onnx", "rosbag", "parquet") if getattr(command, name)]
    if len(given) != 1:
        got = " and ".join(f"--{name}" for name in given) or "no format"
        raise EskinError(
            f"{got} is given; allowed is one of --onnx, --rosbag and --parquet; say "
            "what to write"
        )
    if not command.sources:
        raise EskinError(
            "nothing to export is given; allowed is a model or recordings; name one"
        )
    if command.onnx is not None:
        return export_model(command.sources, command.onnx)
    return export_recordings(command)


def export_model(sources: tuple[str, ...], path: Path) -> dict[str, object]:
    """Write one model as ONNX; return the greatest error of a logit."""
    if len(sources) != 1:
        raise EskinError(
            f"{len(sources)} models are given with --onnx; allowed is one; export each "
            "by itself"
        )
    [source] = sources
    check_writable(path)
    from eskin.live import load_model

    error = load_function(EXPORTS["onnx"])(load_model(source), path)
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, greatest error {error:.1e}")
    return {"max_error": error}


def export_recordings(command: ExportCommand) -> dict[str, object]:
    """Write recordings as a bag or as tables; return how much was written."""
    folder = command.rosbag or command.parquet
    assert folder is not None
    check_folder(folder.absolute().parent)
    from eskin.recording import find_recordings, read_recording, write_bag, write_tables

    recordings = [read_recording(path) for path in find_recordings(command.sources)]
    counts = {"recordings": len(recordings)}
    if command.rosbag is not None:
        counts["messages"] = write_bag(recordings, folder)
    else:
        counts["readings"], counts["touches"] = write_tables(recordings, folder)
    told = [format_count(count, NOUNS[key]) for key, count in counts.items()]
    print(f"{folder}: {', '.join(told)}")
    return dict(counts)
