"""People who command an arm by touch, and touch it by accident between."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from eskin.command import ArmState, CommandMap, SimulatedArm
from eskin.command.action import resolved
from eskin.demo.score import GRACE, Score, Try
from eskin.recording import NONE
from eskin.sim.live.live_skin import LiveSkin, demo_person
from eskin.units import NS_PER_S

GESTURES = ("poke", "double_pat", "grab", "stroke")
TO_WAKE = 0.7
"""Share of touches on a paused arm which ask it to go on; one that is held obeys
nothing else, as everybody knows who works with it."""

ALONE = 1.0
"""How long people leave an arm alone that has just been paused, or has gone into
protective stop [s]."""


@dataclass(frozen=True)
class VisitorConfig:
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
class Visitor:
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
        config: VisitorConfig | None = None,
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
        self.config = config or VisitorConfig()
        self.seed = seed
        self.rng = np.random.default_rng([seed, 1907])
        self.score = Score()
        self.accidents = 0
        self.unlocked = 0
        self.people = 0
        self.next: int | None = None
        self.leaves = 0
        self.touch: int | None = None
        self.attempt: Try | None = None
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
        self.attempt = Try(what, self.wanted(what, state), stamp)

    def choose(self, state: ArmState) -> str:
        """What to do next."""
        if self.rng.random() < self.config.accidents:
            return NONE
        if state.holding or (state.paused and self.rng.random() < TO_WAKE):
            return "poke"
        return str(self.rng.choice(GESTURES))

    def wanted(self, gesture: str, state: ArmState) -> str:
        """The action that a gesture asks for; which place it is on does not matter."""
        rule = self.commands.rule_for(gesture, "", "")
        return NONE if rule is None else resolved(rule.what, state)

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


def summary_of(score: Score) -> Mapping[str, int]:
    """The counts that a demonstration reports."""
    return {
        "touches": len(score.tries),
        "correct": score.count("correct"),
        "wrong": score.count("wrong"),
        "missed": score.count("missed"),
        "false_alarms": len(score.false_alarms),
        "commands": score.commands,
    }
