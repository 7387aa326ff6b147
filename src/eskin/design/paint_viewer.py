"""This module lets a person paint regions of a robot's surface in the browser."""

from collections.abc import Callable
from dataclasses import replace
from threading import Event as Flag
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Bool

from eskin.page import GuideBoard, Order, PageOrder, PaintOrder
from eskin.page.appearance import describe_scene
from eskin.page.process import PageProcess
from eskin.page.viewer import ViewerConfig, build_still
from eskin.skin import MountedSkin

PAINTED = 60.0
"""Pressure that shows a painted point [kPa]; a point of a keep-out zone is shown as a
taxel that is not valid."""
REQUEST = "Drag over the robot to paint, or click; drag beside it to turn the view."


@final
class PaintViewer:
    """Shows points of a robot's surface, and keeps what a person paints on them.

    Attributes:
        balls: balls painted so far, in their order.
        closed: flag set once the person has closed the page by its button.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        on_save: Callable[[tuple[PaintOrder, ...]], str],
        previous: Bool[np.ndarray, "2 taxel"],
        max_balls: int,
        config: ViewerConfig | None = None,
    ) -> None:
        """Start the page's process.

        Args:
            mounted: points of the surface, as the taxels of a skin on its robot.
            on_save: function that writes the balls; it returns a line that says so.
            previous: points that are painted already, and points of keep-out zones.
            max_balls: largest number of balls.
            config: configuration of the page.

        Raises:
            DeviceError: the port is not available.
        """
        config = config or ViewerConfig()
        self.mounted, self.on_save, self.previous = mounted, on_save, previous
        self.max_balls, self.note = max_balls, ""
        self.balls: list[PaintOrder] = []
        self.closed, self.lock = Flag(), RLock()
        title = f"{mounted.robot.name}: paint the skin"
        scene = replace(describe_scene(mounted, ()), title=title, paints=True)
        self.page = PageProcess(scene, config.port, self.take_order, config.token)
        self.show()

    def take_order(self, order: Order) -> None:
        """Paint a ball, remove the last stroke, save, or end the page."""
        with self.lock:
            self.note = ""
            match order:
                case PaintOrder() if len(self.balls) < self.max_balls:
                    self.balls.append(order)
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

    def find_painted(self) -> Bool[np.ndarray, "2 taxel"]:
        """Return which points are painted, and which lie in keep-out zones."""
        found = self.previous.copy()
        names = np.array(self.mounted.robot.link_names)
        links = names[self.mounted.taxel_link_index]
        for ball in self.balls:
            offsets = self.mounted.skin.positions - np.array(ball.p_link)
            inside = np.linalg.norm(offsets, axis=1) <= ball.radius
            found[int(ball.keeps_out)] |= inside & (links == ball.link)
        return found

    def show(self) -> None:
        """Show what is painted."""
        painted, kept_out = self.find_painted()
        area = 1e4 * float(self.mounted.skin.areas[painted & ~kept_out].sum())
        strokes = len({ball.stroke for ball in self.balls})
        lines = [f"about {area:.0f} cm2 painted; strokes: {strokes}"]
        if self.balls:
            link, p_link = self.balls[-1].link, self.balls[-1].p_link
            place = " ".join(f"{1e3 * value:.0f}" for value in p_link)
            lines.append(f"a matrix there: eskin skin place --link {link} --at {place}")
        board = GuideBoard(REQUEST, 0.0, None, (*lines, *filter(None, [self.note])))
        q = np.zeros(len(self.mounted.robot.joint_names))
        pressure = np.where(painted, PAINTED, 0.0).astype(np.float16)
        still = build_still(self.mounted, 0.0, q, pressure, ~kept_out)
        self.page.give(replace(still, guide=board))

    def wait_closed(self) -> None:
        """Wait until the person has closed the page, or its process has ended."""
        self.page.wait_for(self.closed)

    def close(self) -> None:
        """End the page's process."""
        self.page.close()
