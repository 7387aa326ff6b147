"""This module tracks pending commands, touches that have commanded, and stop times."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from eskin.command.arm import ArmState
from eskin.command.command_map import Rule
from eskin.live import Detection
from eskin.stream import RecognitionState
from eskin.touch import TouchStatus
from eskin.units import NS_PER_S


@dataclass
class PendingCommand:
    """A pending command waits until its touch is sure enough and, if need be, over."""

    detection: Detection
    """Detection that asks for it."""

    rule: Rule
    """Rule that maps the detection to an action."""

    action: str
    """Plain action that it asks for."""

    required: float
    """Confidence that the action needs."""

    confidence: float
    """Probability of its gesture at the latest reading of the touch."""

    touch: int
    """Id of the touch, or of the touch that has taken it over."""

    end: int
    """Stamp of the latest contact of the touch [ns since the epoch]."""

    closed: bool = False
    """Whether the touch has closed, so that its confidence is final."""

    @property
    def confident(self) -> bool:
        """Return whether its confidence suffices."""
        return self.confidence >= self.required

    @property
    def duration(self) -> float:
        """Return the time from the first to the latest contact of the touch [s]."""
        return (self.end - self.detection.onset) / NS_PER_S

    def update(
        self, recognition: RecognitionState, vocabulary: tuple[str, ...]
    ) -> None:
        """Follow the touch and its confidence through the next recognition state.

        Args:
            recognition: a state not earlier than the detection.
            vocabulary: gestures in the order of the probabilities.
        """
        state = recognition.state
        for touch in state.closed:
            if touch.id == self.touch:
                self.closed = not touch.merged_into
                self.touch = touch.merged_into or self.touch
        lasts = [
            one.last for one in (*state.open, *state.closed) if one.id == self.touch
        ]
        self.end = max(self.end, *lasts) if lasts else self.end
        probabilities = recognition.probabilities.get(self.touch)
        if probabilities is not None:
            index = vocabulary.index(self.detection.gesture)
            self.confidence = float(probabilities[index])


def describe_doubt(pending: PendingCommand) -> str:
    """Return why a command is refused whose confidence does not suffice."""
    gesture = pending.detection.gesture.replace("_", " ")
    return (
        f"not understood, most likely {gesture}: confidence {pending.confidence:.2f} "
        f"is below {pending.required:.2f}; do it again, more clearly"
    )


@final
class CommandedTouches:
    """This set holds the touches that have commanded or asked to; each does so once.

    A touch that takes over one of them is blocked as well.
    """

    def __init__(self) -> None:
        """Start without any touch."""
        self.asked: set[tuple[int, int]] = set()
        self.blocked: set[int] = set()

    def add(self, touch: int, onset: int) -> None:
        """Add a touch by its id and its onset [ns since the epoch]."""
        self.asked.add((touch, onset))

    def block(self, touch: int) -> None:
        """Add a touch for which the arm was stopped, whatever it is recognised as."""
        self.blocked.add(touch)

    def contains(self, touch: int, onset: int) -> bool:
        """Return whether a touch has commanded or asked, or took over one that did."""
        return touch in self.blocked or (touch, onset) in self.asked

    def merges(self, touch: int, before: int, closed: Sequence[TouchStatus]) -> bool:
        """Return whether another touch that has commanded or asked merges with this.

        Args:
            touch: present id of this touch.
            before: its id until now.
            closed: touches that have closed, in their order.
        """
        joined = {touch}
        for ended in reversed(closed):
            if ended.merged_into in joined:
                joined.add(ended.id)
        known = self.blocked | {number for number, _ in self.asked}
        return bool((joined - {before}) & known)

    def forget(self, closed: Sequence[TouchStatus]) -> None:
        """Remove touches that have closed."""
        for touch in closed:
            asked = {key for key in self.asked if key[0] == touch.id}
            if touch.merged_into and (asked or touch.id in self.blocked):
                self.blocked.add(touch.merged_into)
            self.asked -= asked
            self.blocked.discard(touch.id)


@final
class StopTimes:
    """Stop times tell since when an arm is paused and held [ns since the epoch]."""

    def __init__(self) -> None:
        """Start with an arm that is neither paused nor held."""
        self.paused_since: int | None = None
        self.held_since: int | None = None
        self.pause_count = 0

    def update(self, state: ArmState, now: int) -> None:
        """Update the times from the arm's state at a time."""
        if self.paused_since is None or state.pause_count != self.pause_count:
            self.pause(state, now)
        if not state.paused:
            self.paused_since = None
        held = now if self.held_since is None else self.held_since
        self.held_since = None if state.hold_reason is None else held

    def pause(self, state: ArmState, now: int) -> None:
        """Note that the arm was paused just now, paused already or not."""
        self.paused_since, self.pause_count = now, state.pause_count

    def hold(self, now: int) -> None:
        """Note that the arm was held just now."""
        self.held_since = now

    def resume(self) -> None:
        """Note that a pause is over."""
        self.paused_since = None

    def find_refusal(self, onset: int, now: int, min_pause: float) -> str | None:
        """Return why a touch must not set the arm in motion, or None where it may.

        Args:
            onset: time at which the touch began.
            now: present time.
            min_pause: least duration of a pause [s].
        """
        if self.paused_since is None:
            return "nobody has paused it; pause it first"
        if onset <= self.paused_since:
            return "the touch began before the pause; lift the hand, then ask again"
        if self.held_since is not None and onset <= self.held_since:
            return "the touch began before the hold; lift the hand, then ask again"
        passed = (now - self.paused_since) / NS_PER_S
        if passed >= min_pause:
            return None
        return f"it was paused only {passed:.1f} s ago; ask again after {min_pause:g} s"
