"""Touches under way, from reading to reading."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import final

import numpy as np

from eskin.sim.clip.scene import cropped
from eskin.sim.clip.timing import moved
from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.press import Press
from eskin.sim.live.span import Span
from eskin.sim.robot.lag import left_behind
from eskin.sim.robot.world import World


class LiveTouch(ABC):
    """One touch that takes place while the robot moves as it will.

    Attributes:
        touch: what is known of it so far, on a clock of its own.
        over: whether it is over.
    """

    touch: TrueTouch
    over: bool

    @abstractmethod
    def next(self, span: Span) -> TrueTouch:
        """What it does in the steps of a reading, whose first is 0."""


@final
class ActedTouch(LiveTouch):
    """What a person has in mind from the start; it begins with the next reading.

    As in clips, a hand follows the robot late, a cable hangs where it is, and a link
    that touches another stays with it.
    """

    def __init__(self, touch: TrueTouch, delay: float, world: World) -> None:
        """Prepare.

        Args:
            touch: on a clock of its own, from step 0.
            delay: with which a hand follows [s].
            world: the robot.
        """
        self.touch = touch
        self.world = world
        self.late = delay / world.constants.value("time.step")
        self.over = not touch.presses
        self.start: int | None = None
        self.landed: dict[int, np.ndarray] = {}
        self.end = max((p.first + p.steps for p in touch.presses), default=0)

    def next(self, span: Span) -> TrueTouch:
        """What it does in the steps of a reading, whose first is 0."""
        if self.start is None:
            self.start = span.first
        since = span.first - self.start
        here = moved(self.touch, -since)
        self.over = since + span.steps >= self.end
        parts = ((i, cropped(p, span.steps)) for i, p in enumerate(here.presses))
        presses = tuple(self.carried(i, p, span) for i, p in parts if p is not None)
        return replace(here, presses=presses)

    def carried(self, index: int, press: Press, span: Span) -> Press:
        """The part of a press in a reading, its hand where it is by then."""
        now = press.first + np.arange(press.steps)
        if index not in self.landed:
            self.landed[index] = span.q[now[0]]
        landed = self.landed[index]
        if self.touch.kind == "self_contact":
            return press
        if span.is_still and np.array_equal(landed, span.q[-1]):
            return press
        if self.touch.kind == "cable":
            return left_behind(
                press, self.world, span.q[now], np.tile(landed, (len(now), 1))
            )
        assert self.start is not None
        landing = self.start + self.touch.presses[index].first
        then = np.maximum(span.first + now - self.late, landing)
        return left_behind(press, self.world, span.q[now], span.at(then))
