"""This module reads recorded touches of people, and places them on a robot's skin.

They are pressure movies of the public SocialTouch set. Its sensor states neither units
nor geometry, so its pitch and its full scale are drawn anew for each touch. Strokes and
held fingertips are also read from CapFingerId, a public set of capacitance on a phone's
screen.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Bool, Float

from eskin.errors import GenerationError, ImportSourceError
from eskin.recording import NONE
from eskin.sets.conversion import NPZ_SUFFIX, find_files
from eskin.sets.socialtouch import (
    COLUMNS,
    FULL_SCALE,
    GROUPS,
    HELD,
    SUFFIXES,
    TOUCHED_COUNTS,
    Repetition,
    classify_repetition,
    find_group,
    read_repetitions,
)
from eskin.sim.constants import MM, Constants
from eskin.sim.contact.press import ContactSite, MoviePress, TrueTouch
from eskin.sim.contact.pressure import compute_movie_force, find_middle

RECORDED_CLASSES = ("poke", "double_pat", "stroke", "none")
"""Classes that recorded touches show; nobody grabbed that flat sensor."""

MANY_TOUCHES = 20
"""Touches from which a group of gestures is drawn as often as a larger one."""


@dataclass(frozen=True)
class RecordedPeople:
    """Recorded people are some participants of a folder of recorded touches."""

    folder: Path
    """Folder of the SocialTouch set."""
    people: tuple[int, ...]
    """Numbers of the participants, ascending."""
    digest: str
    """SHA-256 of their touches."""
    grouped: bool = False
    """Whether classes are the groups of gestures, instead of `RECORDED_CLASSES`."""
    classes: tuple[str, ...] = RECORDED_CLASSES
    """Classes that all of them show."""

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the participants in recordings."""
        return tuple(map(name_person, self.people))


@dataclass(frozen=True, eq=False)
class RecordedTouch:
    """A recorded touch is one repetition of a gesture, with its class."""

    gesture: str
    """Class, one of `RECORDED_CLASSES`, or the group."""
    group: str
    """Group of its gesture in the SocialTouch set."""
    number: int
    """Number of the touch among the touches of the folder with such a class."""
    repetition: Repetition
    """Readings of the touch."""
    columns: int = COLUMNS
    """Columns of the sensor."""
    pitch: tuple[float, float] | None = None
    """Smallest and largest distance of taxels [m]; None where nothing states it."""


def name_person(number: int) -> str:
    """Return the name of a participant, as in converted recordings."""
    return f"P{number}"


def find_recorded_people(
    folder: Path,
    people: Sequence[int] | None = None,
    grouped: bool = False,
    needed: Sequence[str] | None = None,
) -> RecordedPeople:
    """Find participants of a public set in a folder; all unless some are named.

    Where `grouped`, the classes are the groups of gestures. Each participant must show
    the classes `needed`, by default all.

    Raises:
        ImportSourceError: a file of the set cannot be read.
        GenerationError: a participant is missing, or shows not all classes.
    """
    touches = read_recorded_touches(folder, grouped)
    known = sorted({touch.repetition.person for touch in touches})
    wanted = known if people is None else sorted(set(people))
    missing = sorted(set(wanted) - set(known))
    if missing or not wanted:
        raise GenerationError(
            f"{folder} has no recorded touches of participant "
            f"{', '.join(map(str, missing)) or 'any'}; allowed are "
            f"{', '.join(map(str, known)) or 'folders of the SocialTouch set'}; change "
            "--people or --recorded"
        )
    digest = sha256()
    classes = tuple(GROUPS) if grouped else RECORDED_CLASSES
    needed = classes if needed is None else needed
    for person in wanted:
        mine = [touch for touch in touches if touch.repetition.person == person]
        shown = {touch.gesture for touch in mine}
        classes = tuple(name for name in classes if name in shown)
        unshown = sorted(set(needed) - shown)
        if unshown:
            raise GenerationError(
                f"{folder} has no {', '.join(unshown)} of participant {person}; "
                "allowed are participants with all gestures; copy all of their files"
            )
        for touch in mine:
            digest.update(f"{person} {touch.repetition.gesture}".encode())
            digest.update(touch.repetition.seconds.tobytes())
            digest.update(touch.repetition.counts.tobytes())
    return RecordedPeople(folder, tuple(wanted), digest.hexdigest(), grouped, classes)


@lru_cache(maxsize=1)
def read_recorded_touches(
    folder: Path, grouped: bool = False
) -> tuple[RecordedTouch, ...]:
    """Read all touches of a folder that show one of the classes, cached."""
    found: list[RecordedTouch] = []
    for path in find_files(folder, "touch_*", SUFFIXES):
        for repetition in read_repetitions(path):
            gesture = classify_repetition(repetition)
            if grouped and repetition.touched.any():
                gesture = find_group(repetition.gesture)
            if gesture is not None:
                group = find_group(repetition.gesture)
                found.append(RecordedTouch(gesture, group, len(found), repetition))
    if folder.is_dir():
        for path in find_files(folder, "P[0-9]*", (NPZ_SUFFIX,)):
            found += read_phone_touches(path, len(found))
    return tuple(found)


PHONE_COLUMNS = 15
PHONE_PITCH = 0.0041
"""Columns of the screen of CapFingerId, and their distance [m]."""

SHORTEST_STROKE = 0.025
"""Travel of a finger on the screen from which it strokes [m]."""


def read_phone_touches(path: Path, first: int) -> list[RecordedTouch]:
    """Read the strokes and held fingertips of a participant of CapFingerId.

    Touches are numbered from `first`. Left out are trials in which the finger leaves
    the screen, strokes over less than `SHORTEST_STROKE` and fingertips held less than
    `HELD`.
    """
    found: list[RecordedTouch] = []
    try:
        person = int(path.stem.removeprefix("P"))
        with np.load(path) as file:
            frames = file["frames"]
            trials = file["trial"]
            rate = float(file["rate"])
            labels = file["labels"].tolist()
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise ImportSourceError(
            f"{path}: no participant of CapFingerId ({error}); copy it again from the "
            "set"
        ) from error
    for trial, label in enumerate(labels):
        counts = frames[trials == trial].astype(np.int32)
        seconds = np.arange(len(counts)) / rate
        name = str(label)
        repetition = Repetition(person, name, seconds, counts.reshape(len(counts), -1))
        touched = np.flatnonzero(repetition.touched)
        if name == "pause" or not len(touched) or np.diff(touched).max(initial=1) > 2:
            continue
        pressed = np.where(counts >= TOUCHED_COUNTS, counts, 0.0)[touched]
        travel = PHONE_PITCH * float(np.hypot(*np.ptp(find_middle(pressed), axis=0)))
        held = name == "tap"
        gesture = NONE if held else "stroke"
        if held and np.ptp(seconds[touched]) < HELD:
            continue
        if held != (travel < SHORTEST_STROKE):
            continue
        pitch = PHONE_PITCH * 0.85, PHONE_PITCH * 1.2
        number = first + len(found)
        found.append(
            RecordedTouch(gesture, name, number, repetition, PHONE_COLUMNS, pitch)
        )
    return found


def draw_recorded_touch(
    touches: Sequence[RecordedTouch],
    person: str,
    gesture: str,
    rng: np.random.Generator,
) -> RecordedTouch:
    """Draw a touch of a person and class, evenly over the groups of its gestures.

    Groups with few touches are drawn less often, so that no touch comes up too often.
    """
    fitting = [
        touch
        for touch in touches
        if touch.gesture == gesture and name_person(touch.repetition.person) == person
    ]
    sizes = Counter(touch.group for touch in fitting)
    weights = np.minimum(list(sizes.values()), MANY_TOUCHES)
    group = rng.choice(list(sizes), p=weights / weights.sum())
    members = [touch for touch in fitting if touch.group == group]
    return members[rng.integers(len(members))]


def play_recorded_touch(
    touch: RecordedTouch,
    site: ContactSite,
    constants: Constants,
    rng: np.random.Generator,
) -> TrueTouch:
    """Play a recorded touch at a site, in a drawn size, strength, speed and turn."""
    low, high = touch.pitch or constants.array("recorded.pitch") * MM
    pitch = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    full_scale = draw_log_uniform(constants, "recorded.full_scale", rng)
    speed = float(rng.uniform(*constants.array("recorded.speed")))
    turn = float(rng.uniform(-np.pi, np.pi))
    mirrored = bool(rng.random() < 0.5)
    clean = rng.random() < constants.value("recorded.clean")
    threshold = clean * float(rng.uniform(0.0, constants.value("recorded.threshold")))
    movie, touched = sample_movie(touch.repetition, speed, constants, touch.columns)
    if mirrored:
        movie = movie[:, :, ::-1]
    pressure = full_scale * np.maximum(movie - threshold, 0.0)
    force = np.where(touched, compute_movie_force(pressure, pitch), 0.0)
    in_contact = pressure[force > 0.0].sum(axis=0)
    row, column = find_middle(in_contact)
    press = MoviePress(
        chart=site.chart,
        first=0,
        pressure=pressure,
        pitch=pitch,
        middle=(float(row), float(column)),
        force=force,
        centre=np.tile(np.array(site.centre), (len(force), 1)),
        angle=np.full(len(force), turn),
    )
    drawn: dict[str, float | str] = {
        "recorded": float(touch.number),
        "pitch": pitch,
        "full_scale": full_scale,
        "speed": speed,
        "turn": turn,
        "mirrored": float(mirrored),
        "threshold": threshold,
        "began_before": 0.0,
    }
    subject = name_person(touch.repetition.person)
    return TrueTouch(touch.gesture, touch.repetition.gesture, subject, (press,), drawn)


def draw_log_uniform(
    constants: Constants, name: str, rng: np.random.Generator
) -> float:
    """Draw a number between the two of a constant, its logarithm uniform."""
    return float(np.exp(rng.uniform(*np.log(constants.array(name)))))


def sample_movie(
    repetition: Repetition,
    speed: float,
    constants: Constants,
    columns: int = COLUMNS,
) -> tuple[Float[np.ndarray, "time row column"], Bool[np.ndarray, "time"]]:
    """Return the pressure of a repetition at each step, and whether it is touched.

    Pressure is a share of full scale. What is far from the contact in time is left out;
    the rest begins and ends with a rise from zero, and a fall to zero, in a reading.
    """
    times = repetition.seconds
    around = constants.value("recorded.around")
    first, last = times[repetition.touched][[0, -1]]
    kept = (times >= first - around) & (times <= last + around)
    period = float(np.median(np.diff(times)))
    known = times[kept]
    known = np.array([known[0] - period, *known, known[-1] + period])
    shares = np.pad(repetition.counts[kept] / FULL_SCALE, ((1, 1), (0, 0)))
    step = constants.value("time.step") * speed
    at = np.arange(known[0], known[-1], step)
    before = np.searchsorted(known, at, "right") - 1
    part = ((at - known[before]) / np.diff(known)[before])[:, None]
    between = (1 - part) * shares[before] + part * shares[before + 1]
    touched = between.max(axis=1) >= TOUCHED_COUNTS / FULL_SCALE
    return between.reshape(len(between), -1, columns), touched
