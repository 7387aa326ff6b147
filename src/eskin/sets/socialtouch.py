"""This module converts the SocialTouch dataset (github yliess86/SocialTouch).

Its files state neither units nor geometry nor the year. The conversion assumes a flat
grid of 10 mm, 255 counts = 100 kPa (both nominal), that local time is UTC, and the year
2022, the first in which the dataset's own software could run.

It also says which of the paper's classes a repetition shows.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import ImportSourceError
from eskin.recording.label_check import LabelSet
from eskin.recording.records import NONE, Label, Metadata
from eskin.sets.conversion import (
    CSV_SUFFIX,
    FULL_SCALE_KPA,
    GZIP_SUFFIX,
    ConversionResult,
    ImportedClip,
    find_files,
    read_decompressed,
    write_clips,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

ROWS = 19
COLUMNS = 24
PITCH = 0.010  # [m]
FULL_SCALE = 255
YEAR = 2022
PERIOD_NS = 83_000_000
GAP_NS = 2_000_000_000
"""Gap between two repetitions: as long as the recogniser's window, so that no window
holds two repetitions."""
TOUCHED_COUNTS = 26
"""Counts from which a reading is touched: a tenth of full scale, which three in four
readings exceed and taxels at rest do not reach."""
SUFFIXES = (CSV_SUFFIX, CSV_SUFFIX + GZIP_SUFFIX)
START = r"-(\d+)_(\d+)_(\d+)h_(\d+)m_(\d+)s"
"""End of the name of a file: day, month, hour, minute and second of its start."""
HEAD = ("participantID", "gesture", "repetition", "frameID", "time")
WIDTH = len(HEAD) + ROWS * COLUMNS
HEADER = ",".join((*HEAD, *(f"pixel{n}" for n in range(ROWS * COLUMNS))))

GESTURES = tuple(
    """
    contact_one_hand contact_two_hands finger_touch_short_light
    finger_touch_short_strong finger_touch_long_light finger_touch_long_strong
    poke_short poke_strong pat_short pat_long pinch_vertical pinch_horizontal tap_light
    tap_multiple slap_strong slap_mid hit_side hit_top stroke_leftright stroke_topdown
    stroke_two_once caress_prolonged tickle_one_fix tickle_two_fix tickle_everywhere
    arm_full_everywhere arms_full_everywhere finger_stroke_surface_slow
    finger_stroke_surface_fast tap_tam_tam caress_prolonged_twohands face_hug
    """.split()
)
"""Names by the dataset's numbers, as in `GesturesRated.csv` except for the spelling of
caress."""


@dataclass(frozen=True, eq=False)
class Repetition:
    """One performance of a gesture by a person; a file holds several repetitions."""

    person: int
    """Number of the participant."""
    gesture: str
    """Name of the gesture, one of `GESTURES`."""
    seconds: Float[np.ndarray, "reading"]
    """Time since its first reading [s]; about one reading every 83 ms."""
    counts: Int[np.ndarray, "reading taxel"]
    """Counts from 0 to `FULL_SCALE`, row by row."""

    @property
    def touched(self) -> Bool[np.ndarray, "reading"]:
        """Return which readings are touched."""
        return self.counts.max(axis=1) >= TOUCHED_COUNTS


def convert_socialtouch(
    source: Path | str,
    folder: Path | str,
    pitch: float | None = None,
    full_scale_kpa: float = FULL_SCALE_KPA,
) -> ConversionResult:
    """Convert every file of the SocialTouch dataset to recordings.

    Args:
        source: folder with the dataset's own files, or one of them.
        folder: folder for the recordings, one for each person and gesture.
        pitch: distance of neighbouring taxels [m], which makes the geometry of the
            skin count; the set states none, and None takes a nominal one.
        full_scale_kpa: nominal pressure at full scale [kPa].

    Raises:
        ImportSourceError: a file cannot be converted.
    """
    skin = build_grid_skin(
        ROWS,
        COLUMNS,
        PITCH if pitch is None else pitch,
        name="socialtouch",
        calibrated=pitch is not None,
    )
    calibration = Calibration.uniform(skin.count, FULL_SCALE, full_scale_kpa)
    files = find_files(Path(source), "touch_*", SUFFIXES)
    if not files:
        raise ImportSourceError(
            f"no file in {source} is named touch_*.csv or touch_*.csv.gz; give the "
            "SocialTouch set"
        )
    return write_clips(map(read_socialtouch_file, files), folder, skin, calibration)


def read_socialtouch_file(path: Path) -> ImportedClip:
    """Read one file as a clip of all its repetitions, labelled where touched."""
    start = parse_start(path)
    repetitions = list(read_repetitions(path))
    first = repetitions[0]
    scans: list[Scan] = []
    labels: list[Label] = []
    stamp = int(start.timestamp()) * NS_PER_S
    for repetition in repetitions:
        new = build_scans(repetition, stamp)
        scans += new
        labels += label_touched(repetition, new)
        stamp = new[-1].stamp + GAP_NS
    subject = f"P{first.person}"
    session = f"{subject}-{start:%Y%m%d}"
    notes = {"source_file": path.name, "repetitions": str(len(repetitions))}
    metadata = Metadata("socialtouch", subject, session, "socialtouch", notes)
    name = f"{first.gesture}_{subject}_{start:%Y%m%d_%H%M%S}"
    label_set = LabelSet(path, tuple(labels), scans[0].stamp, scans[-1].stamp)
    return ImportedClip(name, metadata, tuple(scans), label_set)


def parse_start(path: Path) -> datetime:
    """Return the start of a file, from day, month and time in its name."""
    found = re.search(START + re.escape(CSV_SUFFIX), path.name)
    try:
        day, month, *clock = [int(n) for n in found.groups()] if found else []
        return datetime(YEAR, month, day, *clock, tzinfo=UTC)
    except ValueError:
        raise ImportSourceError(
            f"{path}: name holds no day, month and time such as -20_4_17h_5m_23s; "
            "name it as in the set"
        ) from None


def build_scans(repetition: Repetition, start: int) -> list[Scan]:
    """Build the scans of a repetition, the first at `start` [ns since the epoch]."""
    received = np.ones(ROWS * COLUMNS, dtype=np.bool_)
    stamps = start + np.rint(repetition.seconds * 1e9).astype(np.int64)
    return [
        Scan(int(stamp), counts, received, np.empty(0))
        for stamp, counts in zip(stamps, repetition.counts, strict=True)
    ]


def label_touched(repetition: Repetition, scans: list[Scan]) -> list[Label]:
    """Label a repetition from its first to its last touched reading, if any."""
    touched = np.flatnonzero(repetition.touched)
    if not len(touched):
        return []
    stamps = [scan.stamp for scan in scans] + [scans[-1].stamp + PERIOD_NS]
    start, end = stamps[touched[0]], stamps[touched[-1] + 1]
    return [Label(start, end, repetition.gesture)]


def read_repetitions(path: Path) -> Iterator[Repetition]:
    """Read the repetitions of one file, in order."""
    rows = load_rows(path)
    breaks = np.flatnonzero(np.diff(rows[:, 2])) + 1
    for part in np.split(rows, breaks):
        seconds = (part[:, 4] - part[0, 4]) * 1e-3
        counts = part[:, len(HEAD) :].astype(np.int32)
        yield Repetition(int(part[0, 0]), GESTURES[part[0, 1]], seconds, counts)


def load_rows(path: Path) -> Int[np.ndarray, "reading column"]:
    """Load and check all rows of a file."""
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
        rows = np.loadtxt(body.splitlines(), np.int64, None, ",", ndmin=2)
    except ValueError as error:
        raise ImportSourceError(
            f"{path}: not whole numbers in {WIDTH} columns ({error}); copy it again "
            "from the set"
        ) from error
    check_rows(path, rows)
    return rows


def load_text(path: Path) -> str:
    """Load the text of a file, gzipped or not."""
    try:
        return read_decompressed(path).decode()
    except ValueError as error:
        raise ImportSourceError(
            f"{path}: not whole text ({error}); copy it again from the set"
        ) from error


def check_rows(path: Path, rows: Int[np.ndarray, "reading column"]) -> None:
    """Raise unless a file's rows are valid and of one person and one gesture."""
    if rows.shape[1] != WIDTH:
        raise ImportSourceError(
            f"{path}: rows have {rows.shape[1]} columns; allowed are {WIDTH}; copy it "
            "again from the set"
        )
    check_range(path, "participantID", rows[:, 0], np.iinfo(np.int64).max)
    check_range(path, "gesture", rows[:, 1], len(GESTURES) - 1)
    check_range(path, "a pixel", rows[:, len(HEAD) :].ravel(), FULL_SCALE)
    for name, column in (("participantID", rows[:, 0]), ("gesture", rows[:, 1])):
        if np.ptp(column):
            raise ImportSourceError(
                f"{path}: {name} is {column.min()} and {column.max()}; allowed is one "
                "a file"
            )
    check_times(path, rows[:, 2], rows[:, 4])


def check_range(
    path: Path, name: str, values: Int[np.ndarray, "value"], limit: int
) -> None:
    """Raise if values are not from 0 to `limit`."""
    wrong = values[(values < 0) | (values > limit)]
    if len(wrong):
        raise ImportSourceError(
            f"{path}: {name} is {wrong[0]}; allowed are 0 to {limit}; leave it out"
        )


def check_times(
    path: Path,
    repetitions: Int[np.ndarray, "reading"],
    times: Int[np.ndarray, "reading"],
) -> None:
    """Raise if time [ms] does not increase within a repetition."""
    late = np.flatnonzero((np.diff(repetitions) == 0) & (np.diff(times) <= 0))
    if len(late):
        before, after = times[late[0] : late[0] + 2]
        raise ImportSourceError(
            f"{path}: in repetition {repetitions[late[0]]} a reading at {before} ms is "
            f"followed by one at {after} ms; allowed is only later; leave the file out"
        )


GROUP_NUMBERS = {
    "contact": (0, 1),
    "finger touch": (2, 3, 4, 5),
    "poke": (6, 7),
    "pat": (8, 9),
    "pinch": (10, 11),
    "tap": (12, 13, 29),
    "hit": (14, 15, 16, 17),
    "stroke": (18, 19, 20, 27, 28),
    "caress": (21, 30),
    "tickle": (22, 23, 24),
    "arm": (25, 26),
    "hug": (31,),
}
GROUPS = {
    name: tuple(GESTURES[number] for number in numbers)
    for name, numbers in GROUP_NUMBERS.items()
}
"""Gestures that are variants of one another, by the name of their group."""

HELD = 1.3
"""Duration from which a touch of a finger is held rather than a poke [s]."""

VALLEY = 0.5
"""Share of the lower of two peaks of force below which two presses are separate."""

LEAST_PRESS = 0.25
"""Share of the strongest press below which a rise of force is no press."""


def find_group(gesture: str) -> str:
    """Return the group of a gesture."""
    return next(name for name, gestures in GROUPS.items() if gesture in gestures)


def classify_repetition(repetition: Repetition) -> str | None:
    """Return the class of a repetition; None without one, or without contact."""
    touched = repetition.seconds[repetition.touched]
    if not len(touched):
        return None
    match find_group(repetition.gesture):
        case "poke":
            return "poke"
        case "stroke":
            return "stroke"
        case "contact" | "arm":
            return NONE
        case "finger touch":
            return NONE if np.ptp(touched) >= HELD else None
        case "pat":
            total = repetition.counts.sum(axis=1).astype(np.float64)
            return "double_pat" if count_presses(total) > 1 else NONE
    return None


def count_presses(force: Float[np.ndarray, "reading"]) -> int:
    """Count the presses in a series of forces, with low forces between them."""
    # Importing it takes as long as all else that the simulator imports.
    from scipy.signal import find_peaks, peak_prominences

    if force.max(initial=0.0) <= 0.0:
        return 0
    # Of equal peaks the later one counts as higher, so that one of them is the lower.
    padded = np.pad(force + 1e-9 * np.arange(len(force)), 1)
    peaks, _ = find_peaks(padded, height=LEAST_PRESS * force.max())
    prominences, _, _ = peak_prominences(padded, peaks)
    return int((prominences > (1 - VALLEY) * padded[peaks]).sum())
