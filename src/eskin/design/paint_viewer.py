"""This module lets a person paint regions of a robot's surface in the browser."""

from collections.abc import Callable
from dataclasses import replace
from threading import Event as Flag
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Bool
from scipy.spatial import KDTree

from eskin.design.painting import SPACING
from eskin.errors import EskinError
from eskin.page import GuideBoard, Order, PageOrder, PaintOrder
from eskin.page.appearance import describe_scene
from eskin.page.process import PageProcess
from eskin.page.viewer import ViewerConfig, build_still
from eskin.skin import MountedSkin, Skin

PAINTED = 60.0
"""Pressure that shows a painted point [kPa]; a point of a keep-out zone is shown as a
taxel that is not valid."""
REQUEST = (
    "Drag over the robot to paint, or click to place a matrix where that is chosen; "
    "drag beside it to turn the view."
)


@final
class PaintViewer:
    """Shows points of a robot's surface, and keeps what a person paints on them.

    Attributes:
        balls: balls and matrices so far, in their order.
        closed: flag set once the person has closed the page by its button.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        on_save: Callable[[tuple[PaintOrder, ...]], str],
        previous: Bool[np.ndarray, "2 taxel"],
        max_balls: int,
        on_place: Callable[[PaintOrder], Skin],
        config: ViewerConfig | None = None,
    ) -> None:
        """Start the page's process.

        Args:
            mounted: points of the surface, as the taxels of a skin on its robot.
            on_save: function that writes the balls; it returns a line that says so.
            previous: points that are painted already, and points of keep-out zones.
            max_balls: largest number of balls.
            on_place: function that returns a matrix as a skin of one patch; it raises
                an `EskinError` where there is no room for it.
            config: configuration of the page.

        Raises:
            DeviceError: the port is not available.
        """
        config = config or ViewerConfig()
        self.mounted = mounted
        self.on_save = on_save
        self.previous = previous
        self.max_balls = max_balls
        self.on_place = on_place
        self.note = ""
        self.balls: list[PaintOrder] = []
        self.closed = Flag()
        self.lock = RLock()
        title = f"{mounted.robot.name}: paint the skin"
        self.q = np.zeros(len(mounted.robot.joint_names))
        scene = describe_scene(mounted, (), self.q)
        scene = replace(scene, title=title, paints=True)
        self.page = PageProcess(scene, config.port, self.take_order, config.token)
        self.show()

    def take_order(self, order: Order) -> None:
        """Paint a ball, place a matrix, undo the last, save, or end the page."""
        with self.lock:
            self.note = ""
            match order:
                case PaintOrder() if len(self.balls) < self.max_balls:
                    self.add_paint(order)
                case PaintOrder():
                    self.note = (
                        f"not painted: {self.max_balls} balls are painted, and no more "
                        "are allowed; undo some, or use a larger radius"
                    )
                case PageOrder(kind="undo") if self.balls:
                    last = self.balls[-1].stroke
                    self.balls = [ball for ball in self.balls if ball.stroke != last]
                case PageOrder(kind="save"):
                    self.note = self.on_save(tuple(self.balls))
                case PageOrder(kind="close"):
                    self.closed.set()
            self.show()

    def add_paint(self, order: PaintOrder) -> None:
        """Add a ball, or a matrix where it has room."""
        if order.matrix is not None:
            self.note = f"the matrix is laid on {order.link}, which takes seconds"
            self.show()
            place = " ".join(f"{1e3 * value:.0f}" for value in order.p_link)
            try:
                self.on_place(order)
            except EskinError as error:
                self.note = f"not placed: {error}"
                return
            self.note = f"on {order.link} at {place} mm; Save writes it"
        self.balls.append(order)

    def find_painted(self) -> Bool[np.ndarray, "2 taxel"]:
        """Return which points are painted, and which lie in keep-out zones."""
        found = self.previous.copy()
        names = np.array(self.mounted.robot.link_names)
        links = names[self.mounted.taxel_link_index]
        for ball in self.balls:
            middles = np.array([ball.p_link])
            radius = ball.radius
            if ball.matrix is not None:
                middles = self.on_place(ball).positions
                radius = SPACING
            away, _ = KDTree(middles).query(self.mounted.skin.positions)
            inside = away <= radius
            found[int(ball.keeps_out)] |= inside & (links == ball.link)
        return found

    def show(self) -> None:
        """Show the painted regions."""
        painted, kept_out = self.find_painted()
        area = 1e4 * float(self.mounted.skin.areas[painted & ~kept_out].sum())
        strokes = len({ball.stroke for ball in self.balls})
        lines = [f"about {area:.0f} cm2 covered; strokes: {strokes}"]
        board = GuideBoard(REQUEST, 0.0, None, (*lines, *filter(None, [self.note])))
        pressure = np.where(painted, PAINTED, 0.0).astype(np.float16)
        still = build_still(self.mounted, 0.0, self.q, pressure, ~kept_out)
        self.page.give(replace(still, guide=board))

    def wait_closed(self) -> None:
        """Wait until the person has closed the page, or its process has ended."""
        self.page.wait_for(self.closed)

    def close(self) -> None:
        """End the page's process."""
        self.page.close()
