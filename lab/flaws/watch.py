"""Watch a recogniser: count what it says at rest, and follow its touches."""

from dataclasses import dataclass
from typing import final

from eskin.live import Detection, Recognizer
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.flaws.scoring import Sample, Trail


@dataclass
class RestCount:
    """Counts what is said of a skin that nobody touches."""

    seconds: float = 0.0
    """Time [s]."""
    openings: int = 0
    """Touches that were shown for the first time."""
    detections: int = 0
    """Detections of any word, `unknown` counted."""
    open_seconds: float = 0.0
    """Time with an open touch [s]."""

    def add(self, other: "RestCount") -> None:
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
        detections: detections since then.
    """

    def __init__(self, recognizer: Recognizer) -> None:
        """Start before the first scan."""
        self.recognizer = recognizer
        self.rest = RestCount()
        self.trails: dict[int, Trail] | None = None
        self.detections: list[Detection] = []
        self.seen: set[int] = set()
        self.last: int | None = None

    def follow(self) -> None:
        """Follow the touches from now on, without those seen before."""
        self.trails, self.detections = {}, []

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
            self.detections += found
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
            trail.onset, trail.last = row.onset, row.last
            trail.merged_into = row.merged_into
        names = self.recognizer.model.card.vocabulary
        rows = {row.id: row for row in state.rows}
        for touch in state.touches:
            answer = names[int(self.recognizer.probabilities[touch.id].argmax())]
            row, place = rows[touch.id], touch.contact.p_world
            trails[touch.id].samples.append(
                Sample(state.reading.stamp, row.force, place, row.contacts, answer)
            )
