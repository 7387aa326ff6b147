"""Converted recordings appear in their folder all at once, or not at all."""

import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from eskin.errors import ImportSourceError
from eskin.recording.labels import Label
from eskin.recording.records import Metadata
from eskin.recording.writer import RecordingWriter, write_all
from eskin.skin.skin import Skin
from eskin.touch.calibration import Calibration
from eskin.touch.reading import Scan

# Nothing says what the sets' sensors were fixed to, or what pressure filled them.
ROBOT = "table"
FULL_SCALE_KPA = 100.0


@dataclass(frozen=True)
class ImportedClip:
    """One recording of a public set, read into memory."""

    name: str
    """Name of its file, without suffix."""
    metadata: Metadata
    """Who and what was recorded."""
    scans: tuple[Scan, ...]
    """In order."""
    labels: tuple[Label, ...]
    """In order."""


@dataclass(frozen=True)
class ConversionResult:
    """What a conversion wrote."""

    recordings: int
    """Number of files."""
    taxels: int
    """Taxels of the skin."""
    readings: int
    """Scans in all files."""
    labels: int
    """Labels in all files."""


def write_clips(
    clips: Iterable[ImportedClip],
    folder: Path | str,
    skin: Skin,
    calibration: Calibration,
) -> ConversionResult:
    """Write each clip to `<folder>/<name>.mcap`, after all of them could be read.

    Raises:
        ImportSourceError: when two clips have one name or the folder cannot be made.
    """
    folder = Path(folder)
    recordings = readings = labels = 0
    existed = folder.exists()
    work = make_work_folder(folder)
    try:
        for clip in clips:
            path = work / f"{clip.name}.mcap"
            if path.exists():
                raise ImportSourceError(
                    f"two source files would become {path.name}; keep one of them"
                )
            with RecordingWriter(
                path, ROBOT, skin, calibration, clip.metadata, ()
            ) as writer:
                readings += write_all(writer, clip.scans, clip.labels)
            recordings += 1
            labels += len(clip.labels)
        for path in sorted(work.iterdir()):
            path.replace(folder / path.name)
    finally:
        shutil.rmtree(work)
        if not existed and not any(folder.iterdir()):
            folder.rmdir()
    return ConversionResult(recordings, skin.count, readings, labels)


def make_work_folder(folder: Path) -> Path:
    """A new hidden folder inside `folder`, which is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=".convert-", dir=folder))
    except OSError as error:
        raise ImportSourceError(
            f"cannot write into {folder}: {error.strerror}; give another folder"
        ) from error
