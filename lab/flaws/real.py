"""Count touches and detections in untouched stretches of real recordings.

    python -m lab.flaws real                    # all three sets
    python -m lab.flaws real --sets shearsense  # the quickest

The recordings are played to the recogniser as they are, in whole, with the pitch and
full scale that their conversion states: without a floor, and with one of 12.5 % of full
scale. Counted are only untouched stretches: instants of the sleeve that are labelled as
none, recordings of ShearSense without touch (`no`), and frames of SocialTouch in which
at most two taxels reach a tenth of full scale; each at least 0.3 s from all others. A
touch counts where it is first shown in such a stretch, a detection (any word) where its
touch began in one.
"""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from eskin.live import Recognizer, load_model
from eskin.recording import (
    NONE,
    Recording,
    find_recordings,
    read_recording,
)
from eskin.sets import (
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
)
from eskin.sets.socialtouch import TOUCHED_COUNTS
from eskin.skin import mount_skin
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.flaws.scoring import RestCount, Watcher
from lab.tables import format_head, format_row

FLOORS = (0.0, 0.125)
"""Floors, by full scale."""
MARGIN = round(0.3 * NS_PER_S)
"""Least time from a touched instant to one that counts [ns]."""
LONGEST = round(0.5 * NS_PER_S)
"""Longest time between two scans that counts [ns]."""
SINGLE = 2
"""Largest number of taxels that are off in a frame that shows nothing."""


def find_labelled_none(
    recording: Recording, scans: list[Scan]
) -> Bool[np.ndarray, "scan"]:
    """Tell which scans have no label of a touch."""
    stamps = np.array([scan.stamp for scan in scans])
    found = np.ones(len(stamps), bool)
    for label in recording.labels:
        if label.gesture != NONE:
            found &= (stamps < label.start) | (stamps >= label.end)
    return found


def find_blank(recording: Recording, scans: list[Scan]) -> Bool[np.ndarray, "scan"]:
    """Tell which scans show nothing, except for single taxels."""
    over = [int(np.sum(scan.counts >= TOUCHED_COUNTS)) for scan in scans]
    return np.array(over) <= SINGLE


@dataclass(frozen=True)
class RealSet:
    """Describes a set of recordings and what of it is untouched."""

    convert: Callable[[Path, Path], object]
    """Function that converts the files of a folder to recordings."""
    untouched: Callable[[Recording, list[Scan]], Bool[np.ndarray, "scan"]]
    """Function that tells which scans are untouched."""
    only: str = "*"
    """Pattern of the names of recordings that are played."""


SETS = {
    "sleeve": RealSet(convert_sleeve, find_labelled_none),
    "shearsense": RealSet(convert_shearsense, find_labelled_none, "no_*"),
    "socialtouch": RealSet(convert_socialtouch, find_blank),
}


@dataclass(frozen=True)
class Command:
    """Count touches and detections in untouched stretches of real recordings."""

    data: Path = Path("../shared/data")
    """Folder with one folder for each set, as downloaded."""
    sets: tuple[str, ...] = tuple(SETS)
    """Sets to play."""
    model: str = "ur5"
    """Weights that come with eskin, or a model file."""
    workers: int = 2
    """Number of processes."""


def keep_apart(
    stamps: Int[np.ndarray, "scan"], untouched: Bool[np.ndarray, "scan"]
) -> Bool[np.ndarray, "scan"]:
    """Return which untouched scans are well apart from all others."""
    touched = stamps[~untouched]
    if not len(touched):
        return untouched
    after = np.searchsorted(touched, stamps)
    to_last = stamps - touched[np.maximum(after - 1, 0)]
    to_next = touched[np.minimum(after, len(touched) - 1)] - stamps
    near_last = (after > 0) & (to_last < MARGIN)
    near_next = (after < len(touched)) & (to_next < MARGIN)
    return untouched & ~near_last & ~near_next


def count_untouched(
    path: Path, kind: str, floor: float, model: str
) -> tuple[RestCount, int]:
    """Play a recording; return the counts of its untouched part, and its stretches."""
    recording = read_recording(path)
    scans = list(recording.scans())
    stamps = np.array([scan.stamp for scan in scans])
    counted = keep_apart(stamps, SETS[kind].untouched(recording, scans))
    calibration = recording.calibration
    full = float(calibration.gain.max()) * calibration.full_scale
    mounted = mount_skin(recording.skin, recording.robot_name)
    recognizer = Recognizer(
        load_model(model), mounted, replace(calibration, floor=floor * full)
    )
    watcher = Watcher(recognizer)
    count = RestCount()
    ignored = RestCount()
    found = []
    last = int(stamps[0])
    for scan, counts in zip(scans, counted, strict=True):
        watcher.rest = count if counts and scan.stamp - last <= LONGEST else ignored
        last = scan.stamp
        found += watcher.push(scan)
    # A detection counts where its touch began, not where it is reported.
    found += recognizer.finish()
    places = np.searchsorted(stamps, [one.onset for one in found])
    count.detections = int(counted[np.minimum(places, len(stamps) - 1)].sum())
    stretches = int(np.sum(np.diff(np.append(False, counted).astype(int)) == 1))
    return count, stretches


def print_set(kind: str, command: Command, paths: tuple[Path, ...]) -> None:
    """Print the rows of a set, one for each floor."""
    for floor in FLOORS:
        total = RestCount()
        stretches = 0
        work = partial(count_untouched, kind=kind, floor=floor, model=command.model)
        with get_context("spawn").Pool(command.workers) as pool:
            for count, number in pool.imap_unordered(work, paths):
                total.add_counts(count)
                stretches += number
        cells = [
            kind,
            f"{100 * floor:g} %",
            f"{total.rate(total.openings):.0f}",
            f"{total.rate(total.detections):.0f}",
            f"{100 * total.open_seconds / total.seconds:.1f} %",
            f"{total.seconds / 60:.1f}",
            str(stretches),
        ]
        print(format_row(cells), flush=True)


HEAD = (
    "set",
    "floor",
    "openings an hour",
    "detections an hour",
    "time with an open touch",
    "minutes",
    "stretches",
)


def find_paths(folder: Path, kind: str) -> Iterator[Path]:
    """Yield the recordings of a set that are played."""
    for path in find_recordings((folder,)):
        if path.match(SETS[kind].only):
            yield path


def main(command: Command) -> None:
    """Print the table."""
    print(format_head(HEAD))
    for kind in command.sets:
        with tempfile.TemporaryDirectory() as folder:
            SETS[kind].convert(command.data / kind, Path(folder))
            print_set(kind, command, tuple(find_paths(Path(folder), kind)))
