"""This module shows the page, in a process of its own: `python -m eskin.page FD`.

`eskin.page` starts it. Over the socket FD it receives a scene description, then
updates; it sends back the port, a message after each update shown, and orders. It
ends when the other end of the socket is closed.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from threading import Lock
from time import monotonic
from typing import final

import numpy as np
from viser import (
    BatchedMeshHandle,
    SceneNodeDragEvent,
    SceneNodePointerEvent,
    ViserServer,
)

from eskin.errors import DeviceError
from eskin.page.hand import KINDS, MISSED, Mouse, MouseHand, PaintBrush, TouchMode
from eskin.page.marks import GripperModel, Marks, QuestionBanner, TargetMark
from eskin.page.messages import (
    MessageKind,
    Order,
    PageOrder,
    QuestionBoard,
    SceneDescription,
    ViewUpdate,
)
from eskin.page.panel import GuidePanel, Key, PaintPanel, Panel, TouchPanel
from eskin.page.scene import PagePart, Scene, lay_out
from eskin.page.server import open_server

PANEL_PERIOD = 0.1
"""Interval between redraws of the panel [s]."""
TICK = 0.01
"""Interval between checks for scheduled touches [s]."""


@final
class Page:
    """Shows the scene and the panel of one server.

    Attributes:
        parts: what shows the updates, in this order; the panel is the last.
        hit: whether a click or drag has hit since the last key that tells of one.
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
        self.mouse, self.panel = build_panel(server, self.scene, send)
        arm: list[PagePart] = []
        if setup.is_arm:
            arm = [GripperModel(server, setup), QuestionBanner(server, setup)]
        self.target = TargetMark(server, self.scene, setup.touchable)
        marks = Marks(server, self.scene), self.target
        self.parts = [self.scene, *marks, *arm, self.panel]
        self.drawn = -np.inf
        self.guide = None
        self.seconds = 0.0
        self.hit = False
        self.mouse.tell = self.tell
        if setup.touchable or setup.paints:
            for link, discs in self.scene.discs.items():
                self.register_events(link, discs)
                self.register_events(link, self.scene.add_pads(link))
            server.on_client_disconnect(lambda _: self.mouse.drag("end", None))
            self.register_press("M", is_click=True)
            self.register_press("T", is_click=False)
        if setup.calibrates:
            server.on_client_connect(lambda _: send(PageOrder("opened")))

    def register_events(self, link: int, discs: BatchedMeshHandle) -> None:
        """Turn clicks and drags on the discs or pads of a link into touches."""
        scene = self.scene
        taxels = self.scene.taxels[link]
        mouse = self.mouse

        def click(event: SceneNodePointerEvent, mode: TouchMode | None) -> None:
            # What is hit without an index is the outline of another disc.
            if event.instance_index is not None:
                self.hit = True
                spot = scene.pick_taxel(int(taxels[event.instance_index]))
                mouse.click(spot, monotonic(), mode)

        @discs.on_click
        async def _(event: SceneNodePointerEvent) -> None:
            click(event, None)

        @discs.on_click(modifier="shift")
        async def _(event: SceneNodePointerEvent) -> None:
            click(event, "grab")

        @discs.on_drag("left")
        async def _(event: SceneNodeDragEvent) -> None:
            if event.instance_index is None:
                return
            if event.phase == "start":
                self.hit = True
                spot = scene.pick_taxel(int(taxels[event.instance_index]))
            else:
                eye = np.asarray(event.client.camera.position)
                ray = np.asarray(event.end_position) - eye
                spot = scene.pick_along_ray(eye, ray)
            mouse.drag(event.phase, spot)

    def register_press(self, key: Key, is_click: bool) -> None:
        """Answer clicks or drags that hit nothing; the browser tells each by a key."""
        what = "click" if is_click else "drag"
        command = self.server.gui.add_command(f"answer a {what}", hotkey=key)

        @command.on_trigger
        async def _(event: object) -> None:
            # The key comes after what the press has hit.
            hit = self.hit
            self.hit = False
            if not hit and is_click:
                self.mouse.click(None, monotonic())
            elif not hit:
                self.tell(MISSED)

    def tell(self, text: str) -> None:
        """Answer in the log what was done with the mouse, which then needs no hint."""
        self.panel.note(self.seconds, text)
        self.target.hints = False

    def show(self, update: ViewUpdate) -> None:
        """Show one update."""
        self.seconds = update.seconds
        self.mouse.answer = find_answer(update.question)
        guide = update.guide and replace(update.guide, share=0.0)
        with self.server.atomic():
            for part in self.parts:
                part.update(update)
            passed = update.seconds - self.drawn
            if guide != self.guide or not 0.0 <= passed < PANEL_PERIOD:
                self.drawn = update.seconds
                self.guide = guide
                self.panel.render(update)


def find_answer(board: QuestionBoard | None) -> TouchMode | None:
    """Return the mode of the mouse that answers a question; None where none is open."""
    if board is None or not board.action:
        return None
    modes: list[TouchMode] = [m for m, kind in KINDS.items() if kind == board.answer]
    return modes[0] if modes else None


def build_panel(
    server: ViserServer, scene: Scene, send: Callable[[Order], None]
) -> tuple[Mouse, Panel]:
    """Build the mouse and the panel that a scene asks for."""
    gui = server.gui
    setup = scene.setup
    scale = scene.scale
    if setup.paints:
        brush = PaintBrush(setup, send)
        return brush, PaintPanel(gui, setup, brush)
    hand = MouseHand(setup, send)
    if setup.calibrates:
        return hand, GuidePanel(gui, setup, scale, send)
    return hand, TouchPanel(gui, setup, scale, hand)


def main(descriptor: int) -> None:
    """Serve the page until the other end of the socket is closed."""
    with Connection(descriptor) as connection:
        try:
            serve(connection)
        except (EOFError, OSError):
            pass
    # Threads of the server must not keep the process alive.
    os._exit(0)


def serve(connection: Connection) -> None:
    """Serve the page and show each update received over a connection."""
    lock = Lock()

    def send(kind: MessageKind, value: object = None) -> None:
        with lock:
            connection.send((kind, value))

    port, token, setup = connection.recv()
    try:
        server = open_server(port, token)
    except DeviceError as error:
        send("refused", str(error))
        return
    page = Page(server, setup, partial(send, "order"))
    send("ready", server.get_port())
    while True:
        if connection.poll(TICK):
            page.show(connection.recv())
            send("shown")
        page.mouse.tick(monotonic())


if __name__ == "__main__":
    main(int(sys.argv[1]))
