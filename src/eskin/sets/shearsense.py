"""This module converts the ShearSense dataset (github ubcspin/uuLab-sensor-TGL-model).

Its files state neither units nor geometry, and values were scaled per participant. The
conversion assumes a flat grid of 10 mm, and 256 counts = 100 kPa for pressure and shear
(both nominal).
"""

import re
import zipfile
import zlib
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Int

from eskin.errors import ImportSourceError
from eskin.files import open_file
from eskin.recording.label_check import LabelSet
from eskin.recording.records import NONE, Label, Metadata
from eskin.sets.conversion import (
    FULL_SCALE_KPA,
    MAX_SOURCE_BYTES,
    NPZ_SUFFIX,
    ConversionResult,
    ImportedClip,
    write_clips,
)
from eskin.skin import load_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

SIDE = 6
RATE_HZ = 44.7
FULL_SCALE = 256
SHEAR_REST = 128
YEAR = 2023
UNKNOWN = "UNKNOWN"
NO_TOUCH = "no"

# Errors that numpy raises for a file that is truncated, damaged or no archive.
ARCHIVE_ERRORS = (
    OSError,
    EOFError,
    KeyError,
    ValueError,
    NotImplementedError,
    zipfile.BadZipFile,
    zlib.error,
)


def convert_shearsense(source: Path | str, folder: Path | str) -> ConversionResult:
    """Convert every file of the ShearSense dataset to recordings in `folder`.

    Raises:
        ImportSourceError: a file cannot be converted.
    """
    skin = load_skin("shearsense")
    calibration = Calibration(
        gain=np.full(skin.count, FULL_SCALE_KPA / FULL_SCALE),
        full_scale=FULL_SCALE,
        shear_gain=FULL_SCALE_KPA / FULL_SCALE,
        shear_rest=SHEAR_REST,
    )
    files = find_shearsense_files(Path(source))
    return write_clips(map(read_shearsense_file, files), folder, skin, calibration)


def find_shearsense_files(source: Path) -> list[Path]:
    """Find the dataset's files below a folder, sorted by gesture and name."""
    files = sorted(source.rglob(f"*{NPZ_SUFFIX}")) if source.is_dir() else []
    if not files:
        missing = (
            f"{NPZ_SUFFIX} file below {source}"
            if source.is_dir()
            else f"folder {source}"
        )
        raise ImportSourceError(
            f"no {missing}; give the folder that holds one folder a gesture"
        )
    return files


def read_shearsense_file(path: Path) -> ImportedClip:
    """Read one file as a clip with one label; its folder names the gesture."""
    gesture = re.sub(r"[\s-]+", "_", path.parent.name.strip().lower())
    rest = path.stem
    if rest.lower().startswith(path.parent.name.lower()):
        rest = rest[len(path.parent.name) :]
    pressure, shear_x, shear_y = load_counts(path)
    start = int(parse_recording_time(rest).timestamp()) * NS_PER_S
    stamps = [start + round(i * 1e9 / RATE_HZ) for i in range(len(pressure) + 1)]
    received = np.ones(SIDE * SIDE, dtype=np.bool_)
    shear = np.stack([shear_x, shear_y], axis=-1)
    scans = tuple(
        Scan(stamps[i], pressure[i], received, np.empty(0), shear[i])
        for i in range(len(pressure))
    )
    label = Label(stamps[0], stamps[-1], NONE if gesture == NO_TOUCH else gesture)
    notes = {"source_file": f"{path.parent.name}/{path.name}", "rate": f"{RATE_HZ} Hz"}
    subject = parse_participant(path, rest)
    session = parse_support(rest)
    metadata = Metadata("shearsense", subject, session, "shearsense", notes)
    name = re.sub(r"[^A-Za-z0-9]+", "_", f"{gesture}_{rest}").strip("_")
    label_set = LabelSet(path, (label,), scans[0].stamp, scans[-1].stamp)
    return ImportedClip(name, metadata, scans, label_set)


def load_counts(path: Path) -> list[Int[np.ndarray, "reading taxel"]]:
    """Load pressure, shear x and shear y of one file, as counts."""
    try:
        with open_file(path, MAX_SOURCE_BYTES) as file:
            check_unpacked(file)
            content = np.load(file, allow_pickle=False)
            if isinstance(content, np.ndarray):
                raise ValueError("it is one array alone")
            arrays = [content[f"arr_{index}"] for index in range(3)]
    except ARCHIVE_ERRORS as error:
        raise ImportSourceError(
            f"{path}: no whole archive with arr_0, arr_1 and arr_2 ({error}); "
            "copy it again from the set"
        ) from error
    length = len(arrays[0]) if arrays[0].ndim else 0
    for index, array in enumerate(arrays):
        if array.shape != (length, SIDE, SIDE) or not length:
            raise ImportSourceError(
                f"{path}: arr_{index} has shape {array.shape}; allowed is (T, {SIDE}, "
                f"{SIDE}), T the same for all three and not 0; leave the file out"
            )
        check_values(path, index, array)
    return [np.rint(a).astype(np.int32).reshape(length, -1) for a in arrays]


def check_unpacked(file: BinaryIO, allowed: int = MAX_SOURCE_BYTES) -> None:
    """Raise a ValueError where an archive unpacks to too many bytes."""
    if zipfile.is_zipfile(file):
        with zipfile.ZipFile(file) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > allowed:
            raise ValueError(
                f"it unpacks to {unpacked:,} bytes, allowed are {allowed:,}"
            )
    file.seek(0)


def check_values(path: Path, index: int, array: np.ndarray) -> None:
    """Raise if values are not numbers from 0 to full scale."""
    if array.dtype.kind not in "iuf":
        raise ImportSourceError(
            f"{path}: arr_{index} is of type {array.dtype}; allowed are numbers"
        )
    wrong = ~((array >= 0) & (array <= FULL_SCALE))
    if wrong.any():
        raise ImportSourceError(
            f"{path}: arr_{index} holds {array[wrong][0]}; allowed are 0 to "
            f"{FULL_SCALE}; leave the file out"
        )


def parse_participant(path: Path, rest: str) -> str:
    """Return `P` and the participant's number from a file name without its gesture."""
    found = re.search(r"P(\d+)", rest) or re.search(
        r"(?<![a-z])p(?:articipant)?[\s_-]*(\d+)", rest, re.IGNORECASE
    )
    if not found:
        raise ImportSourceError(
            f"{path}: name holds no participant such as P8; name it as in the set"
        )
    return f"P{int(found[1])}"


def parse_support(rest: str) -> str:
    """Return the sensor's support, FLAT or PILLOW, from a file name."""
    found = re.search(r"flat|pillow", rest, re.IGNORECASE)
    return found[0].upper() if found else UNKNOWN


def parse_recording_time(rest: str) -> datetime:
    """Return the start of a recording from a file name; else the start of the year.

    The time of day is taken as UTC, and a missing year as 2023.
    """
    day = re.search(r"([A-Z][a-z]{2})(\d{1,2})(?:(?:st|nd|rd|th)(\d{4}))?", rest)
    clock = re.search(r"(?<!\d)(\d{2})_(\d{2})_(\d{2})(?!\d)", rest)
    date = day.groups(str(YEAR)) if day else ("Jan", "1", str(YEAR))
    parts = (*date, *(clock.groups() if clock else ("0", "0", "0")))
    try:
        time = datetime.strptime(" ".join(parts), "%b %d %Y %H %M %S")
    except ValueError:
        time = datetime(YEAR, 1, 1)
    return time.replace(tzinfo=UTC)
