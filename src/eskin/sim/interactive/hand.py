"""This module touches a simulated skin on request."""

from dataclasses import dataclass
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.recording import NONE, TruthRecord
from eskin.sim.contact.press import ContactSite, TrueTouch
from eskin.sim.interactive.touches import (
    DraggedTouch,
    InteractiveTouch,
    MotionSpan,
    PerformedTouch,
)
from eskin.sim.people.gesture_sample import GestureSample
from eskin.sim.people.perform import NONE_PROGRAMS, PERFORMABLE, perform
from eskin.sim.people.person import Person
from eskin.sim.scene.environment import SimEnvironment
from eskin.sim.scene.placement import build_reached_site, build_view, draw_site
from eskin.sim.scene.scene import are_apart
from eskin.sim.scene.validity import find_self_contact_sites


@dataclass(frozen=True, eq=False)
class LinkPoint:
    """A link point is a point on or near the skin of a link."""

    link: str
    """Link that the skin is on."""
    p_link: Float[np.ndarray, "3"]
    """Position in that link's frame [m]."""


def find_chart_point(
    point: LinkPoint, env: SimEnvironment
) -> tuple[int, Float[np.ndarray, "2"]]:
    """Return the chart of the link's nearest taxel, and the point (s, t) on it [m].

    Raises:
        ValueError: there is no skin on that link.
    """
    charts = [i for i, chart in enumerate(env.charts) if chart.link == point.link]
    if not charts:
        allowed = ", ".join(sorted({chart.link for chart in env.charts}))
        raise ValueError(
            f"no skin on link '{point.link}'; allowed are {allowed}; touch one of them"
        )
    positions = env.mounted.skin.positions
    distances = [
        np.linalg.norm(
            positions[env.charts[i].taxels[env.charts[i].own]] - point.p_link, axis=1
        ).min()
        for i in charts
    ]
    chart = charts[int(np.argmin(distances))]
    return chart, env.charts[chart].surface.unroll(point.p_link[None])[0]


def build_site_at(
    point: LinkPoint,
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    person: Person,
) -> ContactSite:
    """Build the site at a point, with the hand oriented as the person reaches it.

    Raises:
        ValueError: there is no skin on the point's link.
    """
    chart, centre = find_chart_point(point, env)
    return build_reached_site(env, build_view(env, q, person), chart, centre)


DRAGGING_PADS = "fingers"
"""Pads that are dragged by default, the most frequent ones of strokes."""

SECOND_PAT_START = 2 / 3
"""Start of the second pat of a double pat, as a share of its duration."""

PLACE_TRIES = 20
"""Attempts to draw a site away from other touches."""

CONTACTLESS_KINDS = ("idle", "electrical")
"""Kinds of `none` without contact."""


@final
class InteractiveHand:
    """An interactive hand touches a skin as people do; it is thread-safe.

    A touch begins with the next scan and advances with each scan.

    Attributes:
        person: person who touches, unless another one is given.
    """

    def __init__(
        self, env: SimEnvironment, person: Person, rng: np.random.Generator
    ) -> None:
        """Create a hand."""
        self.env = env
        self.person = person
        self.rng = rng
        self.difficulty = env.constants.value("sets.difficulty")
        self.q = np.zeros(len(env.mounted.robot.joint_names))
        # Two locks, so that scans never wait while a touch is planned.
        self.planning = RLock()
        self.lock = RLock()
        self.active: dict[int, InteractiveTouch] = {}
        self.latest_truths: tuple[TruthRecord, ...] = ()
        self.count = 0

    @property
    def touching(self) -> tuple[int, ...]:
        """Return the ids of the touches that last or begin with the next scan."""
        with self.lock:
            return tuple(self.active)

    def truths(self) -> tuple[TruthRecord, ...]:
        """Return the true touches of the latest scan, as means over its period."""
        with self.lock:
            return self.latest_truths

    def poke(
        self, point: LinkPoint, force: float | None = None, seconds: float | None = None
    ) -> int:
        """Push with a finger.

        Args:
            point: point on the skin.
            force: largest force [N]; None draws it as for a person.
            seconds: time from first to last contact [s]; None draws it.

        Returns:
            Id of the touch.

        Raises:
            ValueError: the link has no skin, or force or time are not positive.
        """
        return self.perform_requested(
            "poke", point, check_requested(force=force, duration=seconds)
        )

    def double_pat(
        self, point: LinkPoint, force: float | None = None, seconds: float | None = None
    ) -> int:
        """Pat twice with the hand; arguments are as for `poke`."""
        requested = check_requested(force=force, duration=seconds) | {"more": 0.0}
        if force is not None:
            requested["force.1"] = force
        if seconds is not None:
            requested["interval"] = SECOND_PAT_START * seconds
            requested["contact"] = seconds - SECOND_PAT_START * seconds
        return self.perform_requested("double_pat", point, requested)

    def grab(
        self, point: LinkPoint, force: float | None = None, seconds: float | None = None
    ) -> int:
        """Close fingers and thumb round the link; arguments are as for `poke`.

        The force is limited by the grip of the person.
        """
        return self.perform_requested(
            "grab", point, check_requested(force=force, duration=seconds)
        )

    def perform(
        self, what: str, point: LinkPoint | None = None, person: Person | None = None
    ) -> int:
        """Perform a touch as a person does, with random parameters.

        Args:
            what: a gesture; a kind of `none`, such as `bump`; or `none`, which draws an
                accidental contact.
            point: point on the skin; None draws one as in the training data, away from
                other touches.
            person: person who touches; None is the hand's own.

        Returns:
            Id of the touch.

        Raises:
            ValueError: there is no such gesture or kind.
        """
        with self.planning:
            person = person or self.person
            gesture, kind = self.resolve_kind(what)
            touch = self.draw_touch(gesture, kind, point, person)
            for _ in range(PLACE_TRIES):
                if point is not None or self.is_free(touch):
                    break
                touch = self.draw_touch(gesture, kind, None, person)
            return self.add_performed(touch)

    def begin(self, point: LinkPoint, force: float, kind: str = DRAGGING_PADS) -> int:
        """Begin a touch that `move` drags and `end` lifts.

        Args:
            point: point on the skin.
            force: force to press with [N].
            kind: pads of the hand, one of `eskin.sim.people.person.PAD_GROUPS`.

        Returns:
            Id of the touch.

        Raises:
            ValueError: the link has no skin, or there are no such pads.
        """
        check_requested(force=force)
        with self.planning:
            sample = GestureSample(
                kind,
                self.person,
                build_site_at(point, self.env, self.q, self.person),
                self.env.constants,
                self.rng,
                self.difficulty,
                "paper",
            )
            return self.add_touch(DraggedTouch(sample, force, self.env))

    def move(self, touch: int, point: LinkPoint) -> None:
        """Drag a touch toward a point; does nothing if it is over.

        Raises:
            ValueError: the link has no skin, or the touch is not dragged.
        """
        site = build_site_at(point, self.env, self.q, self.person)
        with self.lock:
            dragged = self.get_dragged(touch)
            if dragged is not None:
                dragged.set_target(site)

    def end(self, touch: int) -> None:
        """Lift a dragged touch; does nothing if it is over.

        Raises:
            ValueError: the touch is not dragged.
        """
        with self.lock:
            dragged = self.get_dragged(touch)
            if dragged is not None:
                dragged.lift()

    def get_dragged(self, touch: int) -> DraggedTouch | None:
        """Return a dragged touch, or None if it is over."""
        if not 0 <= touch < self.count:
            raise ValueError(
                f"touch {touch} has not begun; allowed are ids that `begin` gave"
            )
        found = self.active.get(touch)
        if found is not None and not isinstance(found, DraggedTouch):
            raise ValueError(
                f"touch {touch} is not dragged; allowed are ids that `begin` gave"
            )
        return found

    def perform_requested(
        self, gesture: str, point: LinkPoint, requested: dict[str, float]
    ) -> int:
        """Perform a gesture with some parameters fixed; return its id.

        It is the usual variant, made plainly, and stays where it lands on its link.
        """
        with self.planning:
            site = build_site_at(point, self.env, self.q, self.person)
            constants = self.env.constants
            kinds = constants.weights(f"{gesture}.kinds")
            usual = max(kinds, key=lambda kind: kinds[kind])
            touch = perform(
                gesture,
                usual,
                self.person,
                site,
                constants,
                self.rng,
                0.0,
                "paper",
                requested,
            )
            return self.add_touch(PerformedTouch(touch, 0.0, self.env))

    def draw_touch(
        self, gesture: str, kind: str | None, point: LinkPoint | None, person: Person
    ) -> TrueTouch:
        """Draw the touch of a person, on the touch's own clock."""
        site = self.find_site(gesture, kind, point, person)
        constants = self.env.constants
        difficulty = self.difficulty
        return perform(
            gesture, kind, person, site, constants, self.rng, difficulty, None
        )

    def find_site(
        self, gesture: str, kind: str | None, point: LinkPoint | None, person: Person
    ) -> ContactSite:
        """Find or draw the site of a touch."""
        if kind == "self_contact":
            found = find_self_contact_sites(self.env, self.q)
            if not found:
                raise ValueError(
                    "no link nearly touches another; self_contact is allowed only "
                    "where one does; fold the arm first"
                )
            return found[self.rng.integers(len(found))]
        if point is not None:
            return build_site_at(point, self.env, self.q, person)
        return draw_site(self.env, self.q, person, gesture, self.rng, kind)

    def resolve_kind(self, what: str) -> tuple[str, str | None]:
        """Return the gesture and kind of a name that can be performed."""
        if what == NONE:
            kinds = dict(self.env.constants.weights("stream.accidents"))
            if not find_self_contact_sites(self.env, self.q):
                del kinds["self_contact"]
            chances = np.array(list(kinds.values()))
            return NONE, str(self.rng.choice(list(kinds), p=chances / chances.sum()))
        if what in PERFORMABLE:
            return what, None
        kinds = [kind for kind in NONE_PROGRAMS if kind not in CONTACTLESS_KINDS]
        if what in kinds:
            return NONE, what
        names = dict.fromkeys((*PERFORMABLE, *kinds))
        raise ValueError(
            f"no gesture or contact '{what}'; allowed are {', '.join(names)}; take one "
            "of them"
        )

    def is_free(self, touch: TrueTouch) -> bool:
        """Tell whether a touch is apart from all active ones."""
        with self.lock:
            others = [other.touch for other in self.active.values()]
        return all(are_apart(self.env, self.q, touch, other) for other in others)

    def add_performed(self, touch: TrueTouch) -> int:
        """Add a touch by a hand that follows the robot with a random delay."""
        delay = self.env.constants.draw("motion.delay", self.rng)
        return self.add_touch(PerformedTouch(touch, delay, self.env))

    def add_touch(self, touch: InteractiveTouch) -> int:
        """Add a touch that begins with the next scan; return its id."""
        with self.lock:
            number = self.count
            self.count += 1
            self.active[number] = touch
            return number

    def advance(self, span: MotionSpan) -> dict[int, TrueTouch]:
        """Advance all touches by a reading; return their parts in it, by id."""
        with self.lock:
            self.q = span.q[-1]
            found = {i: touch.advance(span) for i, touch in self.active.items()}
            self.active = {i: t for i, t in self.active.items() if not t.over}
            return found

    def set_truths(self, truths: tuple[TruthRecord, ...]) -> None:
        """Set the true touches of the latest scan."""
        with self.lock:
            self.latest_truths = truths


def check_requested(**requested: float | None) -> dict[str, float]:
    """Return requested values that are not None; raise an error unless positive."""
    for name, value in requested.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(
                f"{name} is {value}; allowed are positive numbers; give one, or None "
                "for what the person does"
            )
    return {name: value for name, value in requested.items() if value is not None}
