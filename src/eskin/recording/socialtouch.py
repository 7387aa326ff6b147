"""Recordings of the SocialTouch set (github yliess86/SocialTouch).

Its files state neither units nor geometry. Taken here: a flat grid of 10 mm, 255 = 100
kPa (both nominal), stamps as if local time were UTC, and the year 2022 (the oldest that
its software could run in).
"""

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import ImportSourceError

ROWS, COLUMNS = 19, 24
FULL_SCALE = 255
SUFFIXES = (".csv", ".csv.gz")
HEAD = ("participantID", "gesture", "repetition", "frameID", "time")
HEADER = ",".join((*HEAD, *(f"pixel{n}" for n in range(ROWS * COLUMNS))))

GESTURES = (
    "contact_one_hand",
    "contact_two_hands",
    "finger_touch_short_light",
    "finger_touch_short_strong",
    "finger_touch_long_light",
    "finger_touch_long_strong",
    "poke_short",
    "poke_strong",
    "pat_short",
    "pat_long",
    "pinch_vertical",
    "pinch_horizontal",
    "tap_light",
    "tap_multiple",
    "slap_strong",
    "slap_mid",
    "hit_side",
    "hit_top",
    "stroke_leftright",
    "stroke_topdown",
    "stroke_two_once",
    "caress_prolonged",
    "tickle_one_fix",
    "tickle_two_fix",
    "tickle_everywhere",
    "arm_full_everywhere",
    "arms_full_everywhere",
    "finger_stroke_surface_slow",
    "finger_stroke_surface_fast",
    "tap_tam_tam",
    "caress_prolonged_twohands",
    "face_hug",
)
"""Names by the set's numbers, as `GesturesRated.csv` has them but for the spelling of
caress."""


@dataclass(frozen=True, eq=False)
class Repetition:
    """One recording of one gesture by one person."""

    person: int
    """The participant's number."""
    gesture: str
    """One of `GESTURES`."""
    seconds: Float[np.ndarray, "reading"]
    """Since its first reading [s]; about one reading every 83 ms."""
    counts: Int[np.ndarray, "reading taxel"]
    """From 0 to `FULL_SCALE`, row by row."""


def socialtouch_files(source: Path) -> list[Path]:
    """Files of touches in a folder, sorted by name, or one file."""
    if source.is_file():
        return [source]
    if not source.is_dir():
        raise ImportSourceError(f"no folder {source}; give the folder of the files")
    files = sorted(p for p in source.rglob("touch_*") if p.name.endswith(SUFFIXES))
    if not files:
        raise ImportSourceError(
            f"no file in {source} is named touch_*.csv or touch_*.csv.gz; give the "
            "SocialTouch set"
        )
    return files


def read_repetitions(path: Path) -> Iterator[Repetition]:
    """The repetitions of one file, in order.

    Raises:
        ImportSourceError: the file is not as in the set.
    """
    rows = load_rows(path)
    breaks = np.flatnonzero(np.diff(rows[:, 2])) + 1
    for part in np.split(rows, breaks):
        seconds = (part[:, 4] - part[0, 4]) * 1e-3
        counts = part[:, len(HEAD) :].astype(np.int32)
        yield Repetition(int(part[0, 0]), GESTURES[part[0, 1]], seconds, counts)


def load_rows(path: Path) -> Int[np.ndarray, "reading column"]:
    """All rows of a file, checked."""
    header, _, body = load_text(path).partition("\n")
    if header.strip() != HEADER:
        raise ImportSourceError(
            f"{path}: first line is '{header.strip()[:60]}'; allowed is "
            f"'{','.join(HEAD)},pixel0,...,pixel{ROWS * COLUMNS - 1}'; leave other "
            "files out"
        )
    if not body.strip():
        raise ImportSourceError(f"{path}: no readings; leave the file out")
    try:
        rows = np.loadtxt(body.splitlines(), np.int64, delimiter=",", ndmin=2)
    except ValueError as error:
        raise ImportSourceError(
            f"{path}: not whole numbers in {len(HEAD) + ROWS * COLUMNS} columns "
            f"({error}); copy it again from the set"
        ) from error
    check_rows(path, rows)
    return rows


def load_text(path: Path) -> str:
    """Text of a file, gzipped or not."""
    try:
        data = path.read_bytes()
        return (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise ImportSourceError(
            f"{path}: not whole text ({error}); copy it again from the set"
        ) from error


def check_rows(path: Path, rows: Int[np.ndarray, "reading column"]) -> None:
    """Raise when a file's rows are not those of one person and one gesture."""
    if rows.shape[1] != len(HEAD) + ROWS * COLUMNS:
        raise ImportSourceError(
            f"{path}: rows have {rows.shape[1]} columns; allowed are "
            f"{len(HEAD) + ROWS * COLUMNS}; copy it again from the set"
        )
    for column, name, least, most in (
        (rows[:, 0], "participantID", 0, np.inf),
        (rows[:, 1], "gesture", 0, len(GESTURES) - 1),
        (rows[:, len(HEAD) :].ravel(), "a pixel", 0, FULL_SCALE),
    ):
        wrong = (column < least) | (column > most)
        if wrong.any():
            raise ImportSourceError(
                f"{path}: {name} is {column[wrong][0]}; allowed are {least} to {most}; "
                "leave the file out"
            )
    for column, name in ((0, "participantID"), (1, "gesture")):
        found = np.unique(rows[:, column])
        if len(found) > 1:
            raise ImportSourceError(
                f"{path}: {name} is {found[0]} and {found[1]}; allowed is one a file; "
                "split the file"
            )
    same = np.diff(rows[:, 2]) == 0
    late = np.flatnonzero(same & (np.diff(rows[:, 4]) <= 0))
    if len(late):
        number = late[0] + 1
        raise ImportSourceError(
            f"{path}: reading {number} is at {rows[number, 4]} ms, after one at "
            f"{rows[number - 1, 4]} ms; allowed is only later; leave the file out"
        )
