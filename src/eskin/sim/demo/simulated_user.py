"""This module simulates users who touch an arm that works."""

from dataclasses import dataclass
from typing import final

import numpy as np

from eskin.command import ArmState, CommandMap, resolve_action
from eskin.recording import NONE
from eskin.sim.arm import SimulatedArm
from eskin.sim.demo.score import GRACE, Attempt, CommandScore
from eskin.sim.interactive import InteractiveSkin, draw_demo_person
from eskin.units import NS_PER_S

GESTURES = ("poke", "double_pat", "grab", "stroke")
RESUME_SHARE = 0.7
"""Share of touches on a paused arm that are meant to resume it. On a held arm all are
meant to pause it and then to resume it: it executes nothing else, and its users know
that."""

STOP_SECONDS = 1.0
"""Time for which nobody touches an arm after a pause or a protective stop, or a stopped
arm after a touch [s]."""


@dataclass(frozen=True)
class SimulatedUserConfig:
    """Sets how often an arm is touched.

    Nobody touches an arm within a second of a pause, or a stopped one of another touch,
    because it could not resume yet.
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
    They make gestures for which the map has a rule. On a paused arm most touches are
    meant to resume it; a stop that no gesture of the map ends is ended by the button.

    Attributes:
        score: score of the touches, those by accident among them.
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
        """Wait for the first touch."""
        self.skin = skin
        self.arm = arm
        self.commands = commands
        self.config = config or SimulatedUserConfig()
        self.seed = seed
        self.rng = np.random.default_rng([seed, 1907])
        self.score = CommandScore()
        self.unlocked = 0
        self.people = 0
        self.next_touch: int | None = None
        self.person_until = 0
        self.touch: int | None = None
        self.attempt: Attempt | None = None
        self.active = True
        self.stopped_since: int | None = None
        self.pause_count = 0
        self.grace_until = 0

    def update(self, stamp: int) -> None:
        """Begin, continue or end a touch before the scan at a time.

        `stamp` is the time of that scan [ns since the epoch].
        """
        state = self.arm.state()
        if self.next_touch is None:
            self.next_touch = stamp + round(self.config.first * NS_PER_S)
        is_suspended = state.paused or state.protective_stop
        since = self.stopped_since
        if since is None or self.touch is not None:
            since = stamp
        if state.pause_count != self.pause_count:
            since, self.pause_count = stamp, state.pause_count
        self.stopped_since = since if is_suspended else None
        keeps_off = is_suspended and stamp - since < STOP_SECONDS * NS_PER_S
        if self.touch is not None:
            self.continue_touch(stamp)
        elif state.protective_stop:
            if not keeps_off:
                self.arm.unlock()
                self.unlocked += 1
        elif self.active and stamp >= self.next_touch and not keeps_off:
            if self.is_stuck(state):
                self.press_resume(stamp)
            else:
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
        expected = self.find_expected(gesture, state)
        works = not state.stopped
        self.attempt = Attempt(gesture, expected, stamp, number=self.touch, works=works)

    def choose_gesture(self, state: ArmState) -> str:
        """Draw the next gesture; `none` for an accident."""
        if self.rng.random() < self.config.accidents:
            return NONE
        wanted = ""
        if state.paused and (state.hold_reason or self.rng.random() < RESUME_SHARE):
            wanted = "resume"
        elif state.hold_reason:
            wanted = "pause"
        words = self.list_asking(wanted, state) or [
            word for word in GESTURES if self.find_expected(word, state) != NONE
        ]
        return str(self.rng.choice(words or GESTURES))

    def list_asking(self, action: str, state: ArmState) -> list[str]:
        """Return the gestures that ask for an action."""
        return [word for word in GESTURES if self.find_expected(word, state) == action]

    def is_stuck(self, state: ArmState) -> bool:
        """Return whether no gesture of the map helps a stopped arm to go on."""
        needed = "resume" if state.paused else "pause"
        return state.stopped and not self.list_asking(needed, state)

    def press_resume(self, stamp: int) -> None:
        """Let the arm go on, as the button of the page does."""
        self.arm.release()
        self.arm.resume()
        self.schedule_touch(stamp)

    def schedule_touch(self, stamp: int) -> None:
        """Schedule the next touch."""
        self.next_touch = stamp + round(NS_PER_S * self.rng.uniform(*self.config.pause))

    def find_expected(self, gesture: str, state: ArmState) -> str:
        """Return the action of a gesture, or none, for any place on the skin."""
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
        if pressing:
            self.last = stamp
        if self.touch not in hand.touching:
            self.end_touch(stamp)

    def end_touch(self, stamp: int) -> None:
        """End the present touch and schedule the next."""
        if self.attempt is not None and self.in_contact:
            self.attempt.end = self.last
        self.touch = self.attempt = None
        self.grace_until = stamp + round(GRACE * NS_PER_S)
        self.schedule_touch(stamp)
