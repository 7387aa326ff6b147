"""This module scores the commands of an arm that simulated users touch."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, final

import numpy as np

from eskin.command import ASK, HALTING_ACTIONS, REDUCING_ACTIONS, SUSPEND
from eskin.live import Detection
from eskin.recording import NONE, TruthRecord
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.touch import TouchState
from eskin.units import NS_PER_S

GRACE = 1.0
"""Time after the end of a touch, or of its answer, in which a command counts for it
[s]."""

NEAR = 0.1
"""Largest distance between a tracked touch and the simulated touch that causes it
[m]."""

LAG = 0.2
"""Time for which a simulated touch may be felt after its last contact [s]."""

Outcome = Literal["correct", "wrong", "missed"]


@dataclass
class Attempt:
    """Describes a touch by a simulated user, with its outcome.

    A touch that asks for more and the touch that answers the arm's question are one.
    """

    gesture: str
    """Gesture that was made; `none` for an accident."""
    expected: str
    """Action that the command map assigns to it; `none` for an accident."""
    begin: int
    """Stamp of its first contact [ns since the epoch]."""
    end: int | None = None
    """Stamp of the last contact of its latest touch; None while that lasts."""
    number: int = 0
    """Number that the simulated hand gave to it."""
    works: bool = True
    """Whether the arm was neither paused nor held when it began."""
    asked: int | None = None
    """When the arm asked a question because of it [ns since the epoch]."""
    answer: int | None = None
    """Number that the hand gave to the touch that answers; None where none does."""
    mistake: str = ""
    """What the person did wrong when the arm asked; empty where nothing was wrong."""
    stopped: int | None = None
    """When the arm began to stop because of it [ns since the epoch]."""
    command: CommandEvent | None = None
    """First command that was executed because of it."""
    refusals: list[CommandEvent] = field(default_factory=list)
    """Commands that were recognised but refused, and why."""
    recognised: list[str] = field(default_factory=list)
    """Gestures that it was recognised as."""

    @property
    def outcome(self) -> Outcome:
        """Return whether the expected command, another or none was executed."""
        if self.command is None:
            return "missed"
        return "correct" if self.command.action == self.expected else "wrong"

    @property
    def failure(self) -> str:
        """Why the outcome is not correct, in a few words; empty if it is correct."""
        if self.outcome == "correct":
            return ""
        if self.mistake:
            return self.mistake
        if self.refusals and (self.command is None or self.asked is not None):
            return self.refusals[-1].reason.cause.words
        others = [word for word in self.recognised if word != self.gesture]
        if others:
            return f"said to be {others[-1]}"
        changed = bool(self.recognised)
        return "the arm had changed meanwhile" if changed else "nothing was said"

    @property
    def delay(self) -> float | None:
        """Time from its last contact to the command; negative if earlier [s]."""
        if self.command is None or self.end is None:
            return None
        return (self.command.stamp - self.end) / NS_PER_S

    def changes_nothing(self, command: CommandEvent) -> bool:
        """Return whether a command stops an arm that stands: by a failed answer."""
        is_answer = self.answer is not None and not self.works
        return is_answer and command.action in HALTING_ACTIONS

    def covers(self, stamp: int) -> bool:
        """Return whether a command at a time is early enough to count for it."""
        return self.end is None or stamp <= self.end + GRACE * NS_PER_S


@final
class TouchCauses:
    """Finds which simulated touch causes each touch that is tracked on the skin.

    A tracked touch is caused by the simulated touch within `NEAR` of it during most of
    its readings; by none where it is a fault of the skin.
    """

    def __init__(self) -> None:
        """Start without touches."""
        self.readings: dict[int, Counter[int]] = {}
        self.felt: dict[int, TruthRecord] = {}

    def update(self, state: TouchState, truths: Sequence[TruthRecord]) -> None:
        """Compare the tracked touches of a reading with the simulated ones.

        `truths` holds the simulated touches that press during the reading.
        """
        stamp = state.reading.stamp
        self.felt = {
            number: truth
            for number, truth in self.felt.items()
            if stamp - truth.stamp <= LAG * NS_PER_S
        }
        self.felt |= {truth.touch: truth for truth in truths}
        for touch in state.closed:
            if touch.merged_into:
                heir = self.readings.setdefault(touch.merged_into, Counter())
                heir.update(self.readings.get(touch.id, Counter()))
        if not self.felt:
            return
        for touch in state.touches:
            if touch.last == stamp:
                self.add_reading(touch.id, touch.contact.p_world)

    def add_reading(self, touch: int, p_world: np.ndarray) -> None:
        """Add a reading of a tracked touch at a place [m]."""
        distances = {
            number: float(np.linalg.norm(p_world - np.array(truth.p_world)))
            for number, truth in self.felt.items()
        }
        nearest = min(distances, key=lambda number: distances[number])
        if distances[nearest] <= NEAR:
            self.readings.setdefault(touch, Counter())[nearest] += 1

    def find(self, touch: int) -> int | None:
        """Return the number of the simulated touch that causes a tracked one."""
        counts = self.readings.get(touch)
        return counts.most_common(1)[0][0] if counts else None


@final
@dataclass
class CommandScore:
    """Credits decisions of the policy to the simulated touches that caused them.

    A command counts for a touch if the tracked touch that gave it is that one, and if
    it comes within 1 s of its end. Only the first one counts. A further or later one,
    one of an accident, or one that no touch caused, is a false alarm. What the policy
    does by itself, such as a hold for a fault or to wait, is no command; a pause for a
    touch that was not recognised is one. A question is no command, and its answer
    belongs to the touch that asked; where a failed one pauses an arm that is paused
    already, that is no command either.
    """

    attempts: list[Attempt] = field(default_factory=list)
    """Touches that are meant as commands, oldest first."""
    accidents: list[Attempt] = field(default_factory=list)
    """Touches by accident, oldest first."""
    false_alarms: list[CommandEvent] = field(default_factory=list)
    """Executed commands that belong to no touch that is meant as a command."""
    commands: int = 0
    """Number of commands that were executed."""
    holds: int = 0
    """Number of times that the policy held the arm by itself."""
    asked: int = 0
    """Number of questions that the arm asked."""
    answered: int = 0
    """Number of questions whose answer was accepted."""
    question: CommandEvent | None = None
    """Latest question of the arm, until it is decided."""
    by_faults: list[CommandEvent] = field(default_factory=list)
    """Executed commands that no simulated touch caused: only a fault can have."""
    causes: TouchCauses = field(default_factory=TouchCauses)
    """Simulated touch of each tracked touch."""

    def add_attempt(self, attempt: Attempt) -> None:
        """Add a touch."""
        (self.accidents if attempt.gesture == NONE else self.attempts).append(attempt)

    def add_command(self, command: CommandEvent) -> None:
        """Add a decision about a command."""
        attempt = self.find_attempt(command.touch, command.stamp)
        if not command.accepted:
            if attempt is not None:
                attempt.refusals.append(command)
            return
        if command.action == ASK:
            self.asked += 1
            self.question = command
            if attempt is not None:
                attempt.asked = command.stamp
            return
        if attempt is not None and command.action in (SUSPEND, *HALTING_ACTIONS):
            attempt.stopped = attempt.stopped or command.stamp
        own = command.gesture is None and command.action != "pause"
        if command.touch is None or own:
            self.holds += command.action == "hold"
            return
        if attempt is not None and attempt.changes_nothing(command):
            return
        self.commands += 1
        if self.question is not None and is_same_touch(self.question, command):
            self.answered += 1
            self.question = None
        if self.causes.find(command.touch) is None:
            self.by_faults.append(command)
        fits = attempt is not None and attempt.command is None
        if attempt is not None and fits:
            attempt.command = command
        if attempt is None or not fits or attempt.gesture == NONE:
            self.false_alarms.append(command)

    def add_detection(self, detection: Detection) -> None:
        """Add a detection."""
        attempt = self.find_attempt(detection.touch, detection.stamp)
        if attempt is not None:
            attempt.recognised.append(detection.gesture)

    def find_attempt(self, touch: int | None, stamp: int) -> Attempt | None:
        """Return the touch that causes a tracked one, if a time counts for it."""
        number = None if touch is None else self.causes.find(touch)
        if number is None:
            return None
        for attempt in (*reversed(self.attempts), *reversed(self.accidents)):
            if number in (attempt.number, attempt.answer):
                return attempt if attempt.covers(stamp) else None
        return None

    def count(self, outcome: Outcome) -> int:
        """Return the number of attempts with an outcome."""
        return sum(attempt.outcome == outcome for attempt in self.attempts)

    def count_unasked(self) -> Mapping[str, int]:
        """Return the numbers of false alarms that stop, slow and go on."""
        stops = sum(one.action in HALTING_ACTIONS for one in self.false_alarms)
        going_on = count_going_on(self.false_alarms)
        return {
            "unasked_stops": stops,
            "unasked_slow": len(self.false_alarms) - stops - going_on,
            "unasked_going_on": going_on,
        }

    def count_failures(self) -> dict[str, int]:
        """Return the number of attempts that failed for each reason, largest first."""
        reasons = Counter(attempt.failure for attempt in self.attempts)
        return {why: count for why, count in reasons.most_common() if why}

    def delays(self) -> list[float]:
        """Return the times from the end of correct attempts to their commands [s]."""
        return [
            attempt.delay
            for attempt in self.attempts
            if attempt.outcome == "correct" and attempt.delay is not None
        ]

    def stop_delays(self) -> list[float]:
        """Return the times from first contact to the stop of pauses [s].

        Only correct ones of an arm at work count.
        """
        return [
            (attempt.stopped - attempt.begin) / NS_PER_S
            for attempt in self.attempts
            if attempt.outcome == "correct"
            and attempt.works
            and attempt.stopped is not None
            and attempt.expected in HALTING_ACTIONS
        ]


def is_same_touch(one: CommandEvent, other: CommandEvent) -> bool:
    """Return whether two decisions are about the same touch."""
    return (one.touch, one.onset) == (other.touch, other.onset)


def count_going_on(commands: Sequence[CommandEvent]) -> int:
    """Return how many commands made the arm do more than before."""
    return sum(command.action not in REDUCING_ACTIONS for command in commands)


@final
class ScoreListener(Listener):
    """Adds tracked touches, detections and decisions to a score."""

    name = "judge"
    message_types = (RecognitionState, Detection, CommandEvent)
    size = 1
    drop = "never"

    def __init__(
        self, score: CommandScore, truths: Callable[[], Sequence[TruthRecord]]
    ) -> None:
        """Store the score to add to.

        `truths` returns the simulated touches that press during the latest scan.
        """
        self.score = score
        self.truths = truths

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Add a recognition state, a detection or a decision."""
        if isinstance(item, RecognitionState):
            self.score.causes.update(item.state, self.truths())
        elif isinstance(item, Detection):
            self.score.add_detection(item)
        elif isinstance(item, CommandEvent):
            self.score.add_command(item)

    def close(self) -> None:
        """Do nothing."""


def summarise_score(score: CommandScore) -> Mapping[str, int]:
    """Return the counts that a demonstration reports."""
    return {
        "touches": len(score.attempts),
        "correct": score.count("correct"),
        "wrong": score.count("wrong"),
        "missed": score.count("missed"),
        "accidents": len(score.accidents),
        "false_alarms": len(score.false_alarms),
        **score.count_unasked(),
        "commands_of_faults": len(score.by_faults),
        "going_on_by_faults": count_going_on(score.by_faults),
        "commands": score.commands,
        "holds": score.holds,
        "questions": score.asked,
        "answered": score.answered,
    }
