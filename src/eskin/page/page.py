"""This module assembles the page, which shows updates and sends orders."""

from collections.abc import Callable
from dataclasses import replace
from time import monotonic
from typing import final

import numpy as np
from viser import (
    BatchedMeshHandle,
    SceneClickEvent,
    SceneNodeDragEvent,
    SceneNodePointerEvent,
    ViserServer,
)

from eskin.page.boards import GuidePanel, PaintPanel
from eskin.page.colours import ColourScale
from eskin.page.hand import Mouse, MouseHand, PaintBrush, TaxelPicker, TouchMode
from eskin.page.messages import Order, PageOrder, SceneDescription, ViewUpdate
from eskin.page.panel import Panel, TouchPanel
from eskin.page.scene import GripperModel, Marks, PagePart, Scene, TargetMark

SCALE = 60.0
"""Initial pressure of the lightest colour [kPa]; the user can change it."""
PANEL_PERIOD = 0.1
"""Interval between redraws of the panel [s]."""
WIDTH, WIDER = 320, 400
"""Width of the panel, and of a panel with two columns [px]."""
BRAND = (31, 120, 137)
SAME_CLICK = 0.05
"""Longest time between the two events of a click on a taxel [s]."""
MISSED = "that click hit no taxel: click on the dots"
"""What the page says of a click beside the skin."""


def lay_out(server: ViserServer, setup: SceneDescription, width: int = WIDTH) -> Scene:
    """Lay out a page with its panel on the right, and draw its scene."""
    gui = server.gui
    gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(width)
    gui.set_panel_label(setup.title)
    scene = Scene(server, setup, ColourScale(SCALE))
    scene.set_camera(np.array(setup.middle), setup.distance)
    server.on_client_connect(scene.turn)
    return scene


@final
class Page:
    """Shows the scene and the panel of one server.

    Attributes:
        parts: what shows the updates, in this order; the panel is the last.
    """

    def __init__(
        self,
        server: ViserServer,
        setup: SceneDescription,
        send: Callable[[Order], None],
    ) -> None:
        """Lay out the page.

        Args:
            server: server of the page.
            setup: description of the scene.
            send: function called with every order; unused if the page is not
                touchable, and neither calibrates nor paints.
        """
        self.server = server
        self.scene = lay_out(server, setup)
        self.picker = TaxelPicker(self.scene)
        self.mouse, self.panel = build_panel(server, self.scene, send)
        self.parts: list[PagePart] = [self.scene, Marks(server, self.scene)]
        self.parts.append(TargetMark(server, self.scene))
        if setup.is_arm:
            self.parts.append(GripperModel(server, setup))
        self.parts.append(self.panel)
        self.drawn, self.guide = -np.inf, None
        self.seconds, self.hit = 0.0, -np.inf
        if setup.touchable or setup.paints:
            for link, discs in self.scene.discs.items():
                self.register_events(link, discs)
                self.register_events(link, self.scene.add_pads(link))
            server.on_client_disconnect(lambda _: self.mouse.drag("end", None))
            self.register_misses()
        if setup.calibrates:
            server.on_client_connect(lambda _: send(PageOrder("opened")))

    def register_events(self, link: int, discs: BatchedMeshHandle) -> None:
        """Turn clicks and drags on the discs or pads of a link into touches."""
        taxels, mouse = self.scene.taxels[link], self.mouse

        def click(event: SceneNodePointerEvent, mode: TouchMode | None) -> None:
            if event.instance_index is not None:
                self.hit = monotonic()
                spot = self.picker.pick_taxel(int(taxels[event.instance_index]))
                mouse.click(spot, monotonic(), mode)

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
                spot = self.picker.pick_taxel(int(taxels[event.instance_index]))
            else:
                ray = np.asarray(event.end_position) - eye
                spot = self.picker.pick_along_ray(eye, ray)
            mouse.drag(event.phase, spot)

    def register_misses(self) -> None:
        """Say in the log where a click has hit no taxel."""

        @self.server.scene.on_click()
        def _(event: SceneClickEvent) -> None:
            # A click on a taxel comes just before, as an event of its own.
            if monotonic() - self.hit > SAME_CLICK and isinstance(
                self.panel, TouchPanel
            ):
                self.panel.note(self.seconds, MISSED)

    def show(self, update: ViewUpdate) -> None:
        """Show one update."""
        self.seconds = update.seconds
        guide = update.guide and replace(update.guide, share=0.0)
        with self.server.atomic():
            for part in self.parts:
                part.update(update)
            passed = update.seconds - self.drawn
            if guide != self.guide or not 0.0 <= passed < PANEL_PERIOD:
                self.drawn, self.guide = update.seconds, guide
                self.panel.render(update)

    def tick(self) -> None:
        """Send the touches that are due."""
        self.mouse.tick(monotonic())


def build_panel(
    server: ViserServer, scene: Scene, send: Callable[[Order], None]
) -> tuple[Mouse, Panel]:
    """Build the mouse and the panel that a scene asks for."""
    gui, setup, scale = server.gui, scene.setup, scene.scale
    if setup.paints:
        brush = PaintBrush(setup, send)
        return brush, PaintPanel(gui, brush, send)
    hand = MouseHand(setup, send)
    if setup.calibrates:
        return hand, GuidePanel(gui, setup, scale, send)
    return hand, TouchPanel(gui, setup, scale, hand)
