"""This module defines what a recording stores besides its scans, labels among it."""

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Int

from eskin.errors import RecordingError
from eskin.files import MAX_YAML_BYTES, load_plain_yaml, read_file, shorten
from eskin.units import NS_PER_S

RECORD_NAME = "eskin"
SKIN_NAME = "skin"
CALIBRATION_NAME = "calibration.json"
"""Name of a skin's calibration, in a recording and beside its `skin.yaml`."""
FORMAT = "1"
NOTE = "note."
PARTLY_LABELLED = {"labels": "corrections"}
"""Notes of a recording in which only some touches have labels: those that a person has
corrected. Of the others it is not known that they were no gesture."""


@dataclass(frozen=True)
class Metadata:
    """Metadata describe the origin of a recording; empty text means unknown."""

    dataset: str = ""
    """Name of the dataset that the recording belongs to."""
    subject: str = ""
    """Name of the person who touched the skin."""
    session: str = ""
    """Name of the session; recordings of one session belong in one fold."""
    gesture_set: str = ""
    """Name of the vocabulary of the labels."""
    notes: dict[str, str] = field(default_factory=dict)
    """Other facts by name."""

    @property
    def simulated(self) -> bool:
        """Return whether `eskin generate` made it, so that its truth is known."""
        return self.notes.get("simulated") == "true"

    @property
    def partly_labelled(self) -> bool:
        """Return whether touches without a label may have been gestures, too."""
        return PARTLY_LABELLED.items() <= self.notes.items()

    def to_record(self) -> dict[str, str]:
        """Return the flat map of strings that an MCAP metadata record holds."""
        facts = {key: value for key, value in asdict(self).items() if key != "notes"}
        return facts | {NOTE + key: self.notes[key] for key in sorted(self.notes)}

    @classmethod
    def from_record(cls, record: dict[str, str]) -> "Metadata":
        """Build metadata from such a map; ignore other keys."""
        keys = ("dataset", "subject", "session", "gesture_set")
        notes = {k.removeprefix(NOTE): record[k] for k in record if k.startswith(NOTE)}
        return cls(*(record.get(key, "") for key in keys), notes=notes)


Vector = tuple[float, float, float]


@dataclass(frozen=True)
class DetectionRecord:
    """A detection as a recording stores it."""

    stamp: int
    """Time of the detection [ns since the epoch]."""
    gesture: str
    """Name of the gesture."""
    confidence: float
    """Calibrated probability."""
    onset: int
    """First reading of the touch [ns since the epoch]."""
    end: int
    """Last reading of the touch so far [ns since the epoch]."""
    link: str
    """Link with the largest share of the touch."""
    patch: str
    """Patch with the largest share of the touch."""
    p_world: Vector
    """Force-weighted centre [m]."""
    n_world: Vector
    """Mean outward unit normal."""
    direction_world: Vector
    """Unit direction of travel; zero if the touch did not move."""
    peak_force: float
    """Largest force of the touch [N]."""


@dataclass(frozen=True)
class EventRecord:
    """An event of the skin or a part of it as a recording stores it."""

    stamp: int
    """Time at which it was noticed [ns since the epoch]."""
    kind: str
    """Kind of event, as in `eskin.drivers.Event`."""
    text: str
    """Description as a sentence."""
    patch: str | None = None
    """Name of the patch, if it concerns one."""
    row: int | None = None
    """Row in the patch, if it concerns a row or a taxel."""
    column: int | None = None
    """Column in the patch, if it concerns a column or a taxel."""
    taxel: int | None = None
    """Index of the taxel in the skin, if it concerns one taxel."""


@dataclass(frozen=True)
class TruthRecord:
    """The ground truth of one touch at one reading, known for a simulated skin."""

    stamp: int
    """Time of the reading [ns since the epoch]."""
    touch: int
    """Number of the touch in its file."""
    gesture: str
    """Name of the gesture; `none` if it is not in the vocabulary."""
    kind: str
    """Variant of the gesture."""
    link: str
    """Link that takes most of the force."""
    force: float
    """Total force on the skin [N]."""
    area: float
    """Contact area [m2]."""
    p_world: Vector
    """Centre of the force [m]."""


MIN_GAP = 1.0
"""Shortest duration without a reading that is a gap [s]."""
GAP_PERIODS = 10
"""Smallest number of periods without a reading that is a gap."""
LONGEST_PLAYED = 10.0
"""Longest gap that is played as it was recorded [s]."""
MAX_RATE = 10_000.0
"""Number of scans a second above which stamps are no nanoseconds."""


@dataclass(frozen=True)
class Gap:
    """A gap is a time without readings within a recording."""

    start: int
    """Stamp of the last reading before it [ns since the epoch]."""
    end: int
    """Stamp of the first reading after it [ns since the epoch]."""

    @property
    def seconds(self) -> float:
        """Return its duration [s]."""
        return (self.end - self.start) / NS_PER_S


def find_gap_limit(period: int) -> int:
    """Return the time between two readings above which there is a gap [ns].

    Args:
        period: usual time between two readings [ns].
    """
    return max(round(MIN_GAP * NS_PER_S), GAP_PERIODS * period)


def compute_skipped(silence: int, period: int) -> int:
    """Return how much of the time between two readings is skipped when played [ns].

    A gap that is longer lasts `LONGEST_PLAYED`, so that no touch goes on after it.

    Args:
        silence: time between the two readings [ns].
        period: usual time between two readings [ns].
    """
    longest = max(round(LONGEST_PLAYED * NS_PER_S), find_gap_limit(period))
    return max(silence - longest, 0)


def describe_rate(period: int) -> str | None:
    """Return that a rate is impossible, with the remedy; None for one that may be.

    Args:
        period: usual time between two readings [ns].
    """
    rate = NS_PER_S / max(period, 1)
    if rate <= MAX_RATE:
        return None
    return (
        f"{rate:,.0f} scans a second; allowed are up to {MAX_RATE:,.0f}; stamps are "
        "nanoseconds since the epoch: write it again with those"
    )


NONE = "none"
"""Class of contact that is no gesture."""
UNKNOWN = "unknown"
"""Answer of a recogniser for a touch whose gesture it cannot tell, so that no gesture
may have this name."""
MAX_NAME_BYTES = 200
"""Largest size of the name of a gesture in UTF-8: less than that of the name of a file
and of a string in a message."""
WITHOUT_JOINERS = {0x200C: None, 0x200D: None}
"""Removes characters without a shape that join or separate the letters and emoji beside
them, as in Persian."""
RANGE_MARGIN_S = 1.0
"""Margin of a rough range: half of the two seconds that the paper leaves between
gestures."""
MAX_ENTRY = 100
"""Number of characters of a range that messages show."""
EXAMPLE_RANGE = "{start_s: 1.5, end_s: 4.0, gesture: poke}"


@dataclass(frozen=True, order=True)
class Label:
    """A label names the gesture made from `start` until just before `end`."""

    start: int
    """First instant [ns since the epoch]."""
    end: int
    """First instant after the gesture [ns since the epoch]."""
    gesture: str
    """Name of the gesture; `none` means that nothing touched the skin."""
    source: Literal["true", "range", "auto"] = "true"
    """`true`: known; `range`: roughly marked; `auto`: found by automatic labelling."""

    def __post_init__(self) -> None:
        """Raise if the label ends before it starts or has no gesture."""
        if self.end <= self.start:
            raise RecordingError(
                f"label '{self.gesture}' ends at {self.end} ns, not after its start "
                f"{self.start} ns; the end is the first instant after the gesture"
            )
        if not self.gesture:
            raise RecordingError("label has no gesture; name one, or 'none'")

    def is_within(self, start: int, end: int) -> bool:
        """Tell whether any of it lies between two stamps [ns since the epoch]."""
        return self.start <= end and self.end > start


def check_gesture_names(names: Iterable[str]) -> None:
    """Refuse names that a gesture cannot have, and names that look like one another.

    A name is kept as it is written, in any letters. Names that differ only in case, in
    `_` for blanks, or in how their characters are composed, look like one another.

    Raises:
        RecordingError: naming the first that is refused.
    """
    spellings = {look_of(NONE): NONE}
    for name in names:
        reason = ""
        shown = name.translate(WITHOUT_JOINERS)
        if not shown.strip():
            reason = "is empty"
        elif name != name.strip():
            reason = "begins or ends with a blank"
        elif not shown.isprintable():
            reason = "holds characters that cannot be printed"
        elif len(name.encode()) > MAX_NAME_BYTES:
            reason = f"has {len(name.encode()):,} bytes"
        elif look_of(name) == UNKNOWN:
            reason = "is the recogniser's own word"
        if reason:
            raise RecordingError(
                f"gesture {shorten(name)} {reason}; allowed are printable names of 1 "
                f"to {MAX_NAME_BYTES} bytes, without a blank at either end, and not "
                f"'{UNKNOWN}'"
            )
        spelling = spellings.setdefault(look_of(name), name)
        if spelling != name:
            raise RecordingError(
                f"gestures {shorten(spelling)} and {shorten(name)} differ only in case"
                ", '_' for blanks, or how their characters are composed; allowed is "
                "one spelling of each gesture; write both alike, or rename one"
            )


def check_new_name(name: str, known: Iterable[str]) -> None:
    """Refuse a name that a gesture cannot have, or that looks like a known one.

    Args:
        name: name that a person gives to a touch.
        known: names that are used already. Of those that look alike, the first counts.

    Raises:
        RecordingError: naming it, and the one that it looks like.
    """
    check_gesture_names([name])
    alike = (each for each in known if look_of(each) == look_of(name))
    check_gesture_names([next(alike, name), name])


def look_of(name: str) -> str:
    """Return what names have in common that look like one another."""
    composed = unicodedata.normalize("NFC", name.translate(WITHOUT_JOINERS))
    folded = unicodedata.normalize("NFC", composed.casefold())
    return re.sub(r"[\s_]+", " ", folded)


def sort_labels(
    labels: Iterable[Label], source: str | None = None
) -> tuple[Label, ...]:
    """Return the labels of one source, or of all, sorted by start."""
    return tuple(sorted(x for x in labels if source in (None, x.source)))


def select_labels(labels: Iterable[Label]) -> tuple[Label, ...]:
    """Return the true labels; without any the automatic ones, else the rough ranges."""
    labels = tuple(labels)
    by_source = (sort_labels(labels, source) for source in ("true", "auto", "range"))
    return next((found for found in by_source if found), ())


def describe_label(label: Label, start: int) -> str:
    """Return gesture and times of a label, for messages.

    Args:
        label: the label.
        start: stamp from which its seconds count, the recording's first [ns].
    """
    first = (label.start - start) / NS_PER_S
    end = (label.end - start) / NS_PER_S
    return f"'{label.gesture}' from {first:.2f} to {end:.2f} s"


def label_instants(
    labels: Iterable[Label],
    stamps: Int[np.ndarray, "reading"],
    gestures: Sequence[str],
) -> Int[np.ndarray, "reading"]:
    """Return the index into `gestures` of the gesture made at each stamp.

    Without a label, or with a gesture that is not in `gestures`, it is the index of
    `none`, or -1 if that is not in `gestures`. Of overlapping labels, the one that
    starts last counts.
    """
    known = {gesture: index for index, gesture in enumerate(gestures)}
    none = known.get(NONE, -1)
    instants = np.full(len(stamps), none, dtype=np.int64)
    for label in sort_labels(labels):
        inside = (stamps >= label.start) & (stamps < label.end)
        instants[inside] = known.get(label.gesture, none)
    return instants


def build_labels(
    stamps: Int[np.ndarray, "reading"],
    gestures: Sequence[str],
    period: int,
    source: Literal["true", "range", "auto"] = "true",
) -> tuple[Label, ...]:
    """Build one label for each run of equal gestures other than `none`.

    Args:
        stamps: stamps of the readings, increasing [ns since the epoch].
        gestures: name of the gesture at each reading.
        period: duration of the last reading [ns].
        source: source of the labels.
    """
    names = np.asarray(gestures)
    breaks = np.flatnonzero(names[1:] != names[:-1]) + 1
    firsts = [0, *breaks.tolist()]
    ends = [int(stamps[i]) for i in breaks] + [int(stamps[-1]) + period]
    return tuple(
        Label(int(stamps[first]), end, str(names[first]), source)
        for first, end in zip(firsts, ends, strict=True)
        if names[first] != NONE
    )


def load_ranges(path: Path | str, start: int) -> tuple[Label, ...]:
    """Load ranges from a YAML list of `{start_s, end_s, gesture}`.

    Args:
        path: path of the file.
        start: stamp from which the seconds count, the recording's first [ns].

    Raises:
        RecordingError: the file or an entry cannot be used.
    """
    try:
        text = read_file(Path(path), MAX_YAML_BYTES).decode("utf-8")
    except OSError as error:
        raise RecordingError(f"no ranges at {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path}: byte {error.start} is no UTF-8; save it as UTF-8"
        ) from None
    try:
        entries = load_plain_yaml(text)
    except ValueError as error:
        raise RecordingError(f"{path}{error}") from None
    if not isinstance(entries, list) or not entries:
        raise RecordingError(
            f"{path} holds no list; allowed are lines like - {EXAMPLE_RANGE}"
        )
    return sort_labels(
        parse_range(entry, f"{path}, range {number}", start)
        for number, entry in enumerate(entries, 1)
    )


def parse_range(entry: object, place: str, start: int) -> Label:
    """Convert one entry of a list of ranges; `place` names it in errors."""
    text = " ".join(f"{entry}"[:MAX_ENTRY].split())
    if not isinstance(entry, dict) or set(entry) != {"start_s", "end_s", "gesture"}:
        raise RecordingError(f"{place} is {text}; allowed is such as {EXAMPLE_RANGE}")
    first = entry["start_s"]
    last = entry["end_s"]
    gesture = entry["gesture"]
    named = isinstance(gesture, str) and gesture
    if not named or not all(
        isinstance(value, int | float) and 0 <= value < 1e9 for value in (first, last)
    ):
        raise RecordingError(
            f"{place} is {text}; allowed are seconds since the first reading "
            f"and a gesture's name, such as {EXAMPLE_RANGE}"
        )
    if last <= first:
        raise RecordingError(f"{place} ends at {last} s, not after its start {first} s")
    begin, end = start + round(first * NS_PER_S), start + round(last * NS_PER_S)
    return Label(begin, end, gesture, "range")


def build_rough_ranges(
    truth: Iterable[Label], margin: float = RANGE_MARGIN_S
) -> tuple[Label, ...]:
    """Widen and join true labels into ranges such as a person would mark.

    Widened labels of one gesture that meet become one range; those of different
    gestures are cut in the middle between the labels.

    Args:
        truth: labels, of which those of source `true` are used.
        margin: how far a range extends beyond its labels [s].
    """
    reach = round(margin * NS_PER_S)
    ranges: list[Label] = []
    for label in sort_labels(truth, "true"):
        if label.gesture == NONE:
            continue
        wide = Label(label.start - reach, label.end + reach, label.gesture, "range")
        previous = ranges[-1] if ranges else None
        if previous is None or wide.start >= previous.end:
            ranges.append(wide)
        elif previous.gesture == wide.gesture:
            ranges[-1] = replace(previous, end=max(previous.end, wide.end))
        else:
            middle = (previous.end - reach + label.start) // 2
            middle = min(max(middle, previous.start + 1), wide.end - 1)
            ranges[-1] = replace(previous, end=middle)
            ranges.append(replace(wide, start=middle))
    return tuple(ranges)
