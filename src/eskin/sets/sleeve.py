"""This module converts the sleeve dataset (github mdethmers/Social-Touch-Research).

Its files state neither rate, units, geometry nor people. The conversion assumes 10 Hz,
a flat grid of 10 mm, 255 counts = 100 kPa (all nominal), and that local time is UTC.
"""

import contextlib
import itertools
import json
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from jaxtyping import Int

from eskin.errors import ImportSourceError
from eskin.recording.label_check import LabelSet
from eskin.recording.records import NONE, Metadata, build_labels
from eskin.sets.conversion import (
    FULL_SCALE_KPA,
    GZIP_SUFFIX,
    JSON_SUFFIX,
    ConversionResult,
    ImportedClip,
    find_files,
    read_decompressed,
    write_clips,
)
from eskin.skin import load_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

ROWS = 19
COLUMNS = 27
STEP = 1.5
FULL_SCALE = 170
FLOOR_KPA = 10.0  # Worn tight, the sleeve rests at several nominal kPa.
PERIOD_NS = 100_000_000
SAME_SESSION = timedelta(minutes=10)
SUFFIXES = (JSON_SUFFIX, JSON_SUFFIX + GZIP_SUFFIX)
MAX_LISTS = 1_000_000
"""Largest number of lists and objects in a file, which take 20 times its size."""

# The dataset's own spellings; its files named Unknown hold taps.
ALIASES = {"squeez": "squeeze", "unknown": "tap", "": NONE}


def convert_sleeve(source: Path | str, folder: Path | str) -> ConversionResult:
    """Convert every file of the sleeve dataset in `source` to recordings in `folder`.

    Raises:
        ImportSourceError: a file cannot be converted.
    """
    skin = load_skin("sleeve")
    calibration = Calibration.uniform(skin.count, FULL_SCALE, FULL_SCALE_KPA, FLOOR_KPA)
    files = find_files(Path(source), "*", SUFFIXES)
    if not files:
        raise ImportSourceError(
            f"no file in {source} ends with {' or '.join(SUFFIXES)}; give the sleeve "
            "set"
        )
    times, paths = zip(*sorted((find_start(path), path) for path in files), strict=True)
    clips = map(read_sleeve_file, paths, times, name_sessions(times))
    return write_clips(clips, folder, skin, calibration)


def find_start(path: Path) -> datetime:
    """Find the start of a recording: 14 digits in its name, else in its content."""
    for source in (lambda: path.name, lambda: read_timestamp(path)):
        for digits in re.findall(r"(?<!\d)\d{14}(?!\d)", source()):
            with contextlib.suppress(ValueError):
                return datetime.strptime(digits, "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    raise ImportSourceError(
        f"{path}: neither name nor content holds a time YYYYMMDDhhmmss; "
        "is it a file of the sleeve set?"
    )


def read_timestamp(path: Path) -> str:
    """Read the timestamp in a file's content; empty without one."""
    content = load_json(path)
    return str(content.get("timestamp")) if isinstance(content, dict) else ""


def name_sessions(times: Sequence[datetime]) -> list[str]:
    """Return the name of the session of each of the sorted start times.

    A session starts with a new day or after more than ten minutes without a file. Its
    name is the date and minute of its first file.
    """
    names = [time.strftime("%Y%m%d-%H%M") for time in times]
    for i, (before, time) in enumerate(itertools.pairwise(times)):
        if time.date() == before.date() and time - before <= SAME_SESSION:
            names[i + 1] = names[i]
    return names


def read_sleeve_file(path: Path, time: datetime, session: str) -> ImportedClip:
    """Read one file as a clip."""
    content = load_json(path)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise ImportSourceError(f"{path}: no frames; is it a file of the sleeve set?")
    start = int(time.timestamp()) * NS_PER_S
    stamps = start + np.arange(len(frames), dtype=np.int64) * PERIOD_NS
    received = np.ones(ROWS * COLUMNS, dtype=np.bool_)
    counts = [parse_frame(path, index, frame) for index, frame in enumerate(frames)]
    gestures = [canonical_gesture(frame.get("label")) for frame in frames]
    scans = tuple(
        Scan(int(stamp), count, received, np.empty(0))
        for stamp, count in zip(stamps, counts, strict=True)
    )
    labels = build_labels(stamps, gestures, PERIOD_NS)
    name = path.name.removesuffix(GZIP_SUFFIX).removesuffix(JSON_SUFFIX)
    notes = {"source_file": path.name, "rate": "10 Hz, nominal"}
    metadata = Metadata("sleeve", "", session, "sleeve", notes)
    label_set = LabelSet(path, labels, scans[0].stamp, scans[-1].stamp)
    return ImportedClip(name, metadata, scans, label_set)


def load_json(path: Path) -> object:
    """Load a JSON file, gzipped or not."""
    try:
        data = read_decompressed(path)
        if data.count(b"[") + data.count(b"{") > MAX_LISTS:
            raise ValueError(f"more than {MAX_LISTS:,} lists, allowed are fewer")
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ImportSourceError(
            f"{path}: not whole JSON ({error}); copy it again from the set"
        ) from error


def parse_frame(path: Path, index: int, frame: object) -> Int[np.ndarray, "taxel"]:
    """Return the counts of one scan; the dataset stores them in steps of 1.5."""
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
    wrong = values[~((values >= 0) & (values <= FULL_SCALE * STEP))]
    if len(wrong):
        raise ImportSourceError(
            f"{path}: frame {index} holds {wrong[0]}; allowed are 0 to 255; leave the "
            "file out"
        )
    return np.rint(values.reshape(-1) / STEP).astype(np.int32)


def canonical_gesture(label: object) -> str:
    """Return the canonical name of a label of the dataset."""
    name = "" if label is None else str(label).strip().lower()
    return ALIASES.get(name, name)
