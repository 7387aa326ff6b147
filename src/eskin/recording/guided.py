"""This module guides a person through recording gestures, and labels them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.recording.records import Label
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Contact, Scan, TouchPipeline, TouchState
from eskin.units import NS_PER_S

REST = 2.5
"""Time without touch before the first gesture, in which the skin is tared [s]."""
MAX_SECONDS = 10.0
"""Longest time that a gesture may last [s]."""
FULL = 0.99
"""Share of full scale from which a taxel is saturated."""
REACTION = 0.1
"""Time within which nobody can react to a request [s]; a start within it is a false
start of sprinters (World Athletics, Technical Rules, 16.6)."""
GAP_PERIODS = 3
"""Time without a scan, by that between the two scans before it, from which scans are
missing; it is also longer than a touch may pause."""
MIN_ATTEMPTS = 5
"""Number of attempts of a gesture from which it can be learned."""


@dataclass(frozen=True)
class RecordingAttempt:
    """An attempt is one gesture that a person was asked for and made."""

    gesture: str
    """Name of the gesture."""
    start: int
    """First reading with contact [ns since the epoch]."""
    end: int
    """First reading after the last contact [ns since the epoch]."""
    force: float
    """Largest force [N], relative where the skin is not calibrated."""
    taxels: int
    """Largest number of taxels in contact."""
    saturated: int
    """Number of taxels at full scale at the largest force: what they measure is too
    small, as it will be whenever the gesture is made so."""
    features: Float[np.ndarray, "feature"]
    """Logarithms of duration, force, area, taxels, pieces and distance travelled."""

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return (self.end - self.start) / NS_PER_S

    @property
    def label(self) -> Label:
        """Label of the attempt."""
        return Label(self.start, self.end, self.gesture)


@dataclass(frozen=True)
class AttemptEvent:
    """An event is what a scan has led to."""

    kind: Literal["touched", "ready", "began", "taken", "refused", "done"]
    """`touched`: rest begins again, for `text`; `ready`: the skin is tared, and the
    first gesture may be made; `began`: a touch began; `taken`: an attempt was labelled;
    `refused`: a touch was not, for `text`; `done`: every gesture has its attempts."""
    text: str = ""
    """Reason for which rest begins again, or a touch is refused."""
    attempt: RecordingAttempt | None = None
    """What was labelled."""
    goes_on: bool = False
    """Whether it is the touch before, which went on after a pause: what was told of
    that holds no more."""


@final
class RecordingGuide:
    """A guide asks for gestures in turn, and labels each from its first contact on.

    It is pushed scan by scan, and knows neither device nor terminal. An attempt ends
    when nothing has touched the skin for as long as a touch may pause. If it is touched
    again before anybody can react to the next request, the attempt goes on. What was
    not seen from its beginning to its end is no attempt.

    Attributes:
        attempts: attempts so far.
        skipped: gestures that are no longer asked for.
        state: contacts, touches and faults at the latest scan; None before the first.
        asked: stamp at which the current request was made [ns]; None before.
        before: the touch before the current request; None where there is none, or the
            person has chosen another request.
        labelled: its attempt; None where it was refused.
        gap: longest time without a scan at the latest place where scans are missing
            [s].
        gap_end: stamp of the first scan after it [ns]; None where none are missing.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        calibration: Calibration,
        gestures: Sequence[str],
        times: int,
    ) -> None:
        """Start with rest.

        Args:
            mounted: the skin on its robot.
            calibration: its calibration.
            gestures: names of the gestures, in the order in which they are asked for.
            times: number of attempts of each.
        """
        self.mounted = mounted
        self.calibration = calibration
        self.gestures = tuple(gestures)
        self.times = times
        self.pipeline = TouchPipeline(mounted, calibration)
        self.state: TouchState | None = None
        self.attempts: list[RecordingAttempt] = []
        self.is_last_kept = True
        self.skipped: set[str] = set()
        self.rested_since: int | None = None
        self.is_touched = False
        self.is_ready = False
        self.touch: TouchSummary | None = None
        self.requested: str | None = None
        self.asked: int | None = None
        self.before: TouchSummary | None = None
        self.labelled: RecordingAttempt | None = None
        self.is_early = False
        self.goes_on = False
        self.elapsed = 0
        self.gap = 0.0
        self.gap_end: int | None = None

    def count_attempts(self, gesture: str) -> int:
        """Return the number of attempts of a gesture so far."""
        return sum(attempt.gesture == gesture for attempt in self.attempts)

    @property
    def request(self) -> str | None:
        """Gesture that is asked for; None where none is missing.

        All gestures take turns, so that what changes in time changes for all of them.
        """
        left = [each for each in self.gestures if each not in self.skipped]
        next_gesture = min(left, key=self.count_attempts, default=None)
        if next_gesture is None or self.count_attempts(next_gesture) >= self.times:
            return None
        return next_gesture

    def again(self) -> RecordingAttempt | None:
        """Drop the last attempt, which is asked for anew, and return it.

        None where it has been dropped already: the one before it is kept.
        """
        if self.is_last_kept or not self.attempts:
            return None
        self.is_last_kept = True
        self.before = None
        self.ask_now()
        return self.attempts.pop()

    def skip(self) -> None:
        """Ask no more for the gesture that is asked for."""
        if self.request is not None:
            self.skipped.add(self.request)
            self.before = None
            self.ask_now()

    def ask_now(self) -> None:
        """Note that a request is made at the latest scan."""
        if self.state is not None:
            self.asked = self.state.reading.stamp

    def push(self, scan: Scan) -> AttemptEvent | None:
        """Process the next scan, and return what it has led to."""
        if self.state is not None:
            self.note_gap(self.state.reading.stamp, scan.stamp)
        state = self.state = self.pipeline.push_scan(scan)
        scan = self.pipeline.front_end.turn(scan)
        event = self.push_touch(scan, state) if self.is_ready else self.push_rest(state)
        if event is not None and event.kind != "began":
            self.ask_now()
        return event

    def note_gap(self, before: int, stamp: int) -> None:
        """Note whether scans are missing between two stamps [ns]."""
        longest = max(
            self.pipeline.config.touches.pause_seconds * NS_PER_S,
            GAP_PERIODS * self.elapsed,
        )
        self.elapsed = stamp - before
        if self.elapsed > longest:
            self.gap = self.elapsed / NS_PER_S
            self.gap_end = stamp

    def push_touch(self, scan: Scan, state: TouchState) -> AttemptEvent | None:
        """Follow a touch, and label it when it has ended."""
        if self.touch is None:
            if not state.open:
                return None
            self.touch = self.begin(min(touch.onset for touch in state.open))
            self.touch.add_scan(scan, state, self.calibration.full_scale)
            return AttemptEvent("began", goes_on=self.goes_on)
        if state.open or state.tracking.held:
            self.touch.add_scan(scan, state, self.calibration.full_scale)
            return None
        ended = self.touch
        ended.end(state.reading.stamp)
        self.touch = None
        self.before = ended
        self.labelled = None
        gesture = self.requested
        text = self.describe_unseen(ended, state) or ended.describe_refusal()
        if gesture is None or gesture != self.request:
            text = "another gesture was asked for meanwhile"
        if gesture is None or text:
            return AttemptEvent("refused", text, goes_on=self.goes_on)
        attempt = ended.build_attempt(gesture)
        self.labelled = attempt
        self.attempts.append(attempt)
        self.is_last_kept = False
        kind = "taken" if self.request else "done"
        return AttemptEvent(kind, attempt=attempt, goes_on=self.goes_on)

    def begin(self, onset: int) -> "TouchSummary":
        """Begin a touch at its first contact [ns], or go on with the one before it."""
        asked = onset if self.asked is None else self.asked
        self.is_early = onset < asked + REACTION * NS_PER_S
        self.goes_on = self.is_early and self.before is not None
        if self.before is None or not self.is_early:
            self.requested = self.request
            return TouchSummary(onset)
        if self.labelled is not None:
            self.attempts.pop()
            self.is_last_kept = True
        return self.before

    @property
    def is_over(self) -> bool:
        """Whether no gesture is missing, and the last one can no longer go on."""
        if self.state is None or self.touch is not None or self.request is not None:
            return False
        since = self.state.reading.stamp - (self.asked or 0)
        return self.is_ready and since > REACTION * NS_PER_S

    def describe_unseen(self, touch: "TouchSummary", state: TouchState) -> str:
        """Describe why a touch was not seen as a whole; empty if it was."""
        if self.is_early and not self.goes_on:
            return "it began before it was asked for; wait until it is"
        if self.gap_end is not None and touch.onset <= self.gap_end <= touch.after:
            return f"no scan came for {self.gap:.1f} s while it was made"
        valid = state.reading.valid[touch.pressed]
        if 2 * np.count_nonzero(valid) < len(valid):
            return f"patch '{touch.patch}' had no valid data when it ended"
        return ""

    def push_rest(self, state: TouchState) -> AttemptEvent | None:
        """Wait until the skin has been at rest for long enough."""
        stamp = state.reading.stamp
        was_touched = self.is_touched
        self.is_touched = bool(state.open or state.tracking.held)
        if self.rested_since is None or self.is_touched:
            self.rested_since = stamp
        if self.is_touched and not was_touched and state.contacts:
            patch = max(state.contacts, key=lambda contact: contact.force).patch
            return AttemptEvent("touched", f"patch '{patch}' is touched")
        self.is_ready = stamp - self.rested_since >= REST * NS_PER_S
        return AttemptEvent("ready") if self.is_ready else None


class TouchSummary:
    """A summary collects what an attempt needs of the touches of one gesture.

    Attributes:
        onset: first contact [ns since the epoch].
        last: latest contact [ns since the epoch].
        after: first reading after it [ns since the epoch]; 0 while it goes on.
        pressed: taxels in contact at the greatest force.
        patch: patch of the strongest contact then.
    """

    def __init__(self, onset: int) -> None:
        """Start at the first contact [ns since the epoch]."""
        self.pressed = np.empty(0, np.int64)
        self.patch = ""
        self.onset = self.last = onset
        self.after = 0
        self.force = self.area = self.travelled = 0.0
        self.taxels = self.pieces = self.saturated = 0
        self.strongest: Contact | None = None

    def add_scan(self, scan: Scan, state: TouchState, full_scale: int) -> None:
        """Add a scan and its contacts."""
        contacts = state.contacts
        stamp = state.reading.stamp
        if not contacts:
            self.end(stamp)
            self.strongest = None
            return
        self.last = stamp
        self.after = 0
        strongest = max(contacts, key=lambda contact: contact.force)
        previous = self.strongest
        self.strongest = strongest
        self.pieces += previous is None
        if previous is not None and previous.link == strongest.link:
            step = strongest.p_link - previous.p_link
            self.travelled += float(np.linalg.norm(step))
        taxels = np.concatenate([contact.taxels for contact in contacts])
        self.area = max(self.area, sum(contact.area for contact in contacts))
        self.taxels = max(self.taxels, len(taxels))
        force = sum(contact.force for contact in contacts)
        if force > self.force:
            self.force = force
            self.pressed = taxels
            self.patch = strongest.patch
            is_saturated = scan.counts[taxels] >= FULL * full_scale
            self.saturated = int(np.count_nonzero(is_saturated))

    def end(self, stamp: int) -> None:
        """Note that a reading has no contact [ns since the epoch]."""
        self.after = self.after or stamp

    def describe_refusal(self) -> str:
        """Describe why it is no attempt; empty if it is one."""
        seconds = (self.last - self.onset) / NS_PER_S
        if seconds > MAX_SECONDS:
            return f"it lasted {seconds:.0f} s; allowed are {MAX_SECONDS:g}"
        return ""

    def build_attempt(self, gesture: str) -> RecordingAttempt:
        """Build the attempt of a gesture."""
        values = (
            (self.after - self.onset) / NS_PER_S,
            self.force,
            1e4 * self.area,
            self.taxels,
            self.pieces,
            1e2 * self.travelled + 1.0,
        )
        features = np.log(np.maximum(values, 1e-3))
        return RecordingAttempt(
            gesture,
            self.onset,
            self.after,
            self.force,
            self.taxels,
            self.saturated,
            features,
        )


@dataclass(frozen=True)
class AttemptReview:
    """A review says whether attempts are enough, and distinct, to be learned from."""

    counts: dict[str, int]
    """Number of attempts of each gesture."""
    nearest_right: int
    """Number of attempts whose nearest other attempt is of the same gesture."""
    confused: tuple[str, str, int] | None
    """Gesture, the one that its attempts are nearest to most often, and how often; None
    where no attempt is nearest to another gesture."""

    @property
    def few(self) -> tuple[str, ...]:
        """Gestures with fewer attempts than can be learned from."""
        return tuple(
            name for name, count in self.counts.items() if count < MIN_ATTEMPTS
        )


def review_attempts(
    attempts: Sequence[RecordingAttempt], gestures: Sequence[str]
) -> AttemptReview:
    """Compare each attempt to its nearest other one, by features over their spread.

    Args:
        attempts: all attempts.
        gestures: names of the gestures that were asked for.
    """
    counts = {
        name: sum(attempt.gesture == name for attempt in attempts) for name in gestures
    }
    if len(attempts) < 2:
        return AttemptReview(counts, 0, None)
    features = np.array([attempt.features for attempt in attempts])
    features = features / np.maximum(features.std(axis=0), 0.05)
    distances = np.linalg.norm(features[:, None] - features, axis=2)
    np.fill_diagonal(distances, np.inf)
    pairs = [
        (attempt.gesture, attempts[other].gesture)
        for attempt, other in zip(attempts, distances.argmin(axis=1), strict=True)
    ]
    wrong = [pair for pair in pairs if pair[0] != pair[1]]
    confused = None
    if wrong:
        pair = max(sorted(set(wrong)), key=wrong.count)
        confused = (*pair, wrong.count(pair))
    return AttemptReview(counts, len(pairs) - len(wrong), confused)
