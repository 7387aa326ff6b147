"""This module converts tables of readings of a whole skin: npz or Parquet, in chunks.

A file has one row a reading, with columns `pressure` [kPa] or `counts`, one number a
taxel in the order of the skin, and:

- `stamp`: integers [ns], fractions [s] or times; otherwise `rate` [Hz]
- `q`: joint positions, or `poses`: 7 or 12 numbers a taxel in the world, from which
  they are solved, as the paper records them (section IV-D)
- `gesture`: one a reading, or one a repetition, with its `start` and `end`
- `person`, `session`: one a reading or one a file
- `received`: whether each taxel was received; all are unless it is given
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NoReturn

import numpy as np
from jaxtyping import Bool, Int, Num

from eskin.errors import ImportSourceError, RecordingError
from eskin.files import READINGS, TAXELS, TOUCHES
from eskin.recording.label_check import LabelSet
from eskin.recording.records import (
    Label,
    Metadata,
    build_labels,
    sort_labels,
)
from eskin.sets.conversion import (
    FULL_SCALE_KPA,
    NPZ_SUFFIX,
    PARQUET_SUFFIX,
    ConversionResult,
    ImportedClip,
    find_files,
    name_file,
    name_gestures,
    write_clips,
)
from eskin.sets.reading_files import ReadingFile, open_readings, to_texts
from eskin.sets.table import MOST, START_NS
from eskin.sets.taxel_poses import POSE_NUMBERS, PoseFit, PoseReader
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

SUFFIXES = (NPZ_SUFFIX, PARQUET_SUFFIX)
LABELS_SUFFIX = f".labels{PARQUET_SUFFIX}"
"""End of the name of a Parquet file with the repetitions of the one beside it."""
CHUNK_BYTES = 16 << 20
"""Size of the readings that are held at a time, as doubles [bytes]."""
PERIODS = (100_000, NS_PER_S)
"""Shortest and longest usual period of readings [ns]."""
MAX_READINGS = 10_000_000
"""Largest number of readings of a file, whose stamps are held."""
MAX_STAMP = 1 << 62
"""Largest stamp [ns since the epoch]."""


@dataclass(frozen=True, eq=False)
class ReadingLayout:
    """A reading layout says of which skin files are, and how they are read."""

    mounted: MountedSkin
    """Skin on its robot."""
    calibration: Calibration
    """Calibration of files with counts."""
    label: str = "gesture"
    """Column of the gesture."""
    person: str = "person"
    """Column of the person."""
    rate: float | None = None
    """Readings a second of files without stamps [Hz]; None for column `rate`."""


def convert_readings(
    source: Path | str, folder: Path | str, layout: ReadingLayout
) -> tuple[ConversionResult, PoseFit | None]:
    """Convert tables of readings to a recording for each file, person and session.

    Args:
        source: a file, or a folder of files.
        folder: folder for the recordings.
        layout: how the files are read.

    Returns:
        What was written, and how well joint positions fit poses; None without poses.

    Raises:
        ImportSourceError: a file cannot be converted.
    """
    files = [
        path
        for path in find_files(Path(source), "*", SUFFIXES)
        if not path.name.endswith(LABELS_SUFFIX) and not is_beside_readings(path)
    ]
    if not files or not files[0].name.endswith(SUFFIXES):
        raise ImportSourceError(
            f"no file in {source} ends with {', '.join(SUFFIXES)}; give the set"
        )
    poses = PoseReader(layout.mounted)
    clips = (clip for path in files for clip in read_sessions(path, layout, poses))
    robot = layout.mounted.robot
    result = write_clips(clips, folder, layout.mounted.skin, layout.calibration, robot)
    return result, poses.fit


def is_beside_readings(path: Path) -> bool:
    """Return whether a file of an exported folder describes touches or taxels."""
    return path.name in (TOUCHES, TAXELS) and path.with_name(READINGS).exists()


def read_sessions(
    path: Path, layout: ReadingLayout, poses: PoseReader
) -> Iterator[ImportedClip]:
    """Read a file as a clip for each run of readings of one person and session."""
    with open_readings(path) as file:
        widths = choose_arrays(file, layout.mounted)
        count = file.count_rows(next(iter(widths)))
        if not 0 < count <= MAX_READINGS:
            raise ImportSourceError(
                f"{path}: {count:,} readings; allowed are 1 to {MAX_READINGS:,}; leave "
                "the file out, or divide it"
            )
        stamps = read_stamps(file, count, layout.rate)
        people = read_texts(file, layout.person, count, path.stem)
        sessions = people
        if "session" in file.names:
            sessions = read_texts(file, "session", count, "")
        is_new = (people[1:] != people[:-1]) | (sessions[1:] != sessions[:-1])
        starts = [0, *(np.flatnonzero(is_new) + 1).tolist()]
        runs = [slice(*pair) for pair in zip(starts, [*starts[1:], count], strict=True)]
        check_order(path, stamps, runs)
        labels = read_labels(file, layout, stamps, runs)
        calibration = layout.calibration
        if "pressure" in widths:
            calibration = measure_calibration(file, widths, layout.mounted.skin.count)
        scans = read_scans(file, widths, stamps, calibration, poses)
        for run, own in zip(runs, labels, strict=True):
            person = str(people[run.start]).strip()
            session = str(sessions[run.start]).strip()
            several = (person, session) if len(runs) > 1 else ()
            first, last = stamps[run][[0, -1]].tolist()
            yield ImportedClip(
                name_file((path.stem, *several)),
                Metadata("table", person, session, "table", {"source_file": path.name}),
                islice(scans, run.stop - run.start),
                LabelSet(find_label_file(path), own, first, last),
                calibration,
            )


Widths = dict[str, tuple[int, ...]]


def choose_arrays(file: ReadingFile, mounted: MountedSkin) -> Widths:
    """Return the columns of arrays that are read, with their numbers a reading."""
    count = mounted.skin.count
    joints = len(mounted.robot.joint_names)
    known = {
        "counts": (count,),
        "pressure": (count,),
        "received": (count,),
        "q": (joints,),
        "poses": tuple(numbers * count for numbers in POSE_NUMBERS),
    }
    widths = {name: known[name] for name in known if name in file.names}
    if "counts" in widths:
        widths.pop("pressure", None)
    needs = "poses or q" if joints else ""
    for wanted in ("counts or pressure", needs):
        if wanted and not set(wanted.split(" or ")) & set(widths):
            raise ImportSourceError(
                f"{file.path}: no {wanted} in {', '.join(file.names[:12])}; allowed is "
                "one of them for each reading; name the columns so"
            )
    return widths


def read_stamps(
    file: ReadingFile, count: int, rate: float | None
) -> Int[np.ndarray, "reading"]:
    """Return the stamps of the readings [ns since the epoch]."""
    if "stamp" in file.names:
        if rate is not None:
            raise ImportSourceError(
                f"{file.path}: --rate is given, and the file has stamps; allowed is "
                "one of them; leave --rate out"
            )
        return read_times(file, "stamp", count)
    if rate is None and "rate" in file.names:
        rate = float(file.read_column("rate").reshape(-1)[0])
    if rate is None or not NS_PER_S / PERIODS[1] <= rate <= NS_PER_S / PERIODS[0]:
        raise ImportSourceError(
            f"{file.path}: no 'stamp', and the rate is {rate}; allowed are stamps, or "
            "1 to 10,000 Hz; add a column stamp, or give --rate"
        )
    return START_NS + np.rint(np.arange(count) * (NS_PER_S / rate)).astype(np.int64)


def read_times(file: ReadingFile, name: str, count: int) -> Int[np.ndarray, "time"]:
    """Return a column of times [ns]: integers [ns], fractions [s], or times."""
    values = file.read_column(name)
    check_length(file, name, values, count)
    if values.dtype.kind == "M":
        times = values.astype("datetime64[ns]").astype(np.int64)
    elif values.dtype.kind == "f":
        is_time = (values >= 0) & (values * NS_PER_S <= MAX_STAMP)
        times = np.where(is_time, np.rint(values * NS_PER_S), -1).astype(np.int64)
    elif values.dtype.kind in "iu":
        times = values.astype(np.int64)
    else:
        times = np.full(count, -1)
    for number in np.flatnonzero((times < 0) | (times > MAX_STAMP))[:1]:
        raise ImportSourceError(
            f"{file.path}: '{name}' {number} is {values[number]}; allowed are integers "
            "[ns], fractions [s] or times, from 0 on"
        )
    return times


def check_length(file: ReadingFile, name: str, values: np.ndarray, count: int) -> None:
    """Raise unless a column has one value for each of a number of things."""
    if values.shape != (count,):
        raise ImportSourceError(
            f"{file.path}: '{name}' has shape {values.shape}; allowed is ({count},), "
            "one value each"
        )


def check_order(
    path: Path, stamps: Int[np.ndarray, "reading"], runs: list[slice]
) -> None:
    """Raise unless the stamps of each run increase, by periods of a sensor."""
    for run in runs:
        own = stamps[run]
        steps = np.diff(own)
        for number in np.flatnonzero(steps <= 0)[:1].tolist():
            raise ImportSourceError(
                f"{path}: reading {run.start + number + 1} is of {own[number + 1]} ns, "
                f"the one before it of {own[number]} ns; allowed are stamps that "
                "increase for each person and session; sort the readings"
            )
        usual = float(np.median(steps)) if len(steps) else PERIODS[0]
        if not PERIODS[0] <= usual <= PERIODS[1]:
            raise ImportSourceError(
                f"{path}: readings are {usual / NS_PER_S:g} s apart; allowed are "
                "0.0001 to 1 s; write stamps as integers [ns] or fractions [s]"
            )


def read_texts(file: ReadingFile, name: str, count: int, default: str) -> np.ndarray:
    """Return a text for each reading, of a column or a default."""
    if name not in file.names and name == "person":
        return np.broadcast_to(np.array(default), (count,))
    if name not in file.names:
        raise_missing(file, name, "--person")
    values = to_texts(file.path, name, file.read_column(name))
    if not values.ndim:
        return np.broadcast_to(values, (count,))
    check_length(file, name, values, count)
    return values


def raise_missing(file: ReadingFile, name: str, option: str) -> NoReturn:
    """Raise as a file lacks a column that is told by an option."""
    raise ImportSourceError(
        f"{file.path}: no column '{name}' in {', '.join(file.names[:12])}; allowed is "
        f"one of them; name it with {option}"
    )


def find_label_file(path: Path) -> Path:
    """Return the file that holds the labels of a file of readings, often the same."""
    beside = path.with_name(path.stem + LABELS_SUFFIX)
    return beside if path.suffix == PARQUET_SUFFIX and beside.exists() else path


def read_labels(
    file: ReadingFile,
    layout: ReadingLayout,
    stamps: Int[np.ndarray, "reading"],
    runs: list[slice],
) -> list[tuple[Label, ...]]:
    """Return the labels of each run of readings."""
    path = find_label_file(file.path)
    try:
        if path != file.path:
            with open_readings(path) as table:
                found = [read_repetitions(table, layout.label, file)]
        elif {"start", "end"} <= set(file.names):
            found = [read_repetitions(file, layout.label, file)]
        else:
            found = label_readings(file, layout.label, stamps, runs)
    except RecordingError as error:
        raise ImportSourceError(f"{path}: {error}") from error
    if len(found) != len(runs):
        raise ImportSourceError(
            f"{path}: labels have a start and an end, and readings are of {len(runs)} "
            "people and sessions; allowed is one; give a gesture a reading, or a file "
            "for each"
        )
    return found


def read_repetitions(
    table: ReadingFile, label: str, file: ReadingFile
) -> tuple[Label, ...]:
    """Return the labels of a table of gestures with their starts and ends."""
    if label not in table.names:
        raise_missing(table, label, "--label")
    texts = to_texts(table.path, label, table.read_column(label)).reshape(-1)
    names = name_gestures(table.path, texts)
    origin = 0 if "stamp" in file.names else START_NS
    starts = origin + read_times(table, "start", len(names))
    ends = origin + read_times(table, "end", len(names))
    return sort_labels(
        Label(start, end, name)
        for start, end, name in zip(starts.tolist(), ends.tolist(), names, strict=True)
    )


def label_readings(
    file: ReadingFile,
    label: str,
    stamps: Int[np.ndarray, "reading"],
    runs: list[slice],
) -> list[tuple[Label, ...]]:
    """Return the labels of runs of readings that have a gesture each."""
    if label not in file.names:
        raise_missing(file, label, "--label")
    texts = to_texts(file.path, label, file.read_column(label))
    check_length(file, label, texts, len(stamps))
    names = name_gestures(file.path, texts)
    found = []
    for run in runs:
        own = stamps[run]
        period = int(np.median(np.diff(own))) if len(own) > 1 else PERIODS[0]
        found.append(build_labels(own, names[run], period))
    return found


def measure_calibration(file: ReadingFile, widths: Widths, count: int) -> Calibration:
    """Return a calibration that stores the pressures of a file, negative ones too."""
    own = {name: widths[name] for name in ("pressure", "received") if name in widths}
    least = 0.0
    greatest = FULL_SCALE_KPA
    first = 0
    for chunk in file.iterate(own, count_rows(own)):
        received = find_received(chunk, "pressure")
        pressure = np.where(received, chunk["pressure"], 0.0)
        check_finite(file.path, first, pressure, "pressure")
        least = min(least, float(pressure.min(initial=0.0)))
        greatest = max(greatest, float(pressure.max(initial=0.0)))
        first += len(pressure)
    gain = (greatest - least) / MOST
    rest = float(np.rint(-least / gain))
    return Calibration(np.full(count, gain), MOST, rest=np.full(count, rest))


def count_rows(widths: Widths) -> int:
    """Return the number of readings of a chunk."""
    return max(1, CHUNK_BYTES // (8 * sum(max(sizes) for sizes in widths.values())))


def find_received(
    chunk: dict[str, np.ndarray], name: str
) -> Bool[np.ndarray, "reading taxel"]:
    """Return which values of a chunk were received."""
    if "received" in chunk:
        return chunk["received"] != 0
    return np.ones(chunk[name].shape, np.bool_)


def check_finite(
    path: Path, first: int, values: Num[np.ndarray, "reading number"], name: str
) -> None:
    """Raise if a value of a chunk is not finite."""
    for row, column in np.argwhere(~np.isfinite(values))[:1].tolist():
        raise ImportSourceError(
            f"{path}: reading {first + row}: '{name}' {column} is "
            f"{values[row, column]}; allowed are finite numbers; leave the reading "
            "out, or mark the taxel in 'received'"
        )


def read_scans(
    file: ReadingFile,
    widths: Widths,
    stamps: Int[np.ndarray, "reading"],
    calibration: Calibration,
    poses: PoseReader,
) -> Iterator[Scan]:
    """Yield the scans of a file, which is read in chunks."""
    first = 0
    for chunk in file.iterate(widths, count_rows(widths)):
        counts, received = convert_counts(file.path, first, chunk, calibration)
        q = None
        if "q" in chunk:
            check_finite(file.path, first, chunk["q"], "q")
            q = chunk["q"].astype(np.float64)
        if "poses" in chunk:
            q = poses.read(file.path, first, chunk["poses"], q)
        if q is None:
            q = np.empty((len(counts), 0))
        for number, stamp in enumerate(stamps[first : first + len(counts)].tolist()):
            yield Scan(stamp, counts[number], received[number], q[number])
        first += len(counts)


def convert_counts(
    path: Path, first: int, chunk: dict[str, np.ndarray], calibration: Calibration
) -> tuple[Int[np.ndarray, "reading taxel"], Bool[np.ndarray, "reading taxel"]]:
    """Return the counts of a chunk, and which of them were received."""
    name = "counts" if "counts" in chunk else "pressure"
    received = find_received(chunk, name)
    values = np.where(received, chunk[name], 0)
    check_finite(path, first, values, name)
    if name == "pressure" and calibration.rest is not None:
        counts = np.rint(values / calibration.gain) + calibration.rest
        return np.clip(counts, 0, MOST).astype(np.int32), received
    allowed = (values >= 0) & (values <= calibration.full_scale)
    is_count = allowed & (values == np.rint(values))
    for row, taxel in np.argwhere(~is_count)[:1].tolist():
        raise ImportSourceError(
            f"{path}: reading {first + row}: taxel {taxel} has {values[row, taxel]:g} "
            f"counts; allowed are whole numbers from 0 to {calibration.full_scale}; "
            "give the skin's --calibration, or name kPa 'pressure'"
        )
    return values.astype(np.int32), received
