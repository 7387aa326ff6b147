"""This module turns clicks and drags of the mouse into touches, or into paint."""

import heapq
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from threading import RLock
from typing import Literal, final

import numpy as np

from eskin.page.html import to_words
from eskin.page.messages import (
    Order,
    PaintOrder,
    SceneDescription,
    TouchKind,
    TouchOrder,
)
from eskin.page.scene import SurfacePoint

TouchMode = Literal["poke", "double pat", "grab", "stroke"]
DragPhase = Literal["start", "update", "end"]


class Mouse(ABC):
    """A mouse turns clicks and drags on a surface into orders.

    Attributes:
        answer: kind of touch that answers what the arm asks now; None while it does not
            ask.
        tell: function called with the answer to each click and drag, for the person.
    """

    def __init__(self, setup: SceneDescription, send: Callable[[Order], None]) -> None:
        """Start without orders.

        Args:
            setup: description of the skin, or of a surface as the taxels of one.
            send: function called with each order, from any thread.
        """
        self.setup = setup
        self.send = send
        self.answer: TouchMode | None = None
        self.tell: Callable[[str], None] = lambda text: None

    @abstractmethod
    def click(
        self, spot: SurfacePoint | None, now: float, mode: TouchMode | None = None
    ) -> None:
        """Act on a click.

        Args:
            spot: point on the surface; None where the click missed it.
            now: time of any monotonic clock [s].
            mode: kind of touch that is asked for; None for the current one.
        """

    @abstractmethod
    def drag(self, phase: DragPhase, spot: SurfacePoint | None) -> None:
        """Act on a part of a drag.

        Args:
            phase: phase of the drag.
            spot: point on the surface under the mouse; None where there is none.
        """

    @abstractmethod
    def tick(self, now: float) -> None:
        """Send the orders that are due."""


KINDS: dict[TouchMode, TouchKind] = {
    "poke": "poke",
    "double pat": "double_pat",
    "grab": "grab",
}
"""Kind of the touch of each mode that has only one."""
DOUBLE_CLICK = 0.35
"""Longest time between two clicks that make a double pat [s]."""
DOUBLE_CLICK_DISTANCE = 0.05
"""Greatest distance between the two clicks of a double pat [m]."""
USUAL: dict[TouchKind, tuple[float, float]] = {
    "poke": (8.0, 0.6),
    "double_pat": (6.0, 0.5),
    "grab": (40.0, 1.0),
    "begin": (4.0, 0.0),
}
"""Force [N] and duration [s] of each touch, as people make it who want to be felt: the
medians of the simulator (`constants.yaml`), and for a poke those of a firm one."""
MISSED = (
    "that was beside the skin, or it had moved on: click or drag where the pointer is "
    "a hand"
)
"""Answer to a click or drag that hit no skin."""
STROKE_LENGTH = 0.12
"""Length of the stroke that a click makes in the mode `stroke` [m]."""
STROKE_TICK = 0.05
"""Interval between the moves of that stroke [s]."""


@final
class MouseHand(Mouse):
    """Turns actions of the mouse into touch orders, each sent at its time.

    A click pokes only once it is too late for a second click. Two clicks make a double
    pat instead of two pokes, because the first poke would be recognised, and would have
    issued its command, before the second. It suffices that one of the two hits. While
    the arm asks, a click is the touch that answers, and comes at once.

    Attributes:
        mode: kind of touch that a click makes.
        firmness: force of the next touch by the usual one of its kind.
        slowness: duration of the next touch by the usual one of its kind.
    """

    def __init__(self, setup: SceneDescription, send: Callable[[Order], None]) -> None:
        """Start without touches."""
        super().__init__(setup, send)
        self.mode: TouchMode = "poke"
        self.firmness = self.slowness = 1.0
        self.keys = count(1)
        # Time at which a poke is sent unless a second click follows, and its point.
        self.waiting: tuple[float, SurfacePoint | None] | None = None
        self.scheduled: list[tuple[float, int, TouchOrder]] = []
        self.dragged: TouchOrder | None = None
        self.lock = RLock()

    def click(
        self, spot: SurfacePoint | None, now: float, mode: TouchMode | None = None
    ) -> None:
        """Touch a point in the mode that answers, the current one, or another."""
        mode = mode or self.answer or self.mode
        if mode == "poke" and self.answer is None:
            self.poke(spot, now)
        elif spot is None:
            self.tell(MISSED)
        elif mode == "stroke":
            self.stroke(spot, now)
        else:
            self.schedule(now, KINDS[mode], spot)
        self.tick(now)

    def poke(self, spot: SurfacePoint | None, now: float) -> None:
        """Schedule a poke, or a double pat if a poke was already scheduled."""
        with self.lock:
            self.tick(now)
            waiting = self.waiting
            self.waiting = (now + DOUBLE_CLICK, spot)
            if waiting is None:
                return
            first = waiting[1]
            if first is not None and spot is not None and not are_near(first, spot):
                self.schedule(now, "poke", first)
            elif (hit := first or spot) is not None:
                self.waiting = None
                self.schedule(now, "double_pat", hit)

    def stroke(self, spot: SurfacePoint, now: float) -> None:
        """Schedule a stroke along the patch from a point, over taxels of its link."""
        key = next(self.keys)
        path = self.plan_stroke(spot)
        for number, place in enumerate(path):
            kind = "move" if number else "begin"
            self.schedule(now + number * STROKE_TICK, kind, place, key)
        end = now + len(path) * STROKE_TICK
        self.schedule(end, "end", path[-1], key)

    def plan_stroke(self, spot: SurfacePoint) -> list[SurfacePoint]:
        """Return the taxels along a stroke from a point, 1 cm apart."""
        setup = self.setup
        patch = np.flatnonzero(setup.patch_index == setup.patch_index[spot.taxel])
        positions = setup.positions[patch]
        along = np.linalg.svd(positions - positions.mean(0), full_matrices=False)[2][0]
        if (positions.mean(0) - spot.p_link) @ along < 0:
            along = -along
        steps = round(STROKE_LENGTH / 0.01)
        wanted = spot.p_link + np.linspace(0, STROKE_LENGTH, steps)[:, None] * along
        distances = np.linalg.norm(wanted[:, None] - positions, axis=-1)
        taxels = patch[np.argmin(distances, axis=1)]
        return [SurfacePoint(int(t), spot.link, setup.positions[t]) for t in taxels]

    def drag(self, phase: DragPhase, spot: SurfacePoint | None) -> None:
        """Drag or hold a finger; while the mouse is off the skin, it stays in place.

        The finger lands only when it begins to move. A browser that draws slowly
        reports the move long after the press, and a finger that rests before it moves
        makes no stroke.
        """
        finger = self.dragged
        if finger is not None and phase == "start":
            self.send(replace(finger, kind="end"))
            finger = None
        if finger is not None and finger.kind == "begin":
            self.send(finger)
            finger = replace(finger, kind="move")
        if spot is not None and finger is not None:
            finger = self.build_order("move", spot, finger.key)
            self.send(finger)
        elif spot is not None and phase != "end":
            finger = self.build_order("begin", spot, next(self.keys))
            self.tell_touch("finger", spot)
        if phase == "end" and finger is not None:
            self.send(replace(finger, kind="end"))
        self.dragged = None if phase == "end" else finger

    def build_order(self, kind: TouchKind, spot: SurfacePoint, key: int) -> TouchOrder:
        """Return an order for a point with the current force and duration."""
        x, y, z = spot.p_link.tolist()
        force, seconds = USUAL.get(kind, USUAL["begin"])
        force = self.firmness * force
        seconds = self.slowness * seconds
        link = self.setup.links[spot.link]
        return TouchOrder(kind, link, (x, y, z), force, seconds, key)

    def tell_touch(self, what: str, spot: SurfacePoint) -> None:
        """Tell the person which touch begins, and on which patch."""
        patch = self.setup.patches[self.setup.patch_index[spot.taxel]]
        self.tell(to_words(f"your {what} on {patch}"))

    def schedule(
        self, when: float, kind: TouchKind, spot: SurfacePoint, key: int | None = None
    ) -> None:
        """Schedule an order for a time [s], with a new key unless one is given."""
        order = self.build_order(kind, spot, key or next(self.keys))
        if kind not in ("move", "end"):
            self.tell_touch("stroke" if kind == "begin" else kind, spot)
        with self.lock:
            heapq.heappush(self.scheduled, (when, next(self.keys), order))

    def tick(self, now: float) -> None:
        """Send the orders that are due."""
        with self.lock:
            if self.waiting is not None and self.waiting[0] <= now:
                if self.waiting[1] is None:
                    self.tell(MISSED)
                else:
                    self.schedule(now, "poke", self.waiting[1])
                self.waiting = None
            while self.scheduled and self.scheduled[0][0] <= now:
                self.send(heapq.heappop(self.scheduled)[2])


def are_near(one: SurfacePoint, other: SurfacePoint) -> bool:
    """Return whether two points are near enough for the clicks of a double pat."""
    apart = float(np.linalg.norm(one.p_link - other.p_link))
    return one.link == other.link and apart <= DOUBLE_CLICK_DISTANCE


BALL_STEP = 0.5
"""Distance of two balls of a stroke, as a share of their radius."""


@final
class PaintBrush(Mouse):
    """Turns clicks and drags of the mouse into balls; those of one drag are a stroke.

    Attributes:
        radius: radius of the next balls [m].
        keeps_out: whether they mark a zone without skin.
        matrix: rows, columns and pitch [m] of the matrix that is placed instead.
    """

    def __init__(self, setup: SceneDescription, send: Callable[[Order], None]) -> None:
        """Start without strokes."""
        super().__init__(setup, send)
        self.radius = 0.04
        self.keeps_out = False
        self.matrix: tuple[int, int, float] | None = None
        self.strokes = 0
        self.pressed: SurfacePoint | None = None
        self.last: SurfacePoint | None = None

    def click(
        self, spot: SurfacePoint | None, now: float, mode: TouchMode | None = None
    ) -> None:
        """Paint one ball at a point, whatever the mode."""
        if spot is not None:
            self.strokes += 1
            self.paint(spot)

    def drag(self, phase: DragPhase, spot: SurfacePoint | None) -> None:
        """Paint along a drag, which begins when the mouse moves.

        A matrix lies where the drag ends.
        """
        if self.matrix is not None:
            if phase == "end":
                self.click(spot, 0.0)
            return
        if phase == "start":
            self.strokes += 1
            self.pressed = spot
            self.last = None
            return
        first = self.pressed
        self.pressed = None
        for each in (first, spot):
            if each is not None and self.measure_step(each) >= BALL_STEP * self.radius:
                self.paint(each)

    def measure_step(self, spot: SurfacePoint) -> float:
        """Return the distance from the last ball of the stroke on the same link [m]."""
        if self.last is None or self.last.link != spot.link:
            return np.inf
        return float(np.linalg.norm(spot.p_link - self.last.p_link))

    def paint(self, spot: SurfacePoint) -> None:
        """Send a ball at a point."""
        self.last = spot
        x, y, z = spot.p_link.tolist()
        place = self.setup.links[spot.link], (x, y, z)
        what = self.radius, self.keeps_out, self.matrix
        self.send(PaintOrder(self.strokes, *place, *what))

    def tick(self, now: float) -> None:
        """Do nothing: every ball is sent at once."""
