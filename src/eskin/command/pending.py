"""Commands that wait for confidence, touches that have commanded, and pauses."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from eskin.command.arm import ArmState
from eskin.command.command_map import Rule
from eskin.live import Detection
from eskin.stream import RecognitionState
from eskin.touch.records import TouchBrief
from eskin.units import NS_PER_S


@final
class CommandedTouches:
    """Touches that have commanded or asked; who takes one over is barred for it."""

    def __init__(self) -> None:
        """Nobody has."""
        self.asked: set[tuple[int, int]] = set()
        self.barred: set[int] = set()

    def add(self, touch: int, onset: int) -> None:
        """Remember a touch by its id and its onset [ns since the epoch]."""
        self.asked.add((touch, onset))

    def has(self, touch: int, onset: int) -> bool:
        """Whether a touch has commanded or asked, or took over one that did."""
        return touch in self.barred or (touch, onset) in self.asked

    def joins(self, touch: int, before: int, over: Sequence[TouchBrief]) -> bool:
        """Whether another touch that has commanded or asked is one with this now.

        Args:
            touch: id of what this touch is now.
            before: its id until now.
            over: touches that have closed, in their order.
        """
        joined = {touch}
        for closed in reversed(over):
            if closed.merged_into in joined:
                joined.add(closed.id)
        known = self.barred | {number for number, _ in self.asked}
        return bool((joined - {before}) & known)

    def forget(self, over: Sequence[TouchBrief]) -> None:
        """Let go of touches that have closed."""
        for touch in over:
            asked = {key for key in self.asked if key[0] == touch.id}
            if touch.merged_into and (asked or touch.id in self.barred):
                self.barred.add(touch.merged_into)
            self.asked -= asked
            self.barred.discard(touch.id)


@final
class StopTimes:
    """Follows the arm's state; all times are in ns since the epoch."""

    def __init__(self) -> None:
        """It is neither paused nor held."""
        self.paused_since: int | None = None
        self.held_since: int | None = None
        self.pauses = 0

    def look(self, state: ArmState, now: int) -> None:
        """Take in the arm's state at a time."""
        if self.paused_since is None or state.pauses != self.pauses:
            self.pause(state, now)
        if not state.paused:
            self.paused_since = None
        held = now if self.held_since is None else self.held_since
        self.held_since = None if state.holding is None else held

    def pause(self, state: ArmState, now: int) -> None:
        """Take in that it was paused just now, paused already or not."""
        self.paused_since, self.pauses = now, state.pauses

    def hold(self, now: int) -> None:
        """Take in that it was held just now."""
        self.held_since = now

    def resume(self) -> None:
        """Take in that a pause is over."""
        self.paused_since = None

    def objection(self, onset: int, now: int, least: float) -> str | None:
        """Why a touch must not set the arm in motion; None: it may once it ends.

        Args:
            onset: of the touch.
            now: the time.
            least: how long a pause lasts at least [s].
        """
        if self.paused_since is None:
            return "nobody has paused it"
        if onset <= self.paused_since:
            return "the touch began before the pause"
        if self.held_since is not None and onset <= self.held_since:
            return "the touch began before the hold"
        passed = (now - self.paused_since) / NS_PER_S
        return f"it was paused only {passed:.1f} s ago" if passed < least else None


@dataclass
class PendingCommand:
    """What a touch asks for, and how sure that is by now."""

    detection: Detection
    """What was said of it."""

    rule: Rule
    """That it asks by."""

    action: str
    """The plain action that it asks for."""

    needed: float
    """Confidence that the action needs."""

    confidence: float
    """The probability of its gesture at the latest moment of the touch."""

    touch: int
    """Id of the touch, or of what has taken it over."""

    closed: bool = False
    """Whether no more will be known of it."""

    @property
    def sure(self) -> bool:
        """Whether it is sure enough."""
        return self.confidence >= self.needed

    @property
    def doubt(self) -> str:
        """Why it is refused where it is not."""
        return f"confidence {self.confidence:.2f} is below {self.needed:.2f}"

    def follow(self, moment: RecognitionState, vocabulary: tuple[str, ...]) -> None:
        """Take in the next moment.

        Args:
            moment: not earlier than what was said.
            vocabulary: in the order of its probabilities.
        """
        for touch in moment.state.over:
            if touch.id == self.touch:
                self.closed = not touch.merged_into
                self.touch = touch.merged_into or self.touch
        chances = moment.probabilities.get(self.touch)
        if chances is not None:
            self.confidence = float(chances[vocabulary.index(self.detection.gesture)])
