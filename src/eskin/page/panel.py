"""The panel beside the scene: what is felt and thought, and what can be done."""

from collections import deque
from typing import cast, final

import numpy as np
from viser import GuiApi, GuiEvent, GuiHtmlHandle, Icon

from eskin.page import readout
from eskin.page.colours import ColourScale
from eskin.page.hand import Hand, Mode
from eskin.page.orders import PageKind, PageOrder
from eskin.page.picture import Picture, Saying
from eskin.page.setup import Setup
from eskin.page.strip import Strip

LINES = 8
"""Of the log."""
MODES = ("poke", "double-pat", "grab", "stroke")
KILL = 0.1
"""Share of the taxels that a press of the button takes."""


@final
class Panel:
    """Everything beside the scene; drawn anew ten times a second where it changed."""

    def __init__(
        self, gui: GuiApi, setup: Setup, scale: ColourScale, hand: Hand
    ) -> None:
        """Lay the panel out.

        Args:
            gui: of the server.
            setup: the skin.
            scale: its maximum can be changed.
            hand: takes mode, force and duration; other orders are sent as it sends.
        """
        self.gui = gui
        self.setup = setup
        self.scale = scale
        self.hand = hand
        self.sayings: deque[Saying] = deque(maxlen=LINES)
        self.status = gui.add_html("")
        self.bars = gui.add_html(readout.bars((), setup.gestures))
        self.strip = Strip(gui)
        self.legend = gui.add_html(readout.block(scale.legend()))
        tabs = gui.add_tab_group()
        if setup.touchable:
            with tabs.add_tab("Hand", Icon.HAND_FINGER):
                self.add_touch()
        with tabs.add_tab("Skin", Icon.GRID_DOTS):
            self.patches = gui.add_html("")
            if setup.touchable:
                self.add_trouble()
        with tabs.add_tab("View", Icon.PALETTE):
            add_scale(gui, scale, self.legend)
        self.log = gui.add_html(readout.log(()))

    def add_touch(self) -> None:
        """What a click does, how hard and how long."""
        gui, hand = self.gui, self.hand
        mode = gui.add_dropdown(
            "click is a",
            MODES,
            initial_value=hand.mode,
            hint="Click twice for a double-pat, drag for a stroke, shift and click for "
            "a grab; anywhere else, drag to turn the view",
        )
        force = gui.add_slider(
            "force [N]", min=1, max=40, step=1, initial_value=int(hand.force)
        )
        seconds = gui.add_slider(
            "duration [s]", min=0.1, max=3.0, step=0.1, initial_value=hand.seconds
        )
        if self.setup.is_arm:
            self.add_task()

        @mode.on_update
        async def _(event: GuiEvent) -> None:
            hand.mode = cast(Mode, event.target.value)

        @force.on_update
        async def _(event: GuiEvent) -> None:
            hand.force = float(event.target.value)

        @seconds.on_update
        async def _(event: GuiEvent) -> None:
            hand.seconds = float(event.target.value)

    def add_task(self) -> None:
        """Pause what the arm does, and go on."""
        task = self.gui.add_button_group("task", ("pause", "resume"))

        @task.on_click
        async def _(event: GuiEvent) -> None:
            is_pause = event.target.value == "pause"
            self.order("pause_task" if is_pause else "resume_task")

    def add_trouble(self) -> None:
        """Cables to pull, taxels to kill, skins to choose, recording."""
        gui, setup = self.gui, self.setup
        patch = gui.add_dropdown("patch", setup.patches)
        cable = gui.add_button_group("its cable", ("unplug", "plug in"))
        taxels = gui.add_button_group("taxels", (f"kill {KILL:.0%}", "restore"))
        record = gui.add_button_group("recording", ("record", "stop"))

        @cable.on_click
        async def _(event: GuiEvent) -> None:
            self.order(
                "unplug" if event.target.value == "unplug" else "plug", patch.value
            )

        @taxels.on_click
        async def _(event: GuiEvent) -> None:
            if event.target.value == "restore":
                self.order("restore")
            else:
                self.order("kill", KILL)

        @record.on_click
        async def _(event: GuiEvent) -> None:
            is_start = event.target.value == "record"
            self.order("record" if is_start else "stop_recording")

        if len(setup.skins) > 1:
            skin = gui.add_dropdown("skin", setup.skins)

            @skin.on_update
            async def _(event: GuiEvent) -> None:
                self.order("skin", event.target.value)

    def order(self, kind: PageKind, value: str | float | None = None) -> None:
        """Send what is not a touch."""
        self.hand.send(PageOrder(kind, value))

    def take(self, picture: Picture) -> None:
        """Keep what a picture tells."""
        self.strip.take(picture)
        self.sayings.extendleft(picture.sayings)

    def draw(self, picture: Picture) -> None:
        """Draw what has changed."""
        self.strip.draw()
        self.status.content = readout.status(picture)
        self.bars.content = readout.bars(picture.touches, self.setup.gestures)
        self.log.content = readout.log(tuple(self.sayings))
        count = self.setup.patch_index.size
        valid = np.unpackbits(picture.valid, count=count).astype(bool)
        self.patches.content = readout.patches(self.setup, valid)


def add_scale(gui: GuiApi, scale: ColourScale, legend: GuiHtmlHandle) -> None:
    """Let the maximum of the colour scale be changed."""
    slider = gui.add_slider(
        "scale to [kPa]", min=5, max=200, step=5, initial_value=int(scale.maximum)
    )

    @slider.on_update
    async def _(event: GuiEvent) -> None:
        scale.maximum = float(event.target.value)
        legend.content = readout.block(scale.legend())
