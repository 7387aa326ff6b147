"""Simulated users."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, final

import numpy as np

from eskin.command import ArmState, CommandMap, SimulatedArm
from eskin.command.actions import resolve_action
from eskin.live import Detection
from eskin.recording import NONE
from eskin.sim.interactive.skin import LiveSkin, demo_person
from eskin.stream import CommandEvent
from eskin.units import NS_PER_S

GRACE = 1.0
"""A command counts for a touch until so long after the touch's end [s]."""

Verdict = Literal["correct", "wrong", "missed"]


@dataclass
class Attempt:
    """A touch that asks for something."""

    gesture: str
    """What was done."""
    wanted: str
    """The action that it asks for."""
    begin: int
    """Stamp of its first contact [ns since the epoch]."""
    end: int | None = None
    """Stamp of its last contact; None while it goes on."""
    given: CommandEvent | None = None
    """The first command that was obeyed because of it."""
    refusals: list[CommandEvent] = field(default_factory=list)
    """What was understood but not obeyed, and why."""
    said: list[str] = field(default_factory=list)
    """What it was recognised as."""

    @property
    def verdict(self) -> Verdict:
        """What came of it."""
        if self.given is None:
            return "missed"
        return "correct" if self.given.action == self.wanted else "wrong"

    @property
    def lost(self) -> str:
        """Why it was not rightly obeyed, without the figures; empty where it was."""
        if self.verdict == "correct":
            return ""
        if self.refusals and self.given is None:
            return re.split(r"[:\d]", self.refusals[-1].why)[0].strip()
        others = [word for word in self.said if word != self.gesture]
        if others:
            return f"said to be {others[-1]}"
        return "the arm had changed meanwhile" if self.said else "nothing was said"

    @property
    def delay(self) -> float | None:
        """From its last contact to the command; negative if earlier [s]."""
        if self.given is None or self.end is None:
            return None
        return (self.given.stamp - self.end) / NS_PER_S

    def takes(self, stamp: int) -> bool:
        """Whether a command at that time counts for it."""
        over = self.end is not None and stamp > self.end + GRACE * NS_PER_S
        return self.begin <= stamp and not over


@final
@dataclass
class CommandScore:
    """Touches that ask for something beside the commands that were obeyed.

    A command counts for the touch that it comes during, or within 1 s of whose end; the
    first of them is what the touch did. One more, or one without a touch, is a false
    alarm. That the arm is held, for whatever reason, is no command.
    """

    tries: list[Attempt] = field(default_factory=list)
    """All touches that ask for something, oldest first."""
    false_alarms: list[CommandEvent] = field(default_factory=list)
    """Commands that nobody gave."""
    commands: int = 0
    """All commands that were obeyed."""
    holds: int = 0
    """How often the arm was held without being asked."""

    def add(self, attempt: Attempt) -> None:
        """Begin a touch."""
        self.tries.append(attempt)

    def on_message(self, command: CommandEvent) -> None:
        """Take in what was decided."""
        if not command.accepted:
            latest = self.latest(command.stamp)
            if latest is not None:
                latest.refusals.append(command)
            return
        if command.touch is None:
            self.holds += 1
            return
        self.commands += 1
        latest = self.latest(command.stamp)
        if latest is None or latest.given is not None:
            self.false_alarms.append(command)
        else:
            latest.given = command

    def note(self, detection: Detection) -> None:
        """Take in what was recognised."""
        latest = self.latest(detection.stamp)
        if latest is not None:
            latest.said.append(detection.gesture)

    def latest(self, stamp: int) -> Attempt | None:
        """The latest touch that a decision at that time counts for."""
        return next((t for t in reversed(self.tries) if t.takes(stamp)), None)

    def count(self, verdict: Verdict) -> int:
        """How many touches came to that."""
        return sum(attempt.verdict == verdict for attempt in self.tries)

    def lost(self) -> dict[str, int]:
        """Why touches were not rightly obeyed, and how many; most frequent first."""
        reasons = Counter(attempt.lost for attempt in self.tries)
        return {why: count for why, count in reasons.most_common() if why}

    def delays(self) -> list[float]:
        """From the end of each touch rightly obeyed to its command [s]."""
        return [
            attempt.delay
            for attempt in self.tries
            if attempt.verdict == "correct" and attempt.delay is not None
        ]


GESTURES = ("poke", "double_pat", "grab", "stroke")
TO_WAKE = 0.7
"""Share of touches on a paused arm which ask it to go on; one that is held obeys
nothing else, as everybody knows who works with it."""

ALONE = 1.0
"""How long people leave an arm alone that has just been paused, or has gone into
protective stop [s]."""


@dataclass(frozen=True)
class SimulatedUserConfig:
    """How often an arm is touched.

    Nobody touches an arm within a second of its being paused: it could not go on yet,
    as everybody knows who works with it. One in protective stop is unlocked first.
    """

    first: float = 4.0
    """When the first touch comes, after the skin is tared [s]."""

    pause: tuple[float, float] = (0.6, 0.8)
    """Least and longest time from one touch to the next [s]."""

    accidents: float = 0.35
    """Share of touches that happen by accident."""

    patience: float = 45.0
    """How long one person stays [s]."""


@final
class SimulatedUser:
    """Touches a live skin one touch at a time, in turn with other people.

    None of them is of a set that recognisers are trained or tested on. What a touch
    asks for is what the command map says of its gesture in the state that the arm is
    in when it begins. Who finds the arm standing mostly asks it to go on.

    Attributes:
        score: of the touches that ask for something.
        accidents: how many did not.
        unlocked: how often the arm was in protective stop, and had to be unlocked.
        stays: whether more touches are to come.
    """

    def __init__(
        self,
        skin: LiveSkin,
        arm: SimulatedArm,
        commands: CommandMap,
        seed: int = 0,
        config: SimulatedUserConfig | None = None,
    ) -> None:
        """Come, and wait.

        Args:
            skin: to touch.
            arm: that wears it.
            commands: what touches ask for.
            seed: decides who comes and what they do.
            config: how often they touch.
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
        self.next: int | None = None
        self.leaves = 0
        self.touch: int | None = None
        self.attempt: Attempt | None = None
        self.stays = True
        self.alone_since: int | None = None
        self.quiet = 0

    def come(self, stamp: int) -> None:
        """What happens before the scan at a time.

        Args:
            stamp: of that scan [ns since the epoch].
        """
        state = self.arm.state()
        if self.next is None:
            self.next = stamp + round(self.config.first * NS_PER_S)
        stands = state.paused or state.protective_stop
        since = self.alone_since if self.alone_since is not None else stamp
        self.alone_since = since if stands else None
        waits = stands and stamp - since < ALONE * NS_PER_S
        if self.touch is not None:
            self.go_on(stamp)
        elif state.protective_stop:
            if not waits:
                self.arm.unlock()
                self.unlocked += 1
        elif self.stays and stamp >= self.next and not waits:
            self.begin(stamp, state)

    def is_touching(self, stamp: int) -> bool:
        """Whether a touch goes on, or its command may still come."""
        return self.touch is not None or stamp <= self.quiet

    def begin(self, stamp: int, state: ArmState) -> None:
        """Touch, on purpose or by accident."""
        if stamp >= self.leaves:
            person = demo_person(self.skin.world, 1000 * self.seed + self.people)
            self.skin.hand.person = person
            self.people += 1
            self.leaves = stamp + round(self.config.patience * NS_PER_S)
        what = self.choose(state)
        self.touch = self.skin.hand.perform(what)
        self.begun = False
        if what == NONE:
            self.accidents += 1
            self.attempt = None
            return
        self.attempt = Attempt(what, self.wanted(what, state), stamp)

    def choose(self, state: ArmState) -> str:
        """What to do next."""
        if self.rng.random() < self.config.accidents:
            return NONE
        if state.hold_reason or (state.paused and self.rng.random() < TO_WAKE):
            return "poke"
        return str(self.rng.choice(GESTURES))

    def wanted(self, gesture: str, state: ArmState) -> str:
        """The action that a gesture asks for; which place it is on does not matter."""
        rule = self.commands.find_rule(gesture, "", "")
        return NONE if rule is None else resolve_action(rule.action_or_function, state)

    def go_on(self, stamp: int) -> None:
        """Follow the touch under way until it is over."""
        hand = self.skin.hand
        pressing = any(record.touch == self.touch for record in hand.truths())
        if pressing and not self.begun and self.attempt is not None:
            self.attempt.begin = stamp
            self.score.add(self.attempt)
        self.begun = self.begun or pressing
        if pressing and self.attempt is not None:
            self.last = stamp
        if self.touch not in hand.touching:
            self.finish(stamp)

    def finish(self, stamp: int) -> None:
        """End a touch; another comes after a while."""
        if self.attempt is not None and self.begun:
            self.attempt.end = self.last
        self.touch = self.attempt = None
        self.quiet = stamp + round(GRACE * NS_PER_S)
        self.next = stamp + round(NS_PER_S * self.rng.uniform(*self.config.pause))


def summarise_score(score: CommandScore) -> Mapping[str, int]:
    """The counts that a demonstration reports."""
    return {
        "touches": len(score.tries),
        "correct": score.count("correct"),
        "wrong": score.count("wrong"),
        "missed": score.count("missed"),
        "false_alarms": len(score.false_alarms),
        "commands": score.commands,
    }
