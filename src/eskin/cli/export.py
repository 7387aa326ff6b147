"""`eskin export` writes models and recordings for other programs."""

from dataclasses import dataclass, fields
from pathlib import Path

import tyro

from eskin.cli.checks import check_folder, check_writable
from eskin.errors import EskinError
from eskin.registry import EXPORTERS, Exporter, find_plugins, load_plugin
from eskin.units import format_count

NOUNS = {
    "recordings": "recording",
    "messages": "message",
    "readings": "reading",
    "touches": "touch",
    "episodes": "episode",
    "frames": "frame",
}
"""Singular names of the written items, by the keys of the result."""
FREE = ("sources", "to")
"""Fields of the command that name no format."""


@dataclass(frozen=True)
class ExportCommand:
    """Write a model or recordings in the format of another program."""

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

    lerobot: Path | None = None
    """New folder for a LeRobot data set (v3), one episode for each part of a recording
    without a gap; recordings of one skin at one rate."""

    to: tuple[str, Path] | None = None
    """Format of an installed package, as eskin doctor lists them, and the file or
    folder to write."""


def run(command: ExportCommand) -> dict[str, object]:
    """Write one format; return the error of the network, or what was written."""
    options = [each.name for each in fields(command) if each.name not in FREE]
    given = [(name, getattr(command, name)) for name in options]
    given = [(name, path) for name, path in given if path is not None]
    given += [] if command.to is None else [command.to]
    if len(given) != 1:
        got = " and ".join(f"--{name}" for name, _ in given) or "no format"
        raise EskinError(
            f"{got} is given; allowed is one of --{', --'.join(options)} and --to; say "
            "what to write"
        )
    if not command.sources:
        raise EskinError("nothing to export is given; allowed is a model or recordings")
    [(name, path)] = given
    exporter = load_plugin(EXPORTERS, name)
    if exporter is None:
        raise EskinError(
            f"format is '{name}'; allowed are {', '.join(find_plugins(EXPORTERS))}; "
            "correct it, or install the package that writes it"
        )
    if exporter.takes == "model":
        return export_model(command.sources, path, exporter)
    return export_recordings(command.sources, path, exporter)


def export_model(
    sources: tuple[str, ...], path: Path, exporter: Exporter
) -> dict[str, object]:
    """Write one model; return the greatest error of a logit."""
    if len(sources) != 1:
        raise EskinError(
            f"{len(sources)} models are given; allowed is one; export each by itself"
        )
    [source] = sources
    check_writable(path)
    from eskin.live import load_model

    result = exporter.write(load_model(source), path)
    told = [f"{key.replace('_', ' ')} {value:.1e}" for key, value in result.items()]
    print(f"{path}: {', '.join([f'{path.stat().st_size / 1e6:.2f} MB', *told])}")
    return result


def export_recordings(
    sources: tuple[str, ...], path: Path, exporter: Exporter
) -> dict[str, object]:
    """Write recordings; return how much was written."""
    check_folder(path.absolute().parent)
    from eskin.recording import find_recordings, read_recording

    recordings = [read_recording(each) for each in find_recordings(sources)]
    counts = {"recordings": len(recordings), **exporter.write(recordings, path)}
    told = [format_count(count, NOUNS.get(key, key)) for key, count in counts.items()]
    print(f"{path}: {', '.join(told)}")
    return dict(counts)
