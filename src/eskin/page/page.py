"""The page as a whole: what it is shown goes in, what people order comes out."""

from collections.abc import Callable
from time import monotonic
from typing import final

import numpy as np
from viser import (
    BatchedMeshHandle,
    SceneNodeDragEvent,
    SceneNodePointerEvent,
    ViserServer,
)

from eskin.page.board import ComparisonPanel
from eskin.page.colours import ColourScale
from eskin.page.hand import Hand, Mode, Pointing
from eskin.page.messages import Order, SceneDescription, ViewUpdate
from eskin.page.panel import Panel
from eskin.page.scene import GripperModel, Marks, Scene

SCALE = 60.0
"""Pressure of the lightest colour until somebody changes it [kPa]."""
DRAW = 0.1
"""Between two drawings of the panel [s]."""
WIDTH, WIDER = 320, 400
"""Of the panel, and of one with two columns [px]."""
MIDDLE = np.array([0.05, 0.0, 0.3])
"""What the camera looks at, and how far it is [m]."""
DISTANCE = 1.75
BRAND = (31, 120, 137)


@final
class Page:
    """Scene and panel of one server."""

    def __init__(
        self,
        server: ViserServer,
        setup: SceneDescription,
        send: Callable[[Order], None],
    ) -> None:
        """Lay out the page.

        Args:
            server: that serves it.
            setup: what it shows.
            send: is given every order, unless the page is not touchable.
        """
        self.server = server
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDER if setup.compares else WIDTH)
        gui.set_panel_label(setup.title)
        self.scale = ColourScale(SCALE)
        self.scene = Scene(server, setup, self.scale)
        self.scene.look(MIDDLE, DISTANCE)
        self.marks = Marks(server, self.scene)
        self.gripper = GripperModel(server, setup) if setup.is_arm else None
        self.hand = Hand(setup, send)
        self.panel = (
            ComparisonPanel(gui, setup, self.scale)
            if setup.compares
            else Panel(gui, setup, self.scale, self.hand)
        )
        self.pointing = Pointing(self.scene)
        self.drawn = 0.0
        if setup.touchable:
            for link, discs in self.scene.discs.items():
                self.hear(link, discs)
                self.hear(link, self.scene.add_pads(link))
            server.on_client_disconnect(lambda _: self.hand.drag("end", None))

    def hear(self, link: int, discs: BatchedMeshHandle) -> None:
        """Make touches of clicks and drags on the discs or pads of a link."""
        taxels, hand = self.scene.taxels[link], self.hand

        def click(event: SceneNodePointerEvent, mode: Mode | None) -> None:
            if event.instance_index is not None:
                spot = self.pointing.of_taxel(int(taxels[event.instance_index]))
                hand.click(spot, monotonic(), mode)

        @discs.on_click
        async def _(event: SceneNodePointerEvent) -> None:
            click(event, None)

        @discs.on_click(modifier="shift")
        async def _(event: SceneNodePointerEvent) -> None:
            click(event, "grab")

        @discs.on_drag("left")
        async def _(event: SceneNodeDragEvent) -> None:
            eye = np.asarray(event.client.camera.position)
            if event.phase == "start" and event.instance_index is not None:
                spot = self.pointing.of_taxel(int(taxels[event.instance_index]))
            else:
                spot = self.pointing.along(eye, np.asarray(event.end_position) - eye)
            hand.drag(event.phase, spot)

    def show(self, picture: ViewUpdate) -> None:
        """Show one picture."""
        with self.server.atomic():
            self.scene.show(picture)
            self.marks.show(picture)
            if self.gripper is not None and picture.arm is not None:
                self.gripper.show(picture.arm.gripper)
            self.panel.take(picture)
            if picture.seconds - self.drawn >= DRAW or picture.seconds < self.drawn:
                self.drawn = picture.seconds
                self.panel.draw(picture)

    def tick(self) -> None:
        """Send the touches that are due."""
        self.hand.tick(monotonic())
