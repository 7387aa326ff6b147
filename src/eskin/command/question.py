"""This module defines the question that an arm asks before it does more.

What counts as an answer reads as a list of conditions, each of which returns why a
touch does not fulfil it, or None where it does.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import final

from eskin.command.actions import MIN_CONFIDENCE
from eskin.command.command_map import NON_GESTURES
from eskin.command.commanded_touch import (
    CommandedTouch,
    CommandedTouches,
    CommandRequest,
)
from eskin.command.reasons import Refusal, Trigger
from eskin.live import Detection
from eskin.reasons import Reason
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class QuestionConfig:
    """A question configuration says what counts as a question and as its answer.

    The values are chosen from data (`lab/notes/policy.md`).
    """

    quiet: float = 1.0
    """How long no other touch must have pressed the skin, and an arm that stands have
    stood, before the touch begins that asks; and how long after that touch something
    may still press the skin [s]."""

    quiet_after_failure: float = 5.0
    """How long nothing must have pressed the skin after a question that was not
    answered, before the next touch that asks begins [s]."""

    window: float = 1.0
    """Longest time from the question to the first contact of the answer [s]."""

    least_delay: float = 0.25
    """Shortest such time, since nobody sees or hears it and reaches out faster [s]."""

    min_seconds: float = 0.12
    """Shortest time from the first to the latest contact of the answer [s]; most hits
    of things are briefer."""

    max_seconds: float = 1.5
    """Longest such time [s]."""

    quiet_after_answer: float = 0.7
    """How long nothing must have pressed the skin after the answer, before what was
    asked for is done [s]."""

    jog_seconds: float = 20.0
    """Time after an answered jog in which further jogs are not asked for [s]."""


@final
@dataclass(eq=False)
class Question:
    """A question is open from the moment at which the arm asks until it is decided."""

    request: CommandRequest
    """What was asked for."""

    answer: str
    """Gesture that answers."""

    vocabulary: tuple[str, ...]
    """Gestures of the model, in the order of the probabilities."""

    asked_at: int
    """When the arm asked [ns since the epoch]."""

    before: tuple[CommandedTouch, ...]
    """Touches that had left the skin just then."""

    links: Mapping[str, str]
    """Link of each patch."""

    config: QuestionConfig
    """What counts as its answer."""

    touch: CommandedTouch | None = None
    """Touch that may be the answer; None before it begins."""

    detections: list[tuple[CommandedTouch, Detection]] = field(default_factory=list)
    """What was detected in touches since the question."""

    @property
    def deadline(self) -> int:
        """By when the answer must have begun [ns since the epoch]."""
        return self.asked_at + round(self.config.window * NS_PER_S)

    @property
    def is_answering(self) -> bool:
        """Whether a touch that may be the answer has begun."""
        return self.touch is not None

    @property
    def reason(self) -> Reason:
        """What the arm asks, such as `resume? answer by a poke there within 1 s`."""
        return Trigger.QUESTION.reason(
            action=self.request.rule.function or self.request.action.replace("_", " "),
            answer=self.answer.replace("_", " "),
            window=self.config.window,
        )

    def refuse(self, refusal: Refusal, **values: object) -> Reason:
        """Return why it is refused, and when the arm can be asked again."""
        return refusal.reason(
            answer=self.answer.replace("_", " "),
            again=self.config.quiet_after_failure,
            **values,
        )

    def find_refusal(self, touches: CommandedTouches) -> Reason | None:
        """Return why it is refused by now, or None where it is not.

        Args:
            touches: touches of the latest reading.
        """
        while self.touch is not None and self.touch.heir is not None:
            self.touch = self.touch.heir
        for touch in touches.by_id.values():
            is_left = touch in self.before and not touch.is_present
            is_merged = touch.heir is not None
            is_new = touch.onset is not None and not (is_left or is_merged)
            if is_new and touch is not self.touch:
                refusal = self.find_first(WHEN_IT_BEGINS, touch)
                if refusal is not None:
                    return refusal
                self.touch = touch
        if self.touch is None:
            if touches.latest <= self.deadline:
                return None
            return self.refuse(Refusal.NO_ANSWER)
        conditions = WHILE_IT_LASTS if self.touch.is_present else WHEN_IT_HAS_LEFT
        return self.find_first(conditions, self.touch)

    def find_first(
        self, conditions: tuple["AnswerCondition", ...], touch: CommandedTouch
    ) -> Reason | None:
        """Return why a touch does not fulfil the first of some conditions, or None."""
        for condition in conditions:
            refusal = condition(self, touch)
            if refusal is not None:
                return refusal
        return None

    def is_answered(self, now: int) -> bool:
        """Return whether it is answered, if nothing refuses it.

        Args:
            now: stamp of the latest reading [ns since the epoch].
        """
        if self.touch is None or self.touch.is_present:
            return False
        return now - self.touch.last >= self.config.quiet_after_answer * NS_PER_S


AnswerCondition = Callable[[Question, CommandedTouch], Reason | None]
"""Returns why a touch does not fulfil it, or None where it does."""


def answer_is_one_touch(question: Question, touch: CommandedTouch) -> Reason | None:
    """No other touch has begun to answer."""
    if question.touch is None:
        return None
    return question.refuse(Refusal.TWO_ANSWERS)


def answer_follows_question(question: Question, touch: CommandedTouch) -> Reason | None:
    """It begins as long after the question as a person needs to see or hear it."""
    least = question.asked_at + question.config.least_delay * NS_PER_S
    if (touch.onset or 0) >= least:
        return None
    return question.refuse(Refusal.TOUCHED_BEFORE_QUESTION)


def answer_is_in_time(question: Question, touch: CommandedTouch) -> Reason | None:
    """It begins before the deadline."""
    if (touch.onset or 0) <= question.deadline:
        return None
    return question.refuse(Refusal.LATE_ANSWER)


def answer_is_gentle(question: Question, touch: CommandedTouch) -> Reason | None:
    """It never exceeds the limits of force."""
    if touch.excess is None:
        return None
    return question.refuse(Refusal.STRONG_ANSWER, problem=touch.excess.what)


def answer_ends(question: Question, touch: CommandedTouch) -> Reason | None:
    """It does not last for long."""
    longest = question.config.max_seconds
    if touch.duration <= longest:
        return None
    return question.refuse(Refusal.LONG_ANSWER, seconds=longest)


def answer_is_no_hit(question: Question, touch: CommandedTouch) -> Reason | None:
    """It lasts longer than most hits of things."""
    if touch.duration >= question.config.min_seconds:
        return None
    return question.refuse(Refusal.BRIEF_ANSWER, seconds=touch.duration)


def answer_is_there(question: Question, touch: CommandedTouch) -> Reason | None:
    """It is on the link of the touch that asked."""
    link = question.request.detection.link
    if question.links[touch.patch] == link:
        return None
    return question.refuse(Refusal.ANSWER_ELSEWHERE, link=link)


def answer_is_clear(question: Question, touch: CommandedTouch) -> Reason | None:
    """Its gesture is the one that answers, likely enough and likelier than others."""
    probabilities = touch.probabilities.tolist()
    chances = dict(zip(question.vocabulary, probabilities, strict=False))
    chance = chances.get(question.answer, 0.0)
    others = [chances[word] for word in chances if word not in NON_GESTURES]
    if chance >= max([MIN_CONFIDENCE, *others]):
        return None
    return question.refuse(Refusal.UNCLEAR_ANSWER, chance=chance)


WHEN_IT_BEGINS: tuple[AnswerCondition, ...] = (
    answer_is_one_touch,
    answer_follows_question,
    answer_is_in_time,
)
"""Conditions of a touch that may be the answer, once it has begun."""
WHILE_IT_LASTS: tuple[AnswerCondition, ...] = (answer_is_gentle, answer_ends)
"""Conditions of the touch that has begun to answer."""
WHEN_IT_HAS_LEFT: tuple[AnswerCondition, ...] = (
    *WHILE_IT_LASTS,
    answer_is_no_hit,
    answer_is_there,
    answer_is_clear,
)
"""Conditions of the touch that has answered."""
