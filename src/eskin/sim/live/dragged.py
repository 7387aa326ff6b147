"""A hand that is led over the skin from outside."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.press import Press
from eskin.sim.live.live_touch import LiveTouch
from eskin.sim.live.span import Span
from eskin.sim.people.programs.act import Act
from eskin.sim.robot.world import World
from eskin.sim.site.site import Site

NEAR = 0.01
"""So far from where it is led, a finger is there [m]."""
HELD = 20.0
"""Time after which the noise of a force begins anew [s]."""


@final
class DraggedTouch(LiveTouch):
    """Parts of a hand that slide after the places they are given.

    They land softly, go no faster than people stroke, and ride on the link; whoever
    leads them sees where the robot is, so they do not follow it late. They leave once
    they have landed and are where they were led, however quickly that was asked for.
    """

    def __init__(self, act: Act, force: float, world: World) -> None:
        """Land at the site of an act, with the next reading.

        Args:
            act: whose hand, where, and which of its parts, as `kind`.
            force: to press with [N].
            world: the robot.
        """
        value = world.constants.value
        self.step = value("time.step")
        self.rise = self.step / value("live.lands")
        self.fall = self.step / value("live.leaves")
        self.stiff = 1.0 / value("live.settles")
        self.most = value("live.speed")
        self.world, self.force = world, force
        self.stamps, self.flesh = act.stamps(act.kind), act.flesh()
        self.turn = act.draw("hand.turn")
        self.chart, self.angle = act.site.chart, act.site.angle + self.turn
        self.centre = np.array(act.site.centre)
        self.target, self.speed = self.centre, np.zeros(2)
        steps = act.steps(HELD)
        self.noise, self.ripple = act.held(steps), act.rippled(steps)
        self.given, self.level = 0, 0.0
        self.told_to_leave = self.leaving = False
        self.over = False
        self.touch = TrueTouch(
            "stroke", act.kind, act.person.name, (self.press(np.zeros(1)),), act.drawn
        )

    def lead(self, site: Site) -> None:
        """Go on toward the place of a site; onto another chart at once."""
        target = np.array(site.centre)
        if site.chart != self.chart:
            self.chart, self.angle = site.chart, site.angle + self.turn
            self.centre, self.speed = target, np.zeros(2)
        away = target - self.centre
        away[:1] = self.world.charts[site.chart].wrapped(away[:1])
        self.target = self.centre + away

    def leave(self) -> None:
        """Lift off, as soon as it is where it was led."""
        self.told_to_leave = True

    def next(self, span: Span) -> TrueTouch:
        """What it does in the steps of a reading, whose first is 0."""
        force = np.zeros(span.steps)
        centre = np.zeros((span.steps, 2))
        for step in range(span.steps):
            moved = self.slide()
            self.leaving |= self.told_to_leave and self.level == 1.0 and self.is_there
            self.level += -self.fall if self.leaving else self.rise
            self.level = float(np.clip(self.level, 0.0, 1.0))
            at = self.given % len(self.noise)
            uneven = self.noise[at] * (self.ripple[at] if moved else 1.0)
            force[step] = self.force * smooth(self.level) * uneven
            centre[step] = self.centre
            self.given += 1
        self.over = self.leaving and self.level == 0.0
        press = self.press(force, centre)
        self.touch = TrueTouch(
            *(self.touch.gesture, self.touch.kind, self.touch.subject),
            *((press,), self.touch.drawn),
        )
        return self.touch

    @property
    def is_there(self) -> bool:
        """Whether it is about where it was led."""
        return float(np.linalg.norm(self.target - self.centre)) < NEAR

    def slide(self) -> bool:
        """Go one step, as if on a damped spring to the target; whether it slides."""
        away, k = self.target - self.centre, self.stiff
        # Implicit in time, so that no step is too long for it.
        speed = (self.speed + self.step * k**2 * away) / (1.0 + k * self.step) ** 2
        fast = float(np.linalg.norm(speed))
        self.speed = speed * min(1.0, self.most / max(fast, self.most))
        self.centre = self.centre + self.step * self.speed
        return fast > SLIDES * self.most

    def press(
        self,
        force: Float[np.ndarray, "time"],
        centre: Float[np.ndarray, "time 2"] | None = None,
    ) -> Press:
        """The press of some steps."""
        if centre is None:
            centre = np.tile(self.centre, (len(force), 1))
        angle = np.full(len(force), self.angle)
        return Press(self.chart, 0, self.stamps, self.flesh, force, centre, angle)


SLIDES = 0.02
"""Share of the greatest speed from which a hand slides."""


def smooth(level: float) -> float:
    """A level between 0 and 1, without corners at either end."""
    return level**3 * (10 - 15 * level + 6 * level**2)
