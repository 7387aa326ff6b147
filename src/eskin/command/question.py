"""This module defines the question that an arm asks before it does more."""

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
        return refusal.reason(again=self.config.quiet_after_failure, **values)

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
                refusal = self.find_touch_refusal(touch)
                if refusal is not None:
                    return refusal
                self.touch = touch
        if self.touch is None:
            if touches.latest <= self.deadline:
                return None
            answer = self.answer.replace("_", " ")
            return self.refuse(Refusal.NO_ANSWER, answer=answer)
        if self.touch.excess is not None:
            problem = self.touch.excess.what
            return self.refuse(Refusal.STRONG_ANSWER, problem=problem)
        if self.touch.duration > self.config.max_seconds:
            longest = self.config.max_seconds
            return self.refuse(Refusal.LONG_ANSWER, seconds=longest)
        return None if self.touch.is_present else self.find_doubt(self.touch, touches)

    def find_doubt(
        self, touch: CommandedTouch, touches: CommandedTouches
    ) -> Reason | None:
        """Return why a touch that has left is no answer, or None where it is one."""
        if touch.duration < self.config.min_seconds:
            return self.refuse(Refusal.BRIEF_ANSWER, seconds=touch.duration)
        link = self.request.detection.link
        if touches.links[touch.patch] != link:
            return self.refuse(Refusal.ANSWER_ELSEWHERE, link=link)
        chances = dict(zip(self.vocabulary, touch.probabilities.tolist(), strict=False))
        chance = chances.get(self.answer, 0.0)
        others = [
            chances.get(word, 0.0) for word in chances if word not in NON_GESTURES
        ]
        if chance < max([MIN_CONFIDENCE, *others]):
            answer = self.answer.replace("_", " ")
            return self.refuse(Refusal.UNCLEAR_ANSWER, answer=answer, chance=chance)
        return None

    def find_touch_refusal(self, touch: CommandedTouch) -> Reason | None:
        """Return why a touch that has begun cannot be the answer, or None."""
        if self.touch is not None:
            return self.refuse(Refusal.TWO_ANSWERS)
        onset = touch.onset or 0
        if onset < self.asked_at + self.config.least_delay * NS_PER_S:
            return self.refuse(Refusal.TOUCHED_BEFORE_QUESTION)
        return self.refuse(Refusal.LATE_ANSWER) if onset > self.deadline else None

    def is_answered(self, now: int) -> bool:
        """Return whether it is answered, if nothing refuses it.

        Args:
            now: stamp of the latest reading [ns since the epoch].
        """
        if self.touch is None or self.touch.is_present:
            return False
        return now - self.touch.last >= self.config.quiet_after_answer * NS_PER_S
