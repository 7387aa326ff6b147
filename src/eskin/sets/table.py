"""This module converts tables of frames: CSV or npz, a row an instant of a grid.

Sets that are published as such tables are layouts in `LAYOUTS`. Geometry and units are
nominal unless they are given. The rest of each taxel is, for each person, the median of
its lowest counts in the repetitions.
"""

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import ImportSourceError
from eskin.files import open_file, parse_number, shorten
from eskin.recording.label_check import LabelSet
from eskin.recording.records import Label, Metadata
from eskin.sets.conversion import (
    CSV_SUFFIX,
    FULL_SCALE_KPA,
    NPZ_SUFFIX,
    ConversionResult,
    ImportedClip,
    find_files,
    name_file,
    name_gestures,
    write_clips,
)
from eskin.sets.reading_files import to_texts
from eskin.sets.shearsense import ARCHIVE_ERRORS, check_unpacked
from eskin.sets.socialtouch import PITCH
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

SUFFIXES = (CSV_SUFFIX, NPZ_SUFFIX)
MAX_TABLE_BYTES = 2 << 30
"""Largest size of a table, unpacked [bytes]."""
START_NS = 946_684_800 * NS_PER_S
"""Stamp of the first reading, 1 January 2000, as tables state no time."""
GAP_NS = 2 * NS_PER_S
"""Gap between two repetitions, as long as the recogniser's window."""
MOST = 65_535
"""Greatest count of a recording; fractions are stored in steps of full scale by it."""
CHUNK_ROWS = 4096
"""Number of rows of a CSV file that are held as texts at a time."""
HEAD_BYTES = 256
"""Size of the beginning of a file by which its encoding is found."""
UTF_8 = "utf-8-sig"
"""Python's name of UTF-8 that may begin with a byte order mark."""
DECIMAL_COMMA = re.compile(r"[-+]?[0-9]+,[0-9]+")


@dataclass(frozen=True)
class TableLayout:
    """Describes how a table is read.

    A column is told by its name, or by the beginning of one alone, in any case. The
    last `rows` x `columns` columns of a CSV file are the frame, row by row.
    """

    rows: int
    """Rows of the grid."""
    columns: int
    """Columns of the grid."""
    rate: float
    """Readings a second [Hz]."""
    label: str
    """Column of the gesture; in an npz also one value a repetition."""
    person: str | None = None
    """Column of the person; None for the name of the file."""
    trial: tuple[str, ...] = ()
    """Columns that change with the repetition, beside label and person."""
    frame: str | None = None
    """Column that counts the readings of a repetition from its start."""
    full_scale: float | None = None
    """Greatest value; None for the least 2^n - 1 that none exceeds, of fractions the
    greatest."""
    names: tuple[str, ...] = ()
    """Gestures of the numbers from 1 on, where labels are numbers."""


COST_GESTURES = tuple(
    """
    grab hit massage pat pinch poke press rub scratch slap squeeze stroke tap tickle
    """.split()
)
LAYOUTS = {
    "cost": TableLayout(
        rows=8,
        columns=8,
        rate=135.0,
        label="gesture",
        person="subject",
        trial=("variant",),
        frame="frame",
        full_scale=1023.0,
        names=COST_GESTURES,
    ),
    "haart": TableLayout(
        rows=8,
        columns=8,
        rate=54.0,
        label="gesture",
        person="participant",
        trial=("substrate", "cover"),
        full_scale=1023.0,
    ),
    "capfingerid": TableLayout(
        rows=27,
        columns=15,
        rate=14.3,
        label="labels",
        trial=("trial",),
        full_scale=255.0,
    ),
}
"""Layouts of public sets: the Corpus of Social Touch, the 8 x 8 taxels that are
published of HAART, and CapFingerId."""


@dataclass(frozen=True, eq=False)
class Table:
    """Holds the rows of a file, by what each is of."""

    path: Path
    """Path of the file."""
    values: Float[np.ndarray, "reading taxel"]
    """Values of the taxels, row by row."""
    keys: dict[str, np.ndarray]
    """Columns that the layout names, as texts, by its fields and numbers."""
    columns: tuple[str, ...] = ()
    """Names of the columns of the taxels; an archive has none."""
    lines: tuple[int, ...] = ()
    """Number of the line on which each row ends; an archive has none."""

    def describe_place(self, row: int, taxel: int) -> str:
        """Describe where the value of a taxel is in the file."""
        if not self.columns:
            return f"{self.path}: reading {row}, taxel {taxel}"
        return f"{self.path}: line {self.lines[row]}, column {self.columns[taxel]}"


def convert_table(
    source: Path | str,
    folder: Path | str,
    layout: TableLayout,
    name: str = "table",
    pitch: float | None = None,
    full_scale_kpa: float = FULL_SCALE_KPA,
) -> ConversionResult:
    """Convert tables to a recording for each file and person.

    Args:
        source: a file, or a folder of files.
        folder: folder for the recordings.
        layout: how the files are read.
        name: name of the set and of the skin.
        pitch: distance of neighbouring taxels [m], which makes the geometry of the
            skin count; None takes a nominal one.
        full_scale_kpa: nominal pressure at full scale [kPa].

    Raises:
        ImportSourceError: a file cannot be converted.
    """
    files = find_files(Path(source), "*", SUFFIXES)
    if not files:
        raise ImportSourceError(
            f"no file in {source} ends with {', '.join(SUFFIXES)}; give the set"
        )
    skin = build_grid_skin(
        layout.rows,
        layout.columns,
        PITCH if pitch is None else pitch,
        name=name,
        calibrated=pitch is not None,
    )
    nominal = Calibration.uniform(skin.count, MOST, full_scale_kpa)
    clips = (
        clip
        for path in files
        for clip in read_people(path, layout, name, full_scale_kpa)
    )
    return write_clips(clips, folder, skin, nominal)


def read_people(
    path: Path,
    layout: TableLayout,
    name: str,
    full_scale_kpa: float,
) -> Iterator[ImportedClip]:
    """Read a file as a clip for each person, with one label a repetition."""
    table = load_table(path, layout)
    counts, full_scale = find_counts(table, layout.full_scale)
    made = name_gestures(path, table.keys["label"], layout.names)
    people = table.keys["person"]
    period = round(1e9 / layout.rate)
    for person in np.unique(people):
        rows = np.flatnonzero(people == person)
        parts = np.split(rows, find_starts(table, rows))
        rest = np.median([counts[part].min(axis=0) for part in parts], axis=0)
        calibration = Calibration(
            np.full(rest.size, full_scale_kpa / full_scale), full_scale, rest=rest
        )
        scans: list[Scan] = []
        labels: list[Label] = []
        stamp = START_NS
        received = np.ones(rest.size, dtype=np.bool_)
        for part in parts:
            stamps = stamp + period * np.arange(len(part) + 1)
            pairs = zip(stamps[:-1].tolist(), counts[part], strict=True)
            scans += [Scan(at, row, received, np.empty(0)) for at, row in pairs]
            labels.append(Label(stamp, int(stamps[-1]), made[part[0]]))
            stamp = int(stamps[-1]) + GAP_NS
        subject = str(person)
        notes = {"source_file": path.name, "rate": f"{layout.rate:g} Hz"}
        yield ImportedClip(
            name_file((path.stem, subject)),
            Metadata(name, subject, subject, name, notes),
            tuple(scans),
            LabelSet(path, tuple(labels), scans[0].stamp, scans[-1].stamp),
            calibration,
        )


def find_starts(table: Table, rows: Int[np.ndarray, "row"]) -> Int[np.ndarray, "start"]:
    """Find where repetitions but the first start among the rows of a person."""
    is_new = np.diff(rows) != 1
    for field, values in table.keys.items():
        own = values[rows]
        if field == "frame":
            is_new |= np.diff(own.astype(np.float64)) <= 0
        else:
            is_new |= own[1:] != own[:-1]
    return np.flatnonzero(is_new) + 1


def find_counts(
    table: Table, full_scale: float | None
) -> tuple[Int[np.ndarray, "reading taxel"], int]:
    """Return the values of a table as counts, and the counts at full scale."""
    values = table.values
    limit = np.inf if full_scale is None else full_scale
    is_fit = (values >= 0) & (values <= limit) & np.isfinite(values)
    for row, taxel in np.argwhere(~is_fit)[:1].tolist():
        value = values[row, taxel]
        remedy = "correct it, or leave the reading out"
        if limit < value < np.inf:
            remedy = "state the greatest value with --full-scale"
        raise ImportSourceError(
            f"{table.describe_place(row, taxel)} is {value:g}; allowed are numbers "
            f"from 0 {'on' if limit == np.inf else f'to {limit:g}'}; {remedy}"
        )
    is_whole = bool((values == np.rint(values)).all())
    if full_scale is None:
        most = float(values.max(initial=1.0 if is_whole else 0.0))
        full_scale = 2.0 ** int(np.ceil(np.log2(most + 1))) - 1 if is_whole else most
    if is_whole and full_scale <= MOST:
        return values.astype(np.int32), int(full_scale)
    return np.rint(values * (MOST / full_scale)).astype(np.int32), MOST


def load_table(path: Path, layout: TableLayout) -> Table:
    """Load a file and the columns that its layout names.

    Raises:
        ImportSourceError: it cannot be read.
    """
    load = load_npz if path.suffix == NPZ_SUFFIX else load_csv
    try:
        with open_file(path, MAX_TABLE_BYTES) as file:
            table = load(path, file, layout)
    except ImportSourceError:
        raise
    except ARCHIVE_ERRORS as error:
        raise ImportSourceError(
            f"{path}: not a whole table ({error}); allowed are CSV files of UTF-8 and "
            "npz archives; copy it again from the set"
        ) from error
    if layout.person is None:
        table.keys["person"] = np.full(len(table.values), path.stem)
    return table


def list_keys(layout: TableLayout) -> dict[str, str]:
    """Return the columns that a layout names, by field and number."""
    keys = {"label": layout.label, "person": layout.person, "frame": layout.frame}
    keys |= {f"trial {number}": name for number, name in enumerate(layout.trial)}
    return {field: name for field, name in keys.items() if name is not None}


def find_column(path: Path, names: Sequence[str], wanted: str) -> int:
    """Return the index of the column that a name, or its beginning, tells."""
    plain = [name.strip().lower() for name in names]
    found = [n for n, name in enumerate(plain) if name == wanted.lower()]
    found = found or [
        n for n, name in enumerate(plain) if name.startswith(wanted.lower())
    ]
    if len(found) != 1:
        raise ImportSourceError(
            f"{path}: {len(found)} columns are '{wanted}'; its columns are "
            f"{', '.join(names[:8])}; name one with --label, --person, --trial or "
            "--frame"
        )
    return found[0]


def load_csv(path: Path, file: BinaryIO, layout: TableLayout) -> Table:
    """Load a CSV file whose first line names the columns.

    Raises:
        ImportSourceError: naming the first line that cannot be read.
    """
    encoding = find_encoding(path, file)
    try:
        with TextIOWrapper(file, encoding, newline="") as text:
            return read_csv(path, text, layout)
    except UnicodeError as error:
        place = f"{path} is no whole UTF-16"
        if encoding == UTF_8:
            place = f"{path}: line {find_undecodable(path)} is no UTF-8"
        raise ImportSourceError(
            f"{place} ({getattr(error, 'reason', error)}); allowed are UTF-8, and "
            "UTF-16 with a byte order mark; save it as UTF-8"
        ) from None


def find_encoding(path: Path, file: BinaryIO) -> str:
    """Return the encoding of a text: UTF-16 by its byte order mark, else UTF-8.

    Raises:
        ImportSourceError: it is UTF-16 without a byte order mark.
    """
    head = file.read(HEAD_BYTES)
    file.seek(0)
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if b"\0" in head:
        raise ImportSourceError(
            f"{path} holds zero bytes, as UTF-16 does; allowed are UTF-8, and UTF-16 "
            "with a byte order mark; save it as UTF-8"
        )
    return UTF_8


def find_undecodable(path: Path) -> int:
    """Return the number of the first line of a file that is no UTF-8."""
    with open_file(path, MAX_TABLE_BYTES) as file:
        for number, line in enumerate(file, 1):
            if line.decode("utf-8", "replace").encode() != line:
                return number
    return 0


def read_csv(path: Path, text: TextIOWrapper, layout: TableLayout) -> Table:
    """Read the text of a CSV file, a chunk of rows at a time.

    Raises:
        ImportSourceError: naming the first line that cannot be read.
        UnicodeError: it is of another encoding.
    """
    keys = list_keys(layout)
    count = layout.rows * layout.columns
    head = text.readline(MOST)
    cut = max(",;\t", key=head.count)
    names = [name.strip(' "') for name in head.strip().split(cut)]
    index = {field: find_column(path, names, name) for field, name in keys.items()}
    first = len(names) - count
    if max(index.values()) >= first:
        raise ImportSourceError(
            f"{path}: {len(names)} columns; allowed are those named, then {count} of "
            "the frame; correct --rows and --columns, or leave the file out"
        )
    rows: list[list[float]] = []
    texts: list[list[str]] = []
    lines: list[int] = []
    chunks: list[np.ndarray] = []
    for line, cells in read_rows(path, text, cut, len(names)):
        place = f"{path}: line {line}, column "
        rows.append(parse_cells(place, names[first:], cells[first:]))
        texts.append([cells[column].strip() for column in index.values()])
        lines.append(line)
        if len(rows) == CHUNK_ROWS:
            chunks.append(np.array(rows, np.float32))
            rows.clear()
    if not lines:
        raise ImportSourceError(
            f"{path} has no reading; allowed are rows below the names of the columns; "
            "leave the file out"
        )
    values = np.concatenate([*chunks, np.array(rows, np.float32).reshape(-1, count)])
    columns = dict(zip(index, np.array(texts).T, strict=True))
    return Table(path, values, columns, tuple(names[first:]), tuple(lines))


def read_rows(
    path: Path, text: TextIOWrapper, cut: str, count: int
) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows below the first line, each with the number of its last line.

    Empty lines are left out, and an empty cell after the last separator.

    Raises:
        ImportSourceError: a row has another number of cells, or is cut.
    """
    rows = csv.reader(text, delimiter=cut, strict=True)
    line = 1
    try:
        for cells in rows:
            line = rows.line_num + 1
            if len(cells) == count + 1 and not cells[-1]:
                cells.pop()
            if len(cells) not in (0, count):
                raise ImportSourceError(
                    f"{path}: line {line} has {len(cells)} columns, line 1 names "
                    f"{count}; allowed are as many, separated by {cut!r}, and points "
                    "before decimals"
                )
            if cells:
                yield line, cells
    except csv.Error as error:
        raise ImportSourceError(
            f"{path}: line {line + 1} or one after it cannot be read ({error}); "
            "allowed are cells of a CSV file"
        ) from None


def parse_cells(place: str, names: Sequence[str], cells: Sequence[str]) -> list[float]:
    """Return the numbers in the cells of a row.

    Raises:
        ImportSourceError: naming the first cell that holds none.
    """
    numbers = []
    for name, cell in zip(names, cells, strict=True):
        try:
            numbers.append(parse_number(cell))
        except ValueError:
            remedy = "correct it or leave the reading out"
            if DECIMAL_COMMA.fullmatch(cell.strip()):
                remedy = "commas are decimal here: write points in their place"
            raise ImportSourceError(
                f"{place}{name} is {shorten(cell)}; allowed are numbers with a decimal "
                f"point; {remedy}"
            ) from None
    return numbers


def load_npz(path: Path, file: BinaryIO, layout: TableLayout) -> Table:
    """Load an npz archive: one array of frames, and columns."""
    check_unpacked(file, MAX_TABLE_BYTES)
    with np.load(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    shapes = (layout.rows, layout.columns), (layout.rows * layout.columns,)
    frames = [a for a in arrays.values() if a.shape[1:] in shapes]
    if len(frames) != 1 or not len(frames[0]):
        raise ImportSourceError(
            f"{path}: {len(frames)} arrays of {layout.rows} x {layout.columns} frames; "
            "allowed is one, not empty; correct --rows and --columns"
        )
    [values] = frames
    names = list(arrays)
    index = {f: find_column(path, names, n) for f, n in list_keys(layout).items()}
    keys = {field: arrays[names[number]] for field, number in index.items()}
    trial = keys.get("trial 0")
    label = keys["label"]
    if trial is not None and len(label) != len(values):
        keys["label"] = label[trial]
    for field, column in keys.items():
        if column.shape != values.shape[:1]:
            raise ImportSourceError(
                f"{path}: {names[index[field]]} has shape {column.shape}; allowed is "
                f"({len(values)},), of labels also one value a trial"
            )
    flat = values.reshape(len(values), -1).astype(np.float32)
    return Table(
        path,
        flat,
        {field: to_texts(path, field, column) for field, column in keys.items()},
    )
