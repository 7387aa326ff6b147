"""This module assembles the page, which shows updates and sends orders."""

from collections.abc import Callable
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

from eskin.page.board import ComparisonPanel
from eskin.page.colours import ColourScale
from eskin.page.guide import CalibrationPanel
from eskin.page.hand import MouseHand, TaxelPicker, TouchMode
from eskin.page.messages import Order, PageOrder, SceneDescription, ViewUpdate
from eskin.page.paint import PaintBrush, PaintPanel
from eskin.page.panel import Panel
from eskin.page.scene import GripperModel, Marks, Scene, TargetMark

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


@final
class Page:
    """Shows the scene and the panel of one server."""

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
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDER if setup.compares else WIDTH)
        gui.set_panel_label(setup.title)
        self.scale = ColourScale(SCALE)
        self.scene = Scene(server, setup, self.scale)
        self.scene.set_camera(np.array(setup.middle), setup.distance)
        self.marks = Marks(server, self.scene)
        self.target = TargetMark(server, self.scene)
        self.gripper = GripperModel(server, setup) if setup.is_arm else None
        self.hand = (PaintBrush if setup.paints else MouseHand)(setup, send)
        self.panel = self.build_panel(setup, send)
        self.picker = TaxelPicker(self.scene)
        self.drawn = -np.inf
        self.asked: tuple[object, ...] = ()
        self.seconds, self.hit = 0.0, -np.inf
        if setup.touchable or setup.paints:
            for link, discs in self.scene.discs.items():
                self.register_events(link, discs)
                self.register_events(link, self.scene.add_pads(link))
            server.on_client_disconnect(lambda _: self.hand.drag("end", None))
            self.register_misses()
        server.on_client_connect(self.scene.turn)
        if setup.calibrates:
            server.on_client_connect(lambda _: send(PageOrder("opened")))

    def build_panel(
        self, setup: SceneDescription, send: Callable[[Order], None]
    ) -> Panel | ComparisonPanel | CalibrationPanel | PaintPanel:
        """Lay out the panel beside the scene."""
        gui = self.server.gui
        if setup.compares:
            return ComparisonPanel(gui, setup, self.scale)
        if setup.calibrates:
            return CalibrationPanel(gui, setup, self.scale, send)
        if isinstance(self.hand, PaintBrush):
            return PaintPanel(gui, self.hand, send)
        return Panel(gui, setup, self.scale, self.hand)

    def register_events(self, link: int, discs: BatchedMeshHandle) -> None:
        """Turn clicks and drags on the discs or pads of a link into touches."""
        taxels, hand = self.scene.taxels[link], self.hand

        def click(event: SceneNodePointerEvent, mode: TouchMode | None) -> None:
            if event.instance_index is not None:
                self.hit = monotonic()
                spot = self.picker.pick_taxel(int(taxels[event.instance_index]))
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
                spot = self.picker.pick_taxel(int(taxels[event.instance_index]))
            else:
                ray = np.asarray(event.end_position) - eye
                spot = self.picker.pick_along_ray(eye, ray)
            hand.drag(event.phase, spot)

    def register_misses(self) -> None:
        """Say in the log where a click has hit no taxel."""

        @self.server.scene.on_click()
        def _(event: SceneClickEvent) -> None:
            # A click on a taxel comes just before, as an event of its own.
            if monotonic() - self.hit > SAME_CLICK and isinstance(self.panel, Panel):
                self.panel.note(self.seconds, MISSED)

    def show(self, update: ViewUpdate) -> None:
        """Show one update."""
        self.seconds = update.seconds
        with self.server.atomic():
            self.scene.show(update)
            self.marks.show(update)
            self.target.show(None if update.guide is None else update.guide.place)
            if self.gripper is not None and update.arm is not None:
                self.gripper.show(update.arm.gripper, update.arm.carrying)
            self.panel.take(update)
            guide = update.guide
            asked = ()
            if guide is not None:
                asked = (guide.request, guide.place, guide.presses, guide.result)
            passed = update.seconds - self.drawn
            if asked != self.asked or not 0.0 <= passed < PANEL_PERIOD:
                self.drawn, self.asked = update.seconds, asked
                self.panel.draw(update)

    def tick(self) -> None:
        """Send the touches that are due."""
        self.hand.tick(monotonic())
