"""Watch a recogniser at rest, and score its touches against true contacts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.live import Detection, Recognizer
from eskin.recording import NONE
from eskin.touch import Scan
from eskin.units import NS_PER_S

CONTACT_FORCE = 0.2
"""True force on all taxels from which there is contact [N]."""
STRONG_FORCE = 1.0
"""Peak force from which a touch must be found [N]."""
ONSET_SECONDS = 0.1
END_SECONDS = 0.3
"""Largest errors of the onset and of the end of a touch that is found [s]."""
NEAR = 0.15
"""Largest distance of a touch from the centre of the true force [m]."""


@dataclass(frozen=True, eq=False)
class TrueContact:
    """A true contact is the force of one touch of a person over time."""

    gesture: str
    """What a recogniser should answer."""
    stamps: Int[np.ndarray, "scan"]
    """Stamps of its scans, increasing [ns]."""
    force: Float[np.ndarray, "scan"]
    """Force on all taxels, mean over the period of the scan [N]."""
    centre: Float[np.ndarray, "scan 3"]
    """Centre of the force in the world [m]; NaN without force."""

    @property
    def pressed(self) -> np.ndarray:
        """Tell for each scan whether there is contact."""
        return self.force > CONTACT_FORCE

    @property
    def onset(self) -> int:
        """Stamp of the first scan with contact [ns]."""
        return int(self.stamps[self.pressed][0])

    @property
    def end(self) -> int:
        """Stamp of the last scan with contact [ns]."""
        return int(self.stamps[self.pressed][-1])

    @property
    def peak(self) -> float:
        """Largest force [N]."""
        return float(self.force.max())


@dataclass(frozen=True, eq=False)
class Sample:
    """A sample is what the pipeline says of an open touch at one scan."""

    stamp: int
    """Stamp of the scan [ns]."""
    force: float
    """Force now [N]."""
    p_world: Float[np.ndarray, "3"]
    """Place of its strongest contact [m]."""
    answer: str
    """Most probable class."""


@dataclass(eq=False)
class Trail:
    """A trail is one touch of the pipeline over time."""

    id: int
    onset: int = 0
    """Onset as last stated [ns]."""
    last: int = 0
    """Last contact as last stated [ns]."""
    merged_into: int = 0
    """Id of the touch that it was merged into; 0 without."""
    samples: list[Sample] = field(default_factory=list)

    def find_sample(self, stamp: int) -> Sample | None:
        """Return the last sample up to a stamp [ns]."""
        found = [sample for sample in self.samples if sample.stamp <= stamp]
        return found[-1] if found else None


@dataclass(frozen=True)
class TouchScore:
    """A score says how one true contact was found."""

    gesture: str
    """What a recogniser should answer."""
    peak: float
    """Largest true force [N]."""
    onset_error: float | None
    """Onset of the touch that covers it, less the true one [s]; None without one."""
    end_error: float | None
    """Last contact of that touch, less the true one [s]."""
    forced: str
    """Most probable class of that touch shortly after the true end."""

    @property
    def is_onset_found(self) -> bool:
        """Tell whether the onset is found in time."""
        return self.onset_error is not None and abs(self.onset_error) <= ONSET_SECONDS

    @property
    def is_end_found(self) -> bool:
        """Tell whether the end is found in time."""
        return self.end_error is not None and abs(self.end_error) <= END_SECONDS


def find_root(number: int, trails: Mapping[int, Trail]) -> int:
    """Return the id of the touch that a touch was merged into at last."""
    while trails[number].merged_into in trails:
        number = trails[number].merged_into
    return number


def find_cover(truth: TrueContact, trails: Mapping[int, Trail]) -> Trail | None:
    """Return the touch that covers a true contact.

    It is the one with the largest impulse near the true force while there is contact,
    with that of touches that were merged into it.
    """
    places = {
        int(stamp): centre
        for stamp, centre, pressed in zip(
            truth.stamps, truth.centre, truth.pressed, strict=True
        )
        if pressed
    }
    impulses: dict[int, float] = {}
    for trail in trails.values():
        gained = sum(
            sample.force
            for sample in trail.samples
            if sample.stamp in places
            and np.linalg.norm(sample.p_world - places[sample.stamp]) <= NEAR
        )
        root = find_root(trail.id, trails)
        impulses[root] = impulses.get(root, 0.0) + gained
    best = max(impulses, key=lambda key: impulses[key], default=None)
    if best is None or impulses[best] <= 0.0:
        return None
    return trails[best]


def score_touch(truth: TrueContact, trails: Mapping[int, Trail]) -> TouchScore:
    """Score what the pipeline and the recogniser said of one true contact.

    Args:
        truth: true contact.
        trails: all touches of the pipeline that were open in its time, by id.
    """
    cover = find_cover(truth, trails)
    after = truth.end + round(END_SECONDS * NS_PER_S)
    sample = cover.find_sample(after) if cover else None
    return TouchScore(
        gesture=truth.gesture,
        peak=truth.peak,
        onset_error=(cover.onset - truth.onset) / NS_PER_S if cover else None,
        end_error=(cover.last - truth.end) / NS_PER_S if cover else None,
        forced=sample.answer if sample else NONE,
    )


@dataclass
class RestCount:
    """Counts the reports of a skin that nobody touches."""

    seconds: float = 0.0
    """Time [s]."""
    openings: int = 0
    """Touches that were shown for the first time."""
    detections: int = 0
    """Detections of any word, `unknown` counted."""
    open_seconds: float = 0.0
    """Time with an open touch [s]."""

    def add_counts(self, other: "RestCount") -> None:
        """Add the counts of another stretch."""
        self.seconds += other.seconds
        self.openings += other.openings
        self.detections += other.detections
        self.open_seconds += other.open_seconds

    def rate(self, count: float) -> float:
        """Return a count as so many an hour."""
        return 3600.0 * count / self.seconds if self.seconds else 0.0


@final
class Watcher:
    """A watcher pushes scans to a recogniser and keeps what it says.

    Attributes:
        rest: counts of this stretch; the caller replaces it to begin a new one.
        trails: touches seen since `follow`, by id; None while they are not followed.
    """

    def __init__(self, recognizer: Recognizer) -> None:
        """Start before the first scan."""
        self.recognizer = recognizer
        self.rest = RestCount()
        self.trails: dict[int, Trail] | None = None
        self.seen: set[int] = set()
        self.last: int | None = None

    def follow(self) -> None:
        """Follow the touches from now on, without those seen before."""
        self.trails = {}

    def push(self, scan: Scan) -> list[Detection]:
        """Process the next scan; return its detections."""
        found = self.recognizer.push(scan)
        state = self.recognizer.state
        assert state is not None
        seconds = 0.0 if self.last is None else (scan.stamp - self.last) / NS_PER_S
        self.last = scan.stamp
        self.rest.seconds += seconds
        self.rest.detections += len(found)
        self.rest.open_seconds += seconds if state.open else 0.0
        shown = {status.id for status in (*state.open, *state.closed)}
        self.rest.openings += len(shown - self.seen)
        self.seen |= shown
        if self.trails is not None:
            self.note_touches(self.trails)
        return found

    def note_touches(self, trails: dict[int, Trail]) -> None:
        """Add the confirmed touches of the latest scan to the trails."""
        state = self.recognizer.state
        assert state is not None
        if not (state.open or state.closed):
            return
        for row in state.rows:
            if not row.confirmed:
                continue
            trail = trails.setdefault(row.id, Trail(row.id))
            trail.onset = row.onset
            trail.last = row.last
            trail.merged_into = row.merged_into
        names = self.recognizer.model.card.vocabulary
        rows = {row.id: row for row in state.rows}
        for touch in state.touches:
            answer = names[int(self.recognizer.probabilities[touch.id].argmax())]
            row = rows[touch.id]
            place = touch.contact.p_world
            trails[touch.id].samples.append(
                Sample(state.reading.stamp, row.force, place, answer)
            )
