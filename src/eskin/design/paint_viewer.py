"""This module lets a person paint regions of a robot's surface in the browser."""

from collections.abc import Callable
from threading import Event as Flag
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Bool

from eskin.page import GuideBoard, Order, PageOrder, PaintOrder, ViewUpdate
from eskin.page.appearance import describe_scene
from eskin.page.process import PageProcess
from eskin.page.viewer import ViewerConfig, pack_poses
from eskin.skin import MountedSkin

PAINTED = 60.0
"""Pressure that shows a painted point [kPa]; a point of a keep-out zone is shown as a
taxel that is not valid."""
TICK = 0.1
"""Interval between checks of the page's process [s]."""
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
        existing: Bool[np.ndarray, "2 taxel"],
        max_balls: int,
        config: ViewerConfig | None = None,
    ) -> None:
        """Start the page's process.

        Args:
            mounted: points of the surface, as the taxels of a skin on its robot.
            on_save: function that writes the balls; it returns a line that says so.
            existing: points that were painted before, and points of keep-out zones.
            max_balls: largest number of balls.
            config: configuration of the page.

        Raises:
            DeviceError: the port is not available.
        """
        config = config or ViewerConfig()
        self.mounted, self.on_save, self.existing = mounted, on_save, existing
        self.max_balls, self.note = max_balls, ""
        self.balls: list[PaintOrder] = []
        self.closed, self.lock = Flag(), RLock()
        scene = describe_scene(mounted, (), paints=True)
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
                        f"not painted: {self.most} balls are painted, and no more are "
                        "allowed; undo some, or use a larger radius"
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
        found = self.existing.copy()
        names = np.array(self.mounted.robot.link_names)
        links = names[self.mounted.taxel_link_index]
        for ball in self.balls:
            away = self.mounted.skin.positions - np.array(ball.p_link)
            near = np.linalg.norm(away, axis=1) <= ball.radius
            found[int(ball.keeps_out)] |= near & (links == ball.link)
        return found

    def show(self) -> None:
        """Show what is painted."""
        painted, kept_out = self.find_painted()
        area = 1e4 * float(self.mounted.skin.areas[painted & ~kept_out].sum())
        strokes = len({ball.stroke for ball in self.balls})
        lines = [f"about {area:.0f} cm2 painted; strokes: {strokes}"]
        self.page.give(
            ViewUpdate(
                seconds=0.0,
                poses=pack_poses(
                    self.mounted.kinematics.poses(
                        np.zeros(len(self.mounted.robot.joint_names))
                    )
                ),
                pressure=np.where(painted, PAINTED, 0.0).astype(np.float16),
                valid=np.packbits(~kept_out),
                contacts=(),
                touches=(),
                force=0.0,
                peak=0.0,
                log_entries=(),
                rate=0.0,
                step=0.0,
                age=0.0,
                guide=GuideBoard(
                    REQUEST, 0.0, None, (*lines, *filter(None, [self.note]))
                ),
            )
        )

    def wait_closed(self) -> None:
        """Wait until the person has closed the page, or its process has ended."""
        while self.page.failure is None and not self.closed.wait(TICK):
            pass

    def close(self) -> None:
        """End the page's process."""
        self.page.close()
