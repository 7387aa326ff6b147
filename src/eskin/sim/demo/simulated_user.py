"""This module simulates users who touch an arm that works, and answer its questions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from eskin.arms import SimulatedArm
from eskin.command import ArmState, CommandMap, Question, resolve_action
from eskin.recording import NONE, TruthRecord
from eskin.sim.demo.score import GRACE, Attempt, CommandScore
from eskin.sim.interactive import InteractiveSkin, LinkPoint, draw_demo_person
from eskin.units import NS_PER_S

GESTURES = ("poke", "double_pat", "grab", "stroke")
RESUME_SHARE = 0.7
"""Share of touches on a paused arm that are meant to resume it. On a held arm all are
meant to pause it and then to resume it: it executes nothing else, and its users know
that."""

STOP_SECONDS = 1.0
"""Time for which nobody touches an arm after a pause or a protective stop, or a stopped
arm after a touch, and before a touch that asks for more [s]."""

FAILED_SECONDS = 5.0
"""The same after a question of the arm that was not answered [s]."""

REACTION = (0.35, 0.8)
"""Shortest and longest time from a question to the first contact of its answer [s]."""

FORGOTTEN_SHARE = 0.05
"""Share of questions that nobody answers."""

MISTAKEN_SHARE = 0.05
"""Share of questions that are answered by another gesture."""

FORGOT = "forgot to answer"
MISTOOK = "answered by another gesture"

NEAR_METRES = 0.08
"""Greatest distance of an answer from the centre of the touch that asked [m]."""


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

    Where an action must be asked for, they leave the skin alone for a second, make its
    gesture, wait for the question and answer it on the same link. A few forget, or make
    another gesture. After a question that failed they ask for nothing until the skin
    was left alone for five seconds.

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
        question: Callable[[], Question | None] = lambda: None,
    ) -> None:
        """Wait for the first touch.

        Args:
            skin: skin that is touched.
            arm: arm that wears it.
            commands: what each touch commands.
            seed: seed of people and their touches.
            config: how often they touch.
            question: returns the question that the arm asks now, or None.
        """
        self.skin = skin
        self.arm = arm
        self.commands = commands
        self.config = config or SimulatedUserConfig()
        self.question = question
        self.seed = seed
        self.rng = np.random.default_rng([seed, 1907])
        self.score = CommandScore()
        self.unlocked = 0
        self.people = 0
        self.next_touch: int | None = None
        self.person_until = 0
        self.touch: int | None = None
        self.attempt: Attempt | None = None
        self.planned: str | None = None
        self.answer_at: int | None = None
        self.active = True
        self.asks = False
        self.is_asked = False
        self.has_failed = False
        self.answered = 0
        self.is_stopped = False
        self.pause_count = 0
        self.quiet_since = 0
        self.grace_until = 0

    def update(self, stamp: int) -> None:
        """Begin, continue or end a touch before the scan at a time.

        `stamp` is the time of that scan [ns since the epoch].
        """
        state = self.arm.state()
        if self.next_touch is None:
            self.next_touch = stamp + round(self.config.first * NS_PER_S)
        self.watch_light(stamp)
        self.watch_arm(stamp, state)
        if self.touch is not None:
            self.continue_touch(stamp)
        elif self.attempt is not None:
            self.follow_question(stamp, self.attempt)
        elif self.is_stopped and not self.may_ask(stamp):
            return
        elif state.protective_stop:
            self.arm.unlock()
            self.unlocked += 1
        elif self.active and stamp >= self.next_touch:
            if self.is_stuck(state):
                self.press_resume(stamp)
            else:
                self.begin_touch(stamp, state)

    def watch_light(self, stamp: int) -> None:
        """Notice that a question was not answered well: its light goes out, no more."""
        was_asked = self.is_asked
        self.is_asked = self.question() is not None
        if was_asked and not self.is_asked and self.score.answered == self.answered:
            self.has_failed = True
            self.quiet_since = stamp
        self.answered = self.score.answered

    def watch_arm(self, stamp: int, state: ArmState) -> None:
        """Notice since when nobody touches the skin, and a stopped arm stands."""
        was_stopped = self.is_stopped
        self.is_stopped = state.paused or state.protective_stop
        is_paused_again = state.pause_count != self.pause_count
        self.pause_count = state.pause_count
        stops = self.is_stopped and not was_stopped
        if stops:
            self.planned = None
        if stops or is_paused_again or self.touch is not None:
            self.quiet_since = stamp
        elif self.may_ask(stamp):
            self.has_failed = False

    def may_ask(self, stamp: int) -> bool:
        """Return whether the skin was left alone for long enough to ask for more."""
        least = FAILED_SECONDS if self.has_failed else STOP_SECONDS
        return stamp - self.quiet_since >= least * NS_PER_S

    def is_touching(self, stamp: int) -> bool:
        """Return whether a touch lasts, or its command may still come."""
        return self.attempt is not None or stamp <= self.grace_until

    def begin_touch(self, stamp: int, state: ArmState) -> None:
        """Begin a touch, on purpose or by accident, once its gesture may be made."""
        gesture = self.planned or self.choose_gesture(state)
        expected = self.find_expected(gesture, state)
        self.planned = gesture
        self.asks = self.is_asking(gesture, state)
        must_wait = self.asks and not self.may_ask(stamp)
        if gesture != NONE and (must_wait or self.is_asked):
            return
        self.planned = None
        if stamp >= self.person_until:
            person = draw_demo_person(self.skin.env, 1000 * self.seed + self.people)
            self.skin.hand.person = person
            self.people += 1
            self.person_until = stamp + round(self.config.person_seconds * NS_PER_S)
        self.touch = self.skin.hand.perform(gesture)
        self.in_contact = False
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
            word for word in GESTURES if self.is_meant(word, state)
        ]
        return str(self.rng.choice(words or GESTURES))

    def is_meant(self, gesture: str, state: ArmState) -> bool:
        """Return whether people make a gesture now, for an action of the map."""
        is_useless = self.has_failed and self.is_asking(gesture, state)
        return self.find_expected(gesture, state) != NONE and not is_useless

    def list_asking(self, action: str, state: ArmState) -> list[str]:
        """Return the gestures that ask for an action."""
        return [word for word in GESTURES if self.find_expected(word, state) == action]

    def is_asking(self, gesture: str, state: ArmState) -> bool:
        """Return whether the arm asks back before it does what a gesture asks for."""
        rule = self.commands.find_rule(gesture, "", "")
        action = self.find_expected(gesture, state)
        return rule is not None and self.commands.needs_answer(rule, action)

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
        attempt = self.attempt
        assert attempt is not None
        truths = [record for record in hand.truths() if record.touch == self.touch]
        if truths and not self.in_contact and attempt.answer is None:
            attempt.begin = stamp
            self.score.add_attempt(attempt)
        if truths:
            if not self.in_contact or truths[0].force > self.strongest.force:
                self.strongest = truths[0]
            self.in_contact = True
            self.last = stamp
        if self.touch not in hand.touching:
            self.end_touch(stamp, attempt)

    def end_touch(self, stamp: int, attempt: Attempt) -> None:
        """End the present touch; wait for a question where it asks for one."""
        if self.in_contact:
            attempt.end = self.last
        self.touch = None
        self.grace_until = stamp + round(GRACE * NS_PER_S)
        if not self.asks:
            self.end_attempt(stamp)

    def end_attempt(self, stamp: int) -> None:
        """Schedule the next touch."""
        self.attempt = self.answer_at = None
        self.schedule_touch(stamp)

    def follow_question(self, stamp: int, attempt: Attempt) -> None:
        """Wait until the arm asks, answer, and wait until its light goes out."""
        question = self.question()
        if question is None or attempt.asked is None:
            is_decided = attempt.asked is not None or attempt.command is not None
            if is_decided or stamp > self.grace_until:
                self.end_attempt(stamp)
        elif self.answer_at is None:
            reaction = self.rng.uniform(*REACTION)
            self.answer_at = question.asked_at + round(reaction * NS_PER_S)
            self.gesture = self.choose_answer(question, attempt)
        elif attempt.answer is None and self.gesture and stamp >= self.answer_at:
            place = draw_place(self.skin, self.strongest, self.rng)
            self.touch = self.skin.hand.perform(self.gesture, place)
            self.in_contact = False
            attempt.answer = self.touch
            attempt.end = None

    def choose_answer(self, question: Question, attempt: Attempt) -> str:
        """Draw the gesture of an answer; empty where the person forgets."""
        chance = self.rng.random()
        if chance < FORGOTTEN_SHARE:
            attempt.mistake = FORGOT
            return ""
        if chance < FORGOTTEN_SHARE + MISTAKEN_SHARE:
            attempt.mistake = MISTOOK
            others = [word for word in GESTURES if word != question.answer]
            return str(self.rng.choice(others))
        return question.answer


def draw_place(
    skin: InteractiveSkin, touched: TruthRecord, rng: np.random.Generator
) -> LinkPoint:
    """Draw where a person answers: on the link that was touched, near that place."""
    mounted = skin.mounted
    p_world, _ = mounted.place_taxels(skin.hand.q)
    names = np.array(mounted.skin.link_names)[np.asarray(mounted.skin.patch_index)]
    on_link = np.flatnonzero(names == touched.link)
    away = np.linalg.norm(p_world[on_link] - np.array(touched.p_world), axis=1)
    near = on_link[away <= max(NEAR_METRES, float(away.min()))]
    return LinkPoint(touched.link, mounted.skin.positions[int(rng.choice(near))])
