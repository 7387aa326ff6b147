"""This module simulates users who touch an arm, and scores what the arm does."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, final

import numpy as np

from eskin.command import ArmState, CommandMap, SimulatedArm, resolve_action
from eskin.live import Detection
from eskin.recording import NONE
from eskin.sim.interactive import InteractiveSkin, draw_demo_person
from eskin.stream import CommandEvent
from eskin.units import NS_PER_S

GRACE = 1.0
"""Time after the end of a touch in which a command still counts for it [s]."""

Outcome = Literal["correct", "wrong", "missed"]


@dataclass
class Attempt:
    """Describes a touch that is meant as a command, with its outcome."""

    gesture: str
    """Gesture that was made."""
    expected: str
    """Action that the command map assigns to it."""
    begin: int
    """Stamp of its first contact [ns since the epoch]."""
    end: int | None = None
    """Stamp of its last contact; None while it lasts."""
    command: CommandEvent | None = None
    """First command that was executed because of it."""
    refusals: list[CommandEvent] = field(default_factory=list)
    """Commands that were recognised but refused, and why."""
    recognised: list[str] = field(default_factory=list)
    """Gestures that it was recognised as."""

    @property
    def outcome(self) -> Outcome:
        """Whether the expected command, another or none was executed."""
        if self.command is None:
            return "missed"
        return "correct" if self.command.action == self.expected else "wrong"

    @property
    def failure(self) -> str:
        """Why the outcome is not correct, without numbers; empty if it is correct."""
        if self.outcome == "correct":
            return ""
        if self.refusals and self.command is None:
            return re.split(r"[:\d]", self.refusals[-1].why)[0].strip()
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

    def covers(self, stamp: int) -> bool:
        """Return whether a command at a time counts for it."""
        over = self.end is not None and stamp > self.end + GRACE * NS_PER_S
        return self.begin <= stamp and not over


@final
@dataclass
class CommandScore:
    """Matches executed commands with attempts.

    A command counts for a touch if it comes during the touch or within 1 s of its end.
    Only the first one counts; a further one, or one without a touch, is a false alarm.
    A hold of the arm is not a command.
    """

    attempts: list[Attempt] = field(default_factory=list)
    """All attempts, oldest first."""
    false_alarms: list[CommandEvent] = field(default_factory=list)
    """Executed commands that belong to no touch."""
    commands: int = 0
    """Number of commands that were executed."""
    holds: int = 0
    """Number of holds of the arm."""

    def add(self, attempt: Attempt) -> None:
        """Add an attempt."""
        self.attempts.append(attempt)

    def add_command(self, command: CommandEvent) -> None:
        """Add a decision about a command."""
        if not command.accepted:
            latest = self.find_attempt(command.stamp)
            if latest is not None:
                latest.refusals.append(command)
            return
        if command.touch is None:
            self.holds += 1
            return
        self.commands += 1
        latest = self.find_attempt(command.stamp)
        if latest is None or latest.command is not None:
            self.false_alarms.append(command)
        else:
            latest.command = command

    def add_detection(self, detection: Detection) -> None:
        """Add a detection."""
        latest = self.find_attempt(detection.stamp)
        if latest is not None:
            latest.recognised.append(detection.gesture)

    def find_attempt(self, stamp: int) -> Attempt | None:
        """Return the latest attempt that a decision at a time counts for."""
        return next((t for t in reversed(self.attempts) if t.covers(stamp)), None)

    def count(self, outcome: Outcome) -> int:
        """Return the number of attempts with an outcome."""
        return sum(attempt.outcome == outcome for attempt in self.attempts)

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


GESTURES = ("poke", "double_pat", "grab", "stroke")
RESUME_SHARE = 0.7
"""Share of touches on a paused arm that are meant to resume it. On a held arm all are:
it executes nothing else, and its users know that."""

STOP_SECONDS = 1.0
"""Time for which nobody touches an arm after a pause or a protective stop [s]."""


@dataclass(frozen=True)
class SimulatedUserConfig:
    """Sets how often an arm is touched.

    Nobody touches an arm within a second of a pause, because it could not resume yet.
    An arm in protective stop is unlocked first.
    """

    first: float = 4.0
    """Time of the first touch, after the skin is tared [s]."""
    pause: tuple[float, float] = (0.6, 0.8)
    """Least and longest time from one touch to the next [s]."""
    accidents: float = 0.35
    """Share of touches that happen by accident."""
    person_seconds: float = 45.0
    """Time after which another person takes over [s]."""


@final
class SimulatedUser:
    """Touches a simulated skin, one touch at a time, as several people in turn.

    None of these people is in a data set for training or tests. The expected action of
    a touch follows from the command map and the state of the arm when the touch begins.
    On a paused arm most touches are meant to resume it.

    Attributes:
        score: score of the touches that are meant as commands.
        accidents: number of accidental touches.
        unlocked: number of protective stops that were unlocked.
        active: whether further touches may begin.
    """

    def __init__(
        self,
        skin: InteractiveSkin,
        arm: SimulatedArm,
        commands: CommandMap,
        seed: int = 0,
        config: SimulatedUserConfig | None = None,
    ) -> None:
        """Wait for the first touch.

        Args:
            skin: the skin that is touched.
            arm: the arm that wears it.
            commands: command map.
            seed: seed of the people and their touches.
            config: rates of touches.
        """
        self.skin = skin
        self.arm = arm
        self.commands = commands
        self.config = config or SimulatedUserConfig()
        self.seed = seed
        self.rng = np.random.default_rng([seed, 1907])
        self.score = CommandScore()
        self.accidents = 0
        self.unlocked = 0
        self.people = 0
        self.next_touch: int | None = None
        self.person_until = 0
        self.touch: int | None = None
        self.attempt: Attempt | None = None
        self.active = True
        self.stopped_since: int | None = None
        self.grace_until = 0

    def update(self, stamp: int) -> None:
        """Begin, continue or end a touch before the scan at a time.

        Args:
            stamp: time of that scan [ns since the epoch].
        """
        state = self.arm.state()
        if self.next_touch is None:
            self.next_touch = stamp + round(self.config.first * NS_PER_S)
        stands = state.paused or state.protective_stop
        since = self.stopped_since if self.stopped_since is not None else stamp
        self.stopped_since = since if stands else None
        waits = stands and stamp - since < STOP_SECONDS * NS_PER_S
        if self.touch is not None:
            self.continue_touch(stamp)
        elif state.protective_stop:
            if not waits:
                self.arm.unlock()
                self.unlocked += 1
        elif self.active and stamp >= self.next_touch and not waits:
            self.begin_touch(stamp, state)

    def is_touching(self, stamp: int) -> bool:
        """Return whether a touch lasts, or its command may still come."""
        return self.touch is not None or stamp <= self.grace_until

    def begin_touch(self, stamp: int, state: ArmState) -> None:
        """Begin a touch, on purpose or by accident."""
        if stamp >= self.person_until:
            person = draw_demo_person(self.skin.env, 1000 * self.seed + self.people)
            self.skin.hand.person = person
            self.people += 1
            self.person_until = stamp + round(self.config.person_seconds * NS_PER_S)
        gesture = self.choose_gesture(state)
        self.touch = self.skin.hand.perform(gesture)
        self.in_contact = False
        if gesture == NONE:
            self.accidents += 1
            self.attempt = None
            return
        expected = self.find_expected(gesture, state)
        self.attempt = Attempt(gesture, expected, stamp)

    def choose_gesture(self, state: ArmState) -> str:
        """Draw the next gesture; `none` for an accident."""
        if self.rng.random() < self.config.accidents:
            return NONE
        if state.hold_reason or (state.paused and self.rng.random() < RESUME_SHARE):
            return "poke"
        return str(self.rng.choice(GESTURES))

    def find_expected(self, gesture: str, state: ArmState) -> str:
        """Return the action of a gesture, for any place on the skin."""
        rule = self.commands.find_rule(gesture, "", "")
        return NONE if rule is None else resolve_action(rule.action_or_function, state)

    def continue_touch(self, stamp: int) -> None:
        """Follow the present touch until it is over."""
        hand = self.skin.hand
        pressing = any(record.touch == self.touch for record in hand.truths())
        if pressing and not self.in_contact and self.attempt is not None:
            self.attempt.begin = stamp
            self.score.add(self.attempt)
        self.in_contact = self.in_contact or pressing
        if pressing and self.attempt is not None:
            self.last = stamp
        if self.touch not in hand.touching:
            self.end_touch(stamp)

    def end_touch(self, stamp: int) -> None:
        """End the present touch and schedule the next."""
        if self.attempt is not None and self.in_contact:
            self.attempt.end = self.last
        self.touch = self.attempt = None
        self.grace_until = stamp + round(GRACE * NS_PER_S)
        self.next_touch = stamp + round(NS_PER_S * self.rng.uniform(*self.config.pause))


def summarise_score(score: CommandScore) -> Mapping[str, int]:
    """Return the counts that a demonstration reports."""
    return {
        "touches": len(score.attempts),
        "correct": score.count("correct"),
        "wrong": score.count("wrong"),
        "missed": score.count("missed"),
        "false_alarms": len(score.false_alarms),
        "commands": score.commands,
    }
