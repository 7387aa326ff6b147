"""This module lets a person mark regions of a surface with a brush, the mouse."""

from collections.abc import Callable
from typing import Literal, final

import numpy as np
from viser import GuiApi, GuiEvent, Icon

from eskin.page.guide import WAITING, render_request, render_result
from eskin.page.hand import SurfacePoint
from eskin.page.messages import (
    Order,
    PageOrder,
    PaintOrder,
    SceneDescription,
    ViewUpdate,
)

STEP = 0.5
"""Distance of two balls of a stroke, as a share of their radius."""
RADII_MM = (5, 150)
"""Smallest and largest radius of the brush [mm]."""
KINDS = ("skin", "keep out")


@final
class PaintBrush:
    """Turns clicks and drags of the mouse into balls; those of one drag are a stroke.

    Attributes:
        radius: radius of the next balls [m].
        keeps_out: whether they mark a zone without skin.
    """

    def __init__(self, setup: SceneDescription, send: Callable[[Order], None]) -> None:
        """Start without strokes.

        Args:
            setup: description of the scene, whose taxels are points of the surface.
            send: function called with each ball.
        """
        self.setup, self.send = setup, send
        self.radius, self.keeps_out = 0.04, False
        self.strokes = 0
        self.pressed: SurfacePoint | None = None
        self.last: SurfacePoint | None = None

    def click(self, spot: SurfacePoint, now: float, mode: object = None) -> None:
        """Paint one ball at a point; `now` and `mode` are those of a hand, unused."""
        self.strokes += 1
        self.paint(spot)

    def drag(
        self, phase: Literal["start", "update", "end"], spot: SurfacePoint | None
    ) -> None:
        """Paint along a drag, which begins when the mouse moves.

        Args:
            phase: phase of the drag.
            spot: point of the surface under the mouse; None where there is none.
        """
        if phase == "start":
            self.strokes += 1
            self.pressed, self.last = spot, None
            return
        first, self.pressed = self.pressed, None
        for each in (first, spot):
            if each is not None and self.is_away(each):
                self.paint(each)

    def is_away(self, spot: SurfacePoint) -> bool:
        """Return whether a point is far enough from the last ball of the stroke."""
        last = self.last
        if last is None or last.link != spot.link:
            return True
        return bool(np.linalg.norm(spot.p_link - last.p_link) >= STEP * self.radius)

    def paint(self, spot: SurfacePoint) -> None:
        """Send a ball at a point."""
        x, y, z = np.asarray(spot.p_link, np.float64).tolist()
        self.last = spot
        link = self.setup.links[spot.link]
        self.send(
            PaintOrder(self.strokes, link, (x, y, z), self.radius, self.keeps_out)
        )

    def tick(self, now: float) -> None:
        """Do nothing: every ball is sent at once."""


@final
class PaintPanel:
    """Shows the brush and what is painted in place of the usual panel."""

    def __init__(
        self, gui: GuiApi, brush: PaintBrush, send: Callable[[Order], None]
    ) -> None:
        """Lay out the panel.

        Args:
            gui: interface of the server.
            brush: brush that the panel sets.
            send: function called with the orders of the buttons.
        """
        self.brush, self.send = brush, send
        self.board = WAITING
        self.request = gui.add_html(render_request(self.board))
        low, high = RADII_MM
        self.radius = gui.add_slider(
            "radius [mm]", min=low, max=high, step=1, initial_value=40
        )
        self.kind = gui.add_dropdown("paint", options=KINDS, initial_value=KINDS[0])
        self.undo = gui.add_button("Undo", icon=Icon.ARROW_BACK_UP)
        self.save = gui.add_button("Save", icon=Icon.DEVICE_FLOPPY)
        self.close = gui.add_button("Close", icon=Icon.CHECK)
        self.result = gui.add_html("")
        self.radius.on_update(self.set_brush)
        self.kind.on_update(self.set_brush)
        self.undo.on_click(self.order_undo)
        self.save.on_click(self.order_save)
        self.close.on_click(self.order_close)

    async def set_brush(self, event: GuiEvent) -> None:
        """Take the radius and the kind of the next balls."""
        self.brush.radius = 1e-3 * float(self.radius.value)
        self.brush.keeps_out = self.kind.value == KINDS[1]

    async def order_undo(self, event: GuiEvent) -> None:
        """Ask to remove the last stroke."""
        self.send(PageOrder("undo"))

    async def order_save(self, event: GuiEvent) -> None:
        """Ask to write what is painted."""
        self.send(PageOrder("save"))

    async def order_close(self, event: GuiEvent) -> None:
        """Ask to end the page."""
        self.send(PageOrder("close"))

    def take(self, update: ViewUpdate) -> None:
        """Store the board of an update."""
        self.board = update.guide or WAITING

    def draw(self, update: ViewUpdate) -> None:
        """Draw the board."""
        self.request.content = render_request(self.board)
        self.result.content = render_result(self.board) if self.board.result else ""
