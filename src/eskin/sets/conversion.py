"""This module writes converted recordings into a folder, all at once or not at all."""

import gzip
import re
import shutil
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Literal

from eskin.errors import ImportSourceError
from eskin.files import read_file, shorten
from eskin.live.model_file import MODELS, load_model
from eskin.progress import show_progress
from eskin.recording.label_check import LabelSet, check_labels
from eskin.recording.mcap_file import MCAP_SUFFIX
from eskin.recording.records import NONE, Metadata, look_of
from eskin.recording.writer import (
    RecordingWriter,
    check_new_recording,
    write_all,
)
from eskin.robot import Robot
from eskin.skin import Skin, describe_robot
from eskin.touch import Calibration, Scan

SetName = Literal["sleeve", "shearsense", "socialtouch", "cost", "haart", "capfingerid"]
"""Names of the public sets."""
CSV_SUFFIX = ".csv"
JSON_SUFFIX = ".json"
NPZ_SUFFIX = ".npz"
PARQUET_SUFFIX = ".parquet"
GZIP_SUFFIX = ".gz"
"""Ends of the names of files of sets; the last follows that of what is compressed."""
# Most datasets do not say what their sensors were fixed to, or their full scale.
TABLE = "table"
FULL_SCALE_KPA = 100.0
MAX_SOURCE_BYTES = 32 << 20
"""Largest size of a file of a dataset, unpacked [bytes]."""
UNTOUCHED = ("", "no", "no touch", "notouch", NONE)
"""Names of no touch, as `look_of` returns them."""
UNFIT = re.compile(r'[\s/\\:*?"<>|]+')
"""Characters that are replaced in the names of files."""


@dataclass(frozen=True)
class ImportedClip:
    """A recording of a dataset, whose scans are read while it is written."""

    name: str
    """Name of its file, without suffix."""
    metadata: Metadata
    """Origin of the recording."""
    scans: Iterable[Scan]
    """Scans in the order of time."""
    label_set: LabelSet
    """Labels in the order of time, with the file that they are from."""
    calibration: Calibration | None = None
    """Calibration of its own; None for the calibration of the set."""


@dataclass(frozen=True)
class ConversionResult:
    """Counts of what a conversion wrote."""

    recordings: int
    """Number of files."""
    taxels: int
    """Number of taxels of the skin."""
    readings: int
    """Number of scans in all files."""
    labels: int
    """Number of labels in all files."""


def name_gestures(
    path: Path, texts: Iterable[str], names: Sequence[str] = ()
) -> list[str]:
    """Return the gesture of each of the labels of a file.

    Args:
        path: path of the file.
        texts: its labels.
        names: gestures of the numbers from 1 on, where labels are numbers.

    Raises:
        ImportSourceError: a label is no number of a gesture.
    """
    texts = [str(text) for text in texts]
    found = {text: name_gesture(path, text, names) for text in dict.fromkeys(texts)}
    return [found[text] for text in texts]


def name_gesture(path: Path, text: str, names: Sequence[str]) -> str:
    """Return the gesture of a label: by its number where there are names."""
    text = text.strip()
    if names:
        number = int(text) if re.fullmatch(r"[0-9]{1,3}", text) else 0
        if not 1 <= number <= len(names):
            raise ImportSourceError(
                f"{path}: a gesture is {shorten(text)}; allowed are 1 to {len(names)}; "
                "convert it as a table"
            )
        return names[number - 1]
    return list_spellings().get(look_of(text), text)


@cache
def list_spellings() -> dict[str, str]:
    """Return the gestures of the models of eskin, and `none`, by what they look like.

    A label that looks like one of them is that gesture, so that these models can be
    scored and trained on it. Other names are kept as they are.
    """
    names = [name for model in MODELS for name in load_model(model).card.vocabulary]
    own = {look_of(name): name for name in names}
    return own | dict.fromkeys(UNTOUCHED, NONE)


def name_file(parts: Iterable[str]) -> str:
    """Return the name of a file, without suffix, of parts that differ.

    Letters are kept, and what a file system or shell does not take becomes `_`.
    """
    return "-".join(dict.fromkeys(UNFIT.sub("_", part) for part in parts))


def write_clips(
    clips: Iterable[ImportedClip],
    folder: Path | str,
    skin: Skin,
    calibration: Calibration,
    robot: Robot | None = None,
) -> ConversionResult:
    """Write each clip to `<folder>/<name>.mcap`; write none if any cannot be read.

    Args:
        clips: the clips, each of which is written before the next is read.
        folder: folder for the recordings.
        skin: skin of all clips.
        calibration: calibration of clips without one of their own.
        robot: robot that wears the skin; None for a skin that lies on a table.

    Raises:
        ImportSourceError: two clips have one name, or the folder cannot be made.
        RecordingError: the folder has a recording of that name already, or labels
            cannot be right.
    """
    folder = Path(folder)
    name = TABLE if robot is None else robot.name
    joints = () if robot is None else robot.joint_names
    urdf = b"" if robot is None else describe_robot(robot).urdf
    recordings = readings = labels = 0
    existed = folder.exists()
    checked: list[LabelSet] = []
    work = make_work_folder(folder)
    try:
        with show_progress("readings converted", None) as update:
            for clip in clips:
                path = work / f"{clip.name}{MCAP_SUFFIX}"
                if path.exists():
                    raise ImportSourceError(
                        f"two files, or parts of one, would become {path.name}; "
                        "allowed is one; keep one of them, or sort readings by person "
                        "and session"
                    )
                check_new_recording(folder / path.name)
                check_labels([clip.label_set], written=True)
                checked.append(clip.label_set)
                own = clip.calibration or calibration
                writer = RecordingWriter(
                    path, name, skin, own, clip.metadata, joints, urdf
                )
                with writer:
                    scans = count_scans(clip.scans, readings, update)
                    readings += write_all(writer, scans, clip.label_set.labels)
                recordings += 1
                labels += len(clip.label_set.labels)
        # Names of all clips together, which are not known before.
        check_labels(checked, written=True)
        for path in sorted(work.iterdir()):
            path.replace(folder / path.name)
    finally:
        shutil.rmtree(work)
        if not existed and not any(folder.iterdir()):
            folder.rmdir()
    return ConversionResult(recordings, skin.count, readings, labels)


def count_scans(
    scans: Iterable[Scan], before: int, update: Callable[[int], None]
) -> Iterator[Scan]:
    """Yield scans, and tell how many there were, with the clips before them."""
    for number, scan in enumerate(scans, before + 1):
        yield scan
        update(number)


def make_work_folder(folder: Path) -> Path:
    """Make a new hidden folder inside `folder`, which is made if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=".convert-", dir=folder))
    except OSError as error:
        raise ImportSourceError(
            f"cannot write into {folder}: {error.strerror}; give another folder"
        ) from error


def check_source(source: Path) -> None:
    """Check that there is something to convert.

    Raises:
        ImportSourceError: there is neither a file nor a folder.
    """
    if not source.exists():
        raise ImportSourceError(
            f"no file or folder {source}; give a file, or the folder of the files"
        )


def find_files(source: Path, pattern: str, suffixes: tuple[str, ...]) -> list[Path]:
    """Find the files below a folder that match a pattern and a suffix, sorted.

    A single file is returned as it is.

    Raises:
        ImportSourceError: there is neither a file nor a folder.
    """
    check_source(source)
    if source.is_file():
        return [source]
    found = (p for p in source.rglob(pattern) if p.is_file())
    return sorted(p for p in found if p.name.endswith(suffixes))


def read_decompressed(path: Path) -> bytes:
    """Read a file; decompress it if its name ends with .gz.

    Raises:
        ValueError: it cannot be read or decompressed.
    """
    try:
        data = read_file(path, MAX_SOURCE_BYTES)
        if path.suffix == GZIP_SUFFIX:
            with gzip.GzipFile(fileobj=BytesIO(data)) as file:
                data = file.read(MAX_SOURCE_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise ValueError(str(error)) from error
    if len(data) > MAX_SOURCE_BYTES:
        raise ValueError(
            f"it unpacks to more than {MAX_SOURCE_BYTES:,} bytes, allowed are fewer"
        )
    return data
