"""This module turns clicks and drags into orders to touch."""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from threading import RLock
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.page.messages import Order, SceneDescription, TouchKind, TouchOrder
from eskin.page.scene import Scene

REACH = 0.015
"""How far from a taxel's centre a ray may pass it [m]."""


@dataclass(frozen=True, eq=False)
class SurfacePoint:
    """A place on the skin."""

    taxel: int
    """The nearest taxel."""

    link: int
    """Index of its link."""

    p_link: Float[np.ndarray, "3"]
    """The place itself, in the frame of the link [m]."""


@final
class Pointing:
    """Finds spots on the skin where it is now."""

    def __init__(self, scene: Scene) -> None:
        """Look at a scene."""
        self.scene = scene
        self.links = scene.setup.taxel_link

    def of_taxel(self, taxel: int) -> SurfacePoint:
        """The centre of a taxel."""
        link = int(self.links[taxel])
        return SurfacePoint(taxel, link, self.scene.setup.positions[taxel])

    def along(
        self, origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
    ) -> SurfacePoint | None:
        """The foremost spot that a ray meets; None where it misses the skin.

        Args:
            origin: of the ray in the world [m].
            direction: of the ray, of any length.
        """
        direction = direction / np.linalg.norm(direction)
        positions, normals = self.scene.world()
        depth = (positions - origin) @ direction
        aside = np.linalg.norm(positions - origin - depth[:, None] * direction, axis=-1)
        met = (normals @ direction < 0) & (depth > 0) & (aside < REACH)
        if not met.any():
            return None
        front = met & (depth < depth[met].min() + 2 * REACH)
        taxel = int(np.argmin(np.where(front, aside, np.inf)))
        normal = normals[taxel]
        # Where the ray passes the plane of the taxel, but no further from its centre.
        step = ((positions[taxel] - origin) @ normal) / (direction @ normal)
        offset = origin + step * direction - positions[taxel]
        offset *= min(1.0, self.size(taxel) / max(float(np.linalg.norm(offset)), 1e-9))
        link = int(self.links[taxel])
        return SurfacePoint(
            taxel, link, self.scene.to_link(link, positions[taxel] + offset)
        )

    def size(self, taxel: int) -> float:
        """Radius of a circle of a taxel's area [m]."""
        return float(np.sqrt(self.scene.setup.areas[taxel] / np.pi))


Mode = Literal["poke", "double-pat", "grab", "stroke"]
DOUBLE_CLICK = 0.35
"""A click so soon after another makes a double pat of both [s]."""
CLOSE = 0.05
"""How near to the first click the second one of a double pat is [m]."""
MIN_SECONDS: dict[TouchKind, float] = {"grab": 0.8, "double_pat": 0.4}
"""How long a hand takes for these, though a poke is set to be shorter [s]."""
STROKE_LENGTH = 0.12
"""Of the stroke that a click makes in that mode [m]."""
STROKE_TICK = 0.05
"""Between its moves [s]."""


@final
class Hand:
    """Makes orders of what the mouse does, each at its time.

    A click pokes once it is too late for a second one. That would make a double pat of
    both: a fingertip that pokes twice is felt as a poke, and has commanded by then.

    Attributes:
        mode: what a click does.
        force: of what is begun next [N].
        seconds: how long it lasts; a grab or double pat takes its time [s].
    """

    def __init__(self, setup: SceneDescription, send: Callable[[Order], None]) -> None:
        """Touch nothing yet.

        Args:
            setup: the skin.
            send: is given each order; may be called from any thread.
        """
        self.setup = setup
        self.send = send
        self.mode: Mode = "poke"
        self.force = 12.0
        self.seconds = 0.3
        self.keys = count(1)
        self.once: tuple[float, SurfacePoint] | None = None
        self.later: list[tuple[float, int, TouchOrder]] = []
        self.dragged: TouchOrder | None = None
        self.lock = RLock()

    def click(self, spot: SurfacePoint, now: float, mode: Mode | None = None) -> None:
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
            self.poke(spot, now)
        else:
            kind = "grab" if mode == "grab" else "double_pat"
            self.at(now, self.order(kind, spot, next(self.keys)))
        self.tick(now)

    def poke(self, spot: SurfacePoint, now: float) -> None:
        """Poke soon, or pat twice if a poke was about to begin."""
        with self.lock:
            self.tick(now)
            first = None if self.once is None else self.once[1]
            if first is not None and are_near(first, spot):
                self.at(now, self.order("double_pat", first, next(self.keys)))
                self.once = None
                return
            if first is not None:
                self.at(now, self.order("poke", first, next(self.keys)))
            self.once = (now + DOUBLE_CLICK, spot)

    def stroke(self, spot: SurfacePoint, now: float) -> None:
        """Stroke along the patch from a spot on, over taxels of the same link."""
        key = next(self.keys)
        path = self.path(spot)
        for number, place in enumerate(path):
            order = self.order("move" if number else "begin", place, key)
            self.at(now + number * STROKE_TICK, order)
        end = now + len(path) * STROKE_TICK
        self.at(end, self.order("end", path[-1], key))

    def path(self, spot: SurfacePoint) -> list[SurfacePoint]:
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
        return [SurfacePoint(int(t), spot.link, setup.positions[t]) for t in near]

    def drag(
        self, phase: Literal["start", "update", "end"], spot: SurfacePoint | None
    ) -> None:
        """Drag a finger; where there is no skin it stays where it last was.

        It lands when it begins to move: a browser that draws slowly tells of the one
        long after the other, and a finger that rests before it moves is no stroke.

        Args:
            phase: of the drag.
            spot: where the mouse is on the skin.
        """
        finger = self.dragged
        if finger is not None and phase == "start":
            self.send(replace(finger, kind="end"))
            finger = None
        if finger is not None and finger.kind == "begin":
            self.send(finger)
            finger = replace(finger, kind="move")
        if spot is not None and finger is not None:
            finger = self.order("move", spot, finger.key)
            self.send(finger)
        elif spot is not None and phase != "end":
            finger = self.order("begin", spot, next(self.keys))
        if phase == "end" and finger is not None:
            self.send(replace(finger, kind="end"))
        self.dragged = None if phase == "end" else finger

    def order(
        self,
        kind: TouchKind,
        spot: SurfacePoint,
        key: int,
    ) -> TouchOrder:
        """An order for a spot with the force and duration that are set."""
        x, y, z = spot.p_link.tolist()
        link = self.setup.links[spot.link]
        seconds = max(self.seconds, MIN_SECONDS.get(kind, 0.0))
        return TouchOrder(kind, link, (x, y, z), self.force, seconds, key)

    def at(self, when: float, order: TouchOrder) -> None:
        """Send an order later."""
        with self.lock:
            heapq.heappush(self.later, (when, next(self.keys), order))

    def tick(self, now: float) -> None:
        """Send what is due."""
        with self.lock:
            if self.once is not None and self.once[0] <= now:
                self.at(now, self.order("poke", self.once[1], next(self.keys)))
                self.once = None
            while self.later and self.later[0][0] <= now:
                self.send(heapq.heappop(self.later)[2])


def are_near(one: SurfacePoint, other: SurfacePoint) -> bool:
    """Whether two clicks are on the same place, as far as a hand cares."""
    away = np.linalg.norm(one.p_link - other.p_link)
    return one.link == other.link and bool(away <= CLOSE)
