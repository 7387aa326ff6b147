"""Recordings of the sleeve set (github mdethmers/Social-Touch-Research).

Its files state neither rate, units, geometry nor people. Taken here: 10 Hz, a flat
grid of 10 mm, 255 = 100 kPa (all nominal), stamps as if local time were UTC.
"""

import contextlib
import gzip
import json
import re
import zlib
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from jaxtyping import Int

from eskin.errors import ImportSourceError
from eskin.recording.conversion import (
    FULL_SCALE_KPA,
    ConversionResult,
    ImportedClip,
    write_clips,
)
from eskin.recording.labels import NONE, build_labels
from eskin.recording.records import Metadata
from eskin.skin.files import load_skin
from eskin.touch.calibration import Calibration
from eskin.touch.reading import Scan
from eskin.units import NS_PER_S

ROWS, COLUMNS = 19, 27
STEP = 1.5
FULL_SCALE = 170
FLOOR_KPA = 10.0  # Worn tight, the sleeve rests at several nominal kPa.
PERIOD = 100_000_000
SAME_SESSION = timedelta(minutes=10)
SUFFIXES = (".json", ".json.gz")

# The set's own spellings; its files named Unknown hold taps.
ALIASES = {"squeez": "squeeze", "unknown": "tap", "": NONE}


def convert_sleeve(source: Path | str, folder: Path | str) -> ConversionResult:
    """Convert every file of the sleeve set in `source` to recordings in `folder`.

    Raises:
        ImportSourceError: naming the file that cannot be converted.
    """
    skin = load_skin("sleeve")
    calibration = Calibration.uniform(skin.count, FULL_SCALE, FULL_SCALE_KPA, FLOOR_KPA)
    times = sorted((start_time(path), path) for path in sleeve_files(Path(source)))
    sessions = session_names([time for time, _ in times])
    return write_clips(sleeve_clips(times, sessions), folder, skin, calibration)


def sleeve_files(source: Path) -> list[Path]:
    """Files of the set in a folder, or one file."""
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise ImportSourceError(f"no folder {source}; give the folder of the files")
    files = [p for p in source.rglob("*") if p.is_file() and p.name.endswith(SUFFIXES)]
    if not files:
        raise ImportSourceError(
            f"no file in {source} ends with .json or .json.gz; give the sleeve set"
        )
    return files


def start_time(path: Path) -> datetime:
    """When a recording started: 14 digits in its name, else in its content."""
    for source in (lambda: path.name, lambda: timestamp(path)):
        for digits in re.findall(r"(?<!\d)\d{14}(?!\d)", source()):
            with contextlib.suppress(ValueError):
                return datetime.strptime(digits, "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    raise ImportSourceError(
        f"{path}: neither name nor content holds a time YYYYMMDDhhmmss; "
        "is it a file of the sleeve set?"
    )


def timestamp(path: Path) -> str:
    """What a file says of its own time."""
    content = load_json(path)
    return str(content.get("timestamp")) if isinstance(content, dict) else ""


def session_names(times: Sequence[datetime]) -> list[str]:
    """Name of the session of each of the sorted start times.

    A session starts with a new day or after more than ten minutes without a file and
    is named by its first file's date and minute.
    """
    names: list[str] = []
    for index, time in enumerate(times):
        before = times[index - 1] if index else None
        together = before is not None and time.date() == before.date()
        if before is not None and together and time - before <= SAME_SESSION:
            names.append(names[-1])
        else:
            names.append(time.strftime("%Y%m%d-%H%M"))
    return names


def sleeve_clips(
    times: Sequence[tuple[datetime, Path]], sessions: Sequence[str]
) -> Iterator[ImportedClip]:
    """Read one file after the other."""
    for (time, path), session in zip(times, sessions, strict=True):
        yield sleeve_clip(path, time, session)


def sleeve_clip(path: Path, time: datetime, session: str) -> ImportedClip:
    """One file as a clip."""
    content = load_json(path)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise ImportSourceError(f"{path}: no frames; is it a file of the sleeve set?")
    start = int(time.timestamp()) * NS_PER_S
    stamps = start + np.arange(len(frames), dtype=np.int64) * PERIOD
    received = np.ones(ROWS * COLUMNS, dtype=np.bool_)
    counts = [frame_counts(path, index, frame) for index, frame in enumerate(frames)]
    gestures = [gesture_name(frame.get("label")) for frame in frames]
    scans = tuple(
        Scan(int(stamp), count, received, np.empty(0))
        for stamp, count in zip(stamps, counts, strict=True)
    )
    labels = build_labels(stamps, gestures, PERIOD)
    name = path.name.removesuffix(".gz").removesuffix(".json")
    notes = {"source_file": path.name, "rate": "10 Hz, nominal"}
    metadata = Metadata("sleeve", "", session, "sleeve", notes)
    return ImportedClip(name, metadata, scans, labels)


def load_json(path: Path) -> object:
    """Content of a JSON file, gzipped or not."""
    try:
        data = path.read_bytes()
        return json.loads(gzip.decompress(data) if path.suffix == ".gz" else data)
    except (OSError, EOFError, zlib.error, ValueError, RecursionError) as error:
        raise ImportSourceError(
            f"{path}: not whole JSON ({error}); copy it again from the set"
        ) from error


def frame_counts(path: Path, index: int, frame: object) -> Int[np.ndarray, "taxel"]:
    """Counts of one frame; the set stores them in steps of 1.5."""
    try:
        values = np.asarray(frame["data"], dtype=np.float64)  # type: ignore[index]
    except (KeyError, TypeError, ValueError) as error:
        raise ImportSourceError(
            f"{path}: frame {index} has no {ROWS} x {COLUMNS} numbers ({error})"
        ) from error
    if values.shape != (ROWS, COLUMNS):
        raise ImportSourceError(
            f"{path}: frame {index} has shape {values.shape}; allowed is "
            f"({ROWS}, {COLUMNS}); leave other sensors out"
        )
    if not ((values >= 0) & (values <= FULL_SCALE * STEP)).all():
        wrong = values[~((values >= 0) & (values <= FULL_SCALE * STEP))][0]
        raise ImportSourceError(
            f"{path}: frame {index} holds {wrong}; allowed are 0 to 255; "
            "leave the file out"
        )
    return np.rint(values.reshape(-1) / STEP).astype(np.int32)


def gesture_name(label: object) -> str:
    """Canonical name of a label of the set."""
    name = "" if label is None else str(label).strip().lower()
    return ALIASES.get(name, name)
