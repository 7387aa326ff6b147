"""This module reads repetitions of gestures of public sets, with their classes.

To add a set, write a function that reads its trials and add an entry to `SETS`.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import RecordingError
from eskin.recording import NONE
from eskin.sets import shearsense, sleeve
from eskin.sets import socialtouch as social
from eskin.sets.conversion import (
    FULL_SCALE_KPA,
    ImportedClip,
    find_files,
)
from eskin.sets.socialtouch import GROUPS, HELD
from eskin.sim.people.recorded import (
    PHONE_COLUMNS,
    PHONE_PITCH,
    read_phone_touches,
)
from eskin.units import NS_PER_S

TOUCHED = social.TOUCHED_COUNTS / social.FULL_SCALE
"""Share of full scale from which a reading counts as touched."""

LONGEST = 2.0
"""Greatest duration of a trial that is cut from a longer recording [s]."""

PAUSE = 0.5
"""Shortest pause between two trials of one recording, as that which ends a touch
[s]."""

FAINT = 0.03
PART = 0.2
"""Share of full scale, and of the peak of the recording, above which ShearSense is
touched."""


@dataclass(frozen=True)
class Group:
    """Groups gestures of a set that have the same true class."""

    name: str
    """Name in the tables."""
    gestures: tuple[str, ...]
    """Names in the set."""
    truth: str | None = None
    """True class; None without one."""
    longer: float = 0.0
    """Shortest duration of contact of a counted trial [s]."""
    shorter: float = math.inf
    """Upper limit of the duration of contact [s]."""


@dataclass(frozen=True, eq=False)
class Trial:
    """Holds one repetition of one gesture."""

    subject: str
    """Name of the person."""
    gesture: str
    """Name in the set."""
    seconds: Float[np.ndarray, "reading"]
    """Times of the readings, increasing [s]."""
    share: Float[np.ndarray, "reading taxel"]
    """Pressure as a share of full scale, row by row; 0 at rest."""


@dataclass(frozen=True)
class PublicSet:
    """Describes a public set and the classes of its gestures."""

    folder: Path
    """Default folder."""
    rows: int
    """Rows of its grid."""
    columns: int
    """Columns of its grid."""
    trials: Callable[[Path], Iterator[Trial]]
    """Function that reads the repetitions in a folder."""
    groups: tuple[Group, ...]
    """Groups of gestures, in the order of the tables."""
    pitch_mm: float
    """Assumed distance of neighbouring taxels [mm]; no set states it."""
    full_scale_kpa: float
    """Assumed pressure at full scale [kPa]; no set states it."""
    floor: float = 0.0
    """Share of full scale below which a signal is not a touch."""


def read_trials(
    public: PublicSet, folder: Path, people: Collection[str] = ()
) -> list[Trial]:
    """Read the trials of some people, or of all, that belong to a group.

    Raises:
        RecordingError: one of the people is not in the set.
    """
    wanted = {gesture for group in public.groups for gesture in group.gestures}
    trials = [trial for trial in public.trials(folder) if trial.gesture in wanted]
    subjects = {trial.subject for trial in trials}
    if unknown := set(people) - subjects:
        raise RecordingError(
            f"no person {', '.join(sorted(unknown))} in {folder}; allowed are "
            f"{', '.join(sorted(subjects))}"
        )
    return [trial for trial in trials if trial.subject in (people or subjects)]


def read_socialtouch(folder: Path) -> Iterator[Trial]:
    """Read the repetitions of the SocialTouch set."""
    for path in find_files(folder, "touch_*", social.SUFFIXES):
        for found in social.read_repetitions(path):
            share = found.counts / social.FULL_SCALE
            yield Trial(f"P{found.person}", found.gesture, found.seconds, share)


def read_phone(folder: Path) -> Iterator[Trial]:
    """Read the strokes and the held fingertips of CapFingerId."""
    for path in find_files(folder, "P[0-9]*", (".npz",)):
        for touch in read_phone_touches(path, 0):
            found = touch.repetition
            share = found.counts / social.FULL_SCALE
            yield Trial(path.stem, found.gesture, found.seconds, share)


def read_shearsense(folder: Path) -> Iterator[Trial]:
    """Read the contacts in the recordings of the ShearSense set, without their shear.

    A recording is of one gesture that is repeated for 12 s. A trial lasts until a
    pause, at most two seconds. Recordings without touch are cut likewise.
    """
    for path in shearsense.find_shearsense_files(folder):
        clip = shearsense.read_shearsense_file(path)
        seconds, share = read_shares(clip, shearsense.FULL_SCALE)
        [label] = clip.label_set.labels
        peak = share.max(axis=1)
        touched = peak >= max(FAINT, PART * float(np.quantile(peak, 0.98)))
        rows = np.flatnonzero(touched | (label.gesture == NONE))
        for run in cut_runs(rows, seconds):
            yield Trial(
                clip.metadata.subject,
                label.gesture,
                seconds[run],
                share[run],
            )


def cut_runs(
    rows: Int[np.ndarray, "row"], seconds: Float[np.ndarray, "reading"]
) -> list[Int[np.ndarray, "run"]]:
    """Cut rows at pauses, and into parts of two seconds; return those of two or more.

    Args:
        rows: increasing indices of readings.
        seconds: times of the readings [s].
    """
    starts = np.flatnonzero(np.diff(seconds[rows]) >= PAUSE) + 1
    parts = []
    for run in np.split(rows, starts):
        number = (seconds[run] - seconds[run[:1]]) // LONGEST
        parts += np.split(run, np.flatnonzero(np.diff(number)) + 1)
    return [part for part in parts if len(part) > 1]


def read_sleeve(folder: Path) -> Iterator[Trial]:
    """Read the labelled runs of the sleeve set, and those between them, cut likewise.

    Its people are not known; the subject is the session. The sleeve presses where it
    is worn: what each taxel reads in the median of the instants without label is
    subtracted.
    """
    files = find_files(folder, "*", sleeve.SUFFIXES)
    found = sorted((sleeve.find_start(path), path) for path in files)
    sessions = sleeve.name_sessions([time for time, _ in found])
    for (time, path), session in zip(found, sessions, strict=True):
        clip = sleeve.read_sleeve_file(path, time, session)
        seconds, share = read_shares(clip, sleeve.FULL_SCALE)
        stamps = np.array([scan.stamp for scan in clip.scans])
        runs = [
            (
                label.gesture,
                np.arange(*np.searchsorted(stamps, [label.start, label.end])),
            )
            for label in clip.label_set.labels
            if label.gesture != NONE
        ]
        idle = np.arange(len(stamps))
        for _, run in runs:
            idle = np.setdiff1d(idle, run)
        share = np.maximum(share - np.median(share[idle], axis=0), 0.0)
        runs += [(NONE, run) for run in cut_runs(idle, seconds)]
        for gesture, run in runs:
            if len(run) > 1:
                yield Trial(session, gesture, seconds[run], share[run])


def read_shares(
    clip: ImportedClip, full_scale: int
) -> tuple[Float[np.ndarray, "reading"], Float[np.ndarray, "reading taxel"]]:
    """Return times [s] and pressures, as shares of full scale, of the readings."""
    stamps = np.array([scan.stamp for scan in clip.scans])
    counts = np.stack([scan.counts for scan in clip.scans])
    return (stamps - stamps[0]) / NS_PER_S, counts / full_scale


def group_shearsense() -> tuple[Group, ...]:
    """Group the 18 gestures of ShearSense by their true class."""
    truths = {
        "poke": "poke",
        "pat": "double_pat",
        "slide": "stroke",
        "drag": "stroke",
        "outward_caress": "stroke",
        "constant": NONE,
        NONE: NONE,
    }
    others = "pinch press tap karate fist knead massage rub scratch twist type"
    return group_single(truths, others.split())


def group_sleeve() -> tuple[Group, ...]:
    """Group the gestures of the sleeve by their true class."""
    truths = {"stroke": "stroke", "grab": "grab", "squeeze": "grab", NONE: NONE}
    return group_single(truths, ["tap", "punch", "hug", "tickle"])


def group_single(truths: Mapping[str, str], others: Sequence[str]) -> tuple[Group, ...]:
    """Return a group of each gesture alone, with its true class or without one."""
    names = (*truths, *others)
    return tuple(Group(name, (name,), truths.get(name)) for name in names)


def group_socialtouch() -> tuple[Group, ...]:
    """Group the 32 gestures of SocialTouch by their true class."""
    fingers = GROUPS["finger touch"]
    resting = (*GROUPS["contact"], *GROUPS["arm"])
    return (
        Group("poke", GROUPS["poke"], "poke"),
        Group("stroke", GROUPS["stroke"], "stroke"),
        Group("resting hand or arm", resting, NONE),
        Group(f"finger held, {HELD:g} s or longer", fingers, NONE, longer=HELD),
        Group("finger touch, shorter", fingers, shorter=HELD),
        Group("pat", GROUPS["pat"], "double_pat"),
        Group("tap", GROUPS["tap"]),
        Group("slap, hit", GROUPS["hit"]),
        Group("pinch", GROUPS["pinch"]),
        Group("caress", GROUPS["caress"]),
        Group("tickle", GROUPS["tickle"]),
        Group("hug", GROUPS["hug"]),
    )


SOCIALTOUCH = PublicSet(
    folder=Path("../shared/data/socialtouch"),
    rows=social.ROWS,
    columns=social.COLUMNS,
    trials=read_socialtouch,
    groups=group_socialtouch(),
    pitch_mm=4.0,
    full_scale_kpa=40.0,
)
SETS = {
    "socialtouch": SOCIALTOUCH,
    "socialtouch-groups": replace(
        SOCIALTOUCH,
        groups=tuple(Group(name, of_it, name) for name, of_it in GROUPS.items()),
    ),
    "phone": PublicSet(
        folder=Path("../shared/data/capfingerid"),
        rows=27,
        columns=PHONE_COLUMNS,
        trials=read_phone,
        groups=(
            Group("stroke over 25 mm", ("scroll", "drag"), "stroke"),
            Group("fingertip held", ("tap",), NONE),
        ),
        pitch_mm=1000 * PHONE_PITCH,
        full_scale_kpa=40.0,
    ),
    "shearsense": PublicSet(
        folder=Path("../shared/data/shearsense"),
        rows=shearsense.SIDE,
        columns=shearsense.SIDE,
        trials=read_shearsense,
        groups=group_shearsense(),
        pitch_mm=10.0,
        full_scale_kpa=FULL_SCALE_KPA,
    ),
    "sleeve": PublicSet(
        folder=Path("../shared/data/sleeve"),
        rows=sleeve.ROWS,
        columns=sleeve.COLUMNS,
        trials=read_sleeve,
        groups=group_sleeve(),
        pitch_mm=10.0,
        full_scale_kpa=FULL_SCALE_KPA,
        floor=sleeve.FLOOR_KPA / FULL_SCALE_KPA,
    ),
}
"""Public sets by name."""
