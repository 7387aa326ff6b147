"""Clicks and drags as orders to touch; a hand has one finger at a time."""

import heapq
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from threading import RLock
from typing import Literal, final

import numpy as np

from eskin.page.orders import Order, TouchKind, TouchOrder
from eskin.page.pointing import Spot
from eskin.page.setup import Setup

Mode = Literal["poke", "double-pat", "grab", "stroke"]
GAP = 0.1
"""Least time between two pokes: the finger is lifted before it comes back [s]."""
STROKE_LENGTH = 0.12
"""Of the stroke that a click makes in that mode [m]."""
STROKE_TICK = 0.05
"""Between its moves [s]."""


@final
class Hand:
    """Makes orders of what the mouse does, each at its time.

    A click pokes at once: nothing waits for a second one. That comes as soon as the
    finger has been lifted, and the recogniser hears both as one touch, just as it does
    when a person pats twice.

    Attributes:
        mode: what a click does.
        force: of what is begun next [N].
        seconds: how long a poke or grab lasts [s].
    """

    def __init__(self, setup: Setup, send: Callable[[Order], None]) -> None:
        """Touch nothing yet.

        Args:
            setup: the skin.
            send: is given each order; may be called from any thread.
        """
        self.setup = setup
        self.send = send
        self.mode: Mode = "poke"
        self.force = 8.0
        self.seconds = 0.2
        self.keys = count(1)
        self.lifted = 0.0
        self.later: list[tuple[float, int, TouchOrder]] = []
        self.dragged: TouchOrder | None = None
        self.lock = RLock()

    def click(self, spot: Spot, now: float, mode: Mode | None = None) -> None:
        """Touch a spot in the mode that is set, or in another.

        Args:
            spot: where.
            now: any clock that runs on [s].
            mode: in place of `self.mode`.
        """
        mode = mode or self.mode
        if mode == "stroke":
            self.stroke(spot, now)
        elif mode == "poke":
            begin = max(now, self.lifted)
            self.lifted = begin + self.seconds + GAP
            self.at(begin, self.order("poke", spot, next(self.keys)))
        else:
            kind = "grab" if mode == "grab" else "double_pat"
            self.at(now, self.order(kind, spot, next(self.keys)))
        self.tick(now)

    def stroke(self, spot: Spot, now: float) -> None:
        """Stroke along the patch from a spot on, over taxels of the same link."""
        key = next(self.keys)
        path = self.path(spot)
        for number, place in enumerate(path):
            order = self.order("move" if number else "begin", place, key)
            self.at(now + number * STROKE_TICK, order)
        end = now + len(path) * STROKE_TICK
        self.at(end, self.order("end", path[-1], key))

    def path(self, spot: Spot) -> list[Spot]:
        """Spots from one end of a stroke to the other."""
        setup = self.setup
        patch = np.flatnonzero(setup.patch_index == setup.patch_index[spot.taxel])
        positions = setup.positions[patch]
        along = np.linalg.svd(positions - positions.mean(0), full_matrices=False)[2][0]
        if (positions.mean(0) - spot.p_link) @ along < 0:
            along = -along
        steps = round(STROKE_LENGTH / 0.01)
        wanted = spot.p_link + np.linspace(0, STROKE_LENGTH, steps)[:, None] * along
        away = np.linalg.norm(wanted[:, None] - positions, axis=-1)
        near = patch[np.argmin(away, axis=1)]
        return [Spot(int(t), spot.link, setup.positions[t]) for t in near]

    def drag(self, phase: Literal["start", "update", "end"], spot: Spot | None) -> None:
        """Drag a finger; where there is no skin it stays where it last was.

        Args:
            phase: of the drag.
            spot: where the mouse is on the skin.
        """
        last = self.dragged
        if phase == "end":
            self.dragged = None
            if last is not None:
                self.send(replace(last, kind="end"))
        elif spot is not None:
            key = next(self.keys) if last is None else last.key
            self.dragged = self.order("begin" if last is None else "move", spot, key)
            self.send(self.dragged)

    def order(
        self,
        kind: TouchKind,
        spot: Spot,
        key: int,
    ) -> TouchOrder:
        """An order for a spot with the force and duration that are set."""
        x, y, z = spot.p_link.tolist()
        link = self.setup.links[spot.link]
        return TouchOrder(kind, link, (x, y, z), self.force, self.seconds, key)

    def at(self, when: float, order: TouchOrder) -> None:
        """Send an order later."""
        with self.lock:
            heapq.heappush(self.later, (when, next(self.keys), order))

    def tick(self, now: float) -> None:
        """Send what is due."""
        with self.lock:
            while self.later and self.later[0][0] <= now:
                self.send(heapq.heappop(self.later)[2])
