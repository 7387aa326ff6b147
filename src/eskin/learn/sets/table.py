"""This module converts tables of frames: CSV or npz, a row an instant of a grid.

Sets that are published as such tables are layouts in `LAYOUTS`. Geometry and units are
nominal unless they are given. The rest of each taxel is, for each person, the median of
its lowest counts in the repetitions.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import ImportSourceError
from eskin.files import open_file
from eskin.learn.sets.conversion import (
    FULL_SCALE_KPA,
    ConversionResult,
    ImportedClip,
    find_files,
    write_clips,
)
from eskin.learn.sets.shearsense import ARCHIVE_ERRORS, check_unpacked
from eskin.learn.sets.socialtouch import PITCH
from eskin.recording.records import NONE, Label, Metadata
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

SUFFIXES = (".csv", ".npz")
MAX_TABLE_BYTES = 2 << 30
"""Largest size of a table, unpacked [bytes]."""
START_NS = 946_684_800 * NS_PER_S
"""Stamp of the first reading, 1 January 2000, as tables state no time."""
GAP_NS = 2 * NS_PER_S
"""Gap between two repetitions, as long as the recogniser's window."""
MOST = 65_535
"""Greatest count of a recording; fractions are stored in steps of full scale by it."""
UNTOUCHED = ("", "no", "no_touch", "notouch", NONE)
"""Names of no touch."""


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
        *(8, 8, 135.0, "gesture", "subject", ("variant",), "frame", 1023.0),
        COST_GESTURES,
    ),
    "haart": TableLayout(
        *(8, 8, 54.0, "gesture", "participant", ("substrate", "cover")),
        full_scale=1023.0,
    ),
    "capfingerid": TableLayout(
        *(27, 15, 14.3, "labels", None, ("trial",)), full_scale=255.0
    ),
}
"""Layouts of public sets: the Corpus of Social Touch, the 8 x 8 taxels that are
published of HAART, and CapFingerId."""


@dataclass(frozen=True, eq=False)
class Table:
    """Holds the rows of a file, by what each is of."""

    values: Float[np.ndarray, "reading taxel"]
    """Values of the taxels, row by row."""
    keys: dict[str, np.ndarray]
    """Columns that the layout names, as texts, by its fields and numbers."""


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
        *(layout.rows, layout.columns, PITCH if pitch is None else pitch),
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
    path: Path, layout: TableLayout, name: str, full_scale_kpa: float
) -> Iterator[ImportedClip]:
    """Read a file as a clip for each person, with one label a repetition."""
    table = load_table(path, layout)
    counts, full_scale = find_counts(path, table.values, layout.full_scale)
    people, period = table.keys["person"], round(1e9 / layout.rate)
    for person in np.unique(people):
        rows = np.flatnonzero(people == person)
        parts = np.split(rows, find_starts(table, rows))
        rest = np.median([counts[part].min(axis=0) for part in parts], axis=0)
        calibration = Calibration(
            np.full(rest.size, full_scale_kpa / full_scale), full_scale, rest=rest
        )
        scans: list[Scan] = []
        labels: list[Label] = []
        stamp, received = START_NS, np.ones(rest.size, dtype=np.bool_)
        for part in parts:
            stamps = stamp + period * np.arange(len(part) + 1)
            pairs = zip(stamps[:-1].tolist(), counts[part], strict=True)
            scans += [Scan(at, row, received, np.empty(0)) for at, row in pairs]
            gesture = name_gesture(str(table.keys["label"][part[0]]), layout.names)
            labels.append(Label(stamp, int(stamps[-1]), gesture))
            stamp = int(stamps[-1]) + GAP_NS
        subject = write_plainly(str(person))
        stem = write_plainly(path.stem)
        notes = {"source_file": path.name, "rate": f"{layout.rate:g} Hz"}
        yield ImportedClip(
            stem if subject == stem else f"{stem}-{subject}",
            Metadata(name, subject, subject, name, notes),
            tuple(scans),
            tuple(labels),
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
    path: Path, values: Float[np.ndarray, "reading taxel"], full_scale: float | None
) -> tuple[Int[np.ndarray, "reading taxel"], int]:
    """Return values as counts, and the counts at full scale."""
    is_whole = bool((values == np.rint(values)).all())
    if full_scale is None:
        most = float(values.max(initial=1.0 if is_whole else 0.0))
        full_scale = 2.0 ** int(np.ceil(np.log2(most + 1))) - 1 if is_whole else most
    wrong = values[~((values >= 0) & (values <= full_scale))]
    if len(wrong):
        raise ImportSourceError(
            f"{path}: a taxel is {wrong[0]:g}; allowed are 0 to {full_scale:g}; state "
            "the greatest value with --full-scale, or leave the file out"
        )
    if is_whole and full_scale <= MOST:
        return values.astype(np.int32), int(full_scale)
    return np.rint(values * (MOST / full_scale)).astype(np.int32), MOST


def name_gesture(text: str, names: Sequence[str]) -> str:
    """Return the gesture of a label: by its number where there are names."""
    if names:
        number = int(text) if re.fullmatch(r"\d{1,3}", text) else 0
        if not 1 <= number <= len(names):
            raise ImportSourceError(
                f"a gesture is {text!r}; allowed are 1 to {len(names)}; convert it as "
                "a table"
            )
        return names[number - 1]
    plain = write_plainly(text.lower())
    return NONE if plain in UNTOUCHED else plain


def write_plainly(text: str) -> str:
    """Return a text with nothing but letters, digits and single `_`."""
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")


def load_table(path: Path, layout: TableLayout) -> Table:
    """Load a file and the columns that its layout names."""
    load = load_npz if path.suffix == ".npz" else load_csv
    try:
        with open_file(path, MAX_TABLE_BYTES) as file:
            table = load(path, file, layout)
    except ImportSourceError:
        raise
    except ARCHIVE_ERRORS as error:
        raise ImportSourceError(
            f"{path}: not a whole table ({error}); copy it again from the set"
        ) from error
    own = np.full(len(table.values), path.stem)
    return Table(table.values, {"person": own} | table.keys)


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
    """Load a CSV file whose first line names the columns."""
    keys, count = list_keys(layout), layout.rows * layout.columns
    with TextIOWrapper(file, "utf-8-sig") as text:
        first, second = text.readline(MOST), text.readline(MOST)
        cut = max(",;\t", key=first.count)
        names = [name.strip(' "') for name in first.strip().split(cut)]
        index = {field: find_column(path, names, name) for field, name in keys.items()}
        if max(index.values()) + count >= len(names) or not second.strip():
            raise ImportSourceError(
                f"{path}: {len(names)} columns, and "
                f"{'readings' if second.strip() else 'no reading'}; allowed are those "
                f"named, then {count} of the frame; correct --rows and --columns, or "
                "leave the file out"
            )
        read = partial(np.loadtxt, text, delimiter=cut, quotechar='"', ndmin=2)
        text.seek(0)
        frame = range(len(names) - count, len(names))
        values = read(np.float32, skiprows=1, usecols=frame)
        text.seek(0)
        texts = read(str, skiprows=1, usecols=list(index.values()))
    columns = map(np.char.strip, texts.T)
    return Table(values, dict(zip(index, columns, strict=True)))


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
    trial, label = keys.get("trial 0"), keys["label"]
    if trial is not None and len(label) != len(values):
        keys["label"] = label[trial]
    for field, column in keys.items():
        if column.shape != values.shape[:1]:
            raise ImportSourceError(
                f"{path}: {names[index[field]]} has shape {column.shape}; allowed is "
                f"({len(values)},), of labels also one value a trial; correct it"
            )
    flat = values.reshape(len(values), -1).astype(np.float32)
    return Table(flat, {field: column.astype(str) for field, column in keys.items()})
