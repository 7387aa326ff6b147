"""Interactive touches advance reading by reading while the robot moves."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import AnyPress, ContactSite, Press, TrueTouch
from eskin.sim.people.gesture_sample import GestureSample
from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.motion import (
    interpolate_poses,
    move_press_on_link,
    slide_past_body,
)
from eskin.sim.scene.scene import crop_press, shift_touch

Poses = Float[np.ndarray, "step joint"]


@dataclass(frozen=True, eq=False)
class MotionSpan:
    """A motion span holds the robot's motion during a reading and shortly before."""

    first: int
    """First step of the reading, since the beginning."""
    steps: int
    """Number of steps of the reading."""
    past: Poses
    """Joint positions at these steps and at the kept ones before [rad]."""

    @property
    def q(self) -> Poses:
        """Return the joint positions at the steps of the reading [rad]."""
        return self.past[-self.steps :]

    @property
    def is_stopped(self) -> bool:
        """Tell whether the robot stood still at all kept steps."""
        return bool(np.all(self.past == self.past[-1]))

    def at(self, steps: Float[np.ndarray, "step"]) -> Poses:
        """Return joint positions at and between steps since the beginning [rad]."""
        oldest = self.first + self.steps - len(self.past)
        return interpolate_poses(self.past, np.maximum(steps - oldest, 0.0))


@final
class MotionTrack:
    """A motion track keeps as much of the robot's motion as a delayed hand needs."""

    def __init__(self, steps: int, kept: int) -> None:
        """Create an empty track.

        A reading has `steps`; of the steps before it `kept` are kept.
        """
        self.steps = steps
        self.kept = kept
        self.past: Poses | None = None
        self.next_step = 0

    def move_to(self, q: Float[np.ndarray, "joint"]) -> MotionSpan:
        """Move at constant speed to joint positions at the end of the next reading."""
        last = q if self.past is None else self.past[-1]
        share = np.arange(1, self.steps + 1)[:, None] / self.steps
        # At rest the numbers must be exactly equal, so that `is_stopped` saves work.
        moved = np.any(q != last)
        path = last + share * (q - last) if moved else np.tile(q, (len(share), 1))
        kept = path[:0] if self.past is None else self.past
        self.past = np.concatenate([kept, path])[-self.kept - self.steps :]
        span = MotionSpan(self.next_step, self.steps, self.past)
        self.next_step += self.steps
        return span


class InteractiveTouch(ABC):
    """An interactive touch takes place while the robot moves in unknown ways.

    Attributes:
        touch: touch as known so far, on its own clock.
        over: whether the touch is over.
    """

    touch: TrueTouch
    over: bool

    @abstractmethod
    def advance(self, span: MotionSpan) -> TrueTouch:
        """Advance by a reading; return the part of the touch in it, from step 0."""


@final
class PerformedTouch(InteractiveTouch):
    """A performed touch is planned in advance and begins with the next reading.

    As in clips, a hand follows the robot with a delay, the robot slides past a body
    that stands in the world, and a link that touches another moves with it.
    """

    def __init__(self, touch: TrueTouch, delay: float, env: SimEnvironment) -> None:
        """Create the touch.

        The touch is on its own clock, from step 0; a hand follows with a delay [s].
        """
        self.touch = touch
        self.env = env
        self.delay_steps = delay / env.constants.value("time.step")
        self.over = not touch.presses
        self.start: int | None = None
        self.q_landing: dict[int, np.ndarray] = {}
        self.bodies: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self.end = max((p.first + p.steps for p in touch.presses), default=0)

    def advance(self, span: MotionSpan) -> TrueTouch:
        """Advance by a reading; return the part of the touch in it, from step 0."""
        if self.start is None:
            self.start = span.first
        since = span.first - self.start
        here = shift_touch(self.touch, -since)
        self.over = since + span.steps >= self.end
        parts = enumerate(crop_press(p, span.steps) for p in here.presses)
        presses = tuple(self.place_press(i, p, span) for i, p in parts if p is not None)
        return replace(here, presses=presses)

    def place_press(self, index: int, press: AnyPress, span: MotionSpan) -> AnyPress:
        """Return the part of a press in a reading, moved relative to its link."""
        now = press.first + np.arange(press.steps)
        q_landing = self.q_landing.setdefault(index, span.q[now[0]])
        if self.touch.kind == "self_contact":
            return press
        if span.is_stopped and np.array_equal(q_landing, span.q[-1]):
            return press
        if isinstance(press, Press) and press.anchor is not None:
            q_before, T_world_body = self.bodies.get(index, (q_landing, None))
            q_series = np.concatenate([q_before[None], span.q[now]])
            press, T_world_body = slide_past_body(
                press, self.env, q_series, T_world_body
            )
            self.bodies[index] = (q_series[-1], T_world_body)
            return press
        assert self.start is not None
        landing = self.start + self.touch.presses[index].first
        then = np.maximum(span.first + now - self.delay_steps, landing)
        return move_press_on_link(press, self.env, span.q[now], span.at(then))


ARRIVAL_DISTANCE = 0.01
"""Distance to the target at which a finger has arrived [m]."""
NOISE_SECONDS = 20.0
"""Period after which the noise of a force repeats [s]."""


@final
class DraggedTouch(InteractiveTouch):
    """A dragged touch slides pads of a hand toward sites that a caller sets.

    The pads land softly, move no faster than people stroke, and move with the link
    without delay, since the caller sees the robot. After `lift` they first finish
    landing and arrive at their target.
    """

    def __init__(
        self, sample: GestureSample, force: float, env: SimEnvironment
    ) -> None:
        """Create a touch that lands with the next reading at the site of a sample.

        The `kind` of the sample is a pad group; `force` is in [N].
        """
        value = env.constants.value
        self.step = value("time.step")
        self.rise = self.step / value("live.lands")
        self.fall = self.step / value("live.leaves")
        self.spring_rate = 1.0 / value("live.settles")
        self.max_speed = value("live.speed")
        self.env = env
        self.force = force
        self.pads = sample.draw_pads(sample.kind)
        self.tissue = sample.draw_tissue()
        self.turn = sample.draw("hand.turn")
        self.chart = sample.site.chart
        self.angle = sample.site.angle + self.turn
        self.centre = np.array(sample.site.centre)
        self.target = self.centre
        self.speed = np.zeros(2)
        steps = sample.count_steps(NOISE_SECONDS)
        self.noise = sample.draw_held_noise(steps)
        self.ripple = sample.draw_ripple(steps)
        self.steps_done = 0
        self.level = 0.0
        self.lift_requested = self.lifting = False
        self.over = False
        self.touch = TrueTouch(
            "stroke",
            sample.kind,
            sample.person.name,
            (self.build_press(np.zeros(1)),),
            sample.drawn,
        )

    def set_target(self, site: ContactSite) -> None:
        """Slide toward a site from now on; jump to it if it is on another chart."""
        target = np.array(site.centre)
        if site.chart != self.chart:
            self.chart = site.chart
            self.angle = site.angle + self.turn
            self.centre = target
            self.speed = np.zeros(2)
        away = target - self.centre
        away[:1] = self.env.charts[site.chart].wrap_s(away[:1])
        self.target = self.centre + away

    def lift(self) -> None:
        """Lift off as soon as the pads have arrived."""
        self.lift_requested = True

    def advance(self, span: MotionSpan) -> TrueTouch:
        """Advance by a reading; return the part of the touch in it, from step 0."""
        force = np.zeros(span.steps)
        centre = np.zeros((span.steps, 2))
        for step in range(span.steps):
            moved = self.slide()
            left = float(np.linalg.norm(self.target - self.centre))
            has_arrived = self.level == 1.0 and left < ARRIVAL_DISTANCE
            self.lifting |= self.lift_requested and has_arrived
            self.level += -self.fall if self.lifting else self.rise
            self.level = float(np.clip(self.level, 0.0, 1.0))
            at = self.steps_done % len(self.noise)
            uneven = self.noise[at] * (self.ripple[at] if moved else 1.0)
            force[step] = self.force * smooth_step(self.level) * uneven
            centre[step] = self.centre
            self.steps_done += 1
        self.over = self.lifting and self.level == 0.0
        self.touch = replace(self.touch, presses=(self.build_press(force, centre),))
        return self.touch

    def slide(self) -> bool:
        """Move one step as a critically damped spring; tell whether the pads slide."""
        away = self.target - self.centre
        k = self.spring_rate
        # The scheme is implicit in time, so it is stable at any step.
        speed = (self.speed + self.step * k**2 * away) / (1.0 + k * self.step) ** 2
        fast = float(np.linalg.norm(speed))
        self.speed = speed * min(1.0, self.max_speed / max(fast, self.max_speed))
        self.centre = self.centre + self.step * self.speed
        return fast > SLIDING_SHARE * self.max_speed

    def build_press(
        self,
        force: Float[np.ndarray, "time"],
        centre: Float[np.ndarray, "time 2"] | None = None,
    ) -> Press:
        """Build the press of some steps."""
        if centre is None:
            centre = np.tile(self.centre, (len(force), 1))
        angle = np.full(len(force), self.angle)
        return Press(self.chart, 0, force, centre, angle, self.pads, self.tissue)


SLIDING_SHARE = 0.02
"""Share of the greatest speed above which a hand counts as sliding."""


def smooth_step(level: float) -> float:
    """Return a level between 0 and 1, smoothed at both ends (quintic smoothstep)."""
    return level**3 * (10 - 15 * level + 6 * level**2)
