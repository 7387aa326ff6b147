"""This module shows the guide through a calibration, and takes a person's clicks."""

from collections import deque
from collections.abc import Callable
from html import escape
from typing import final

from viser import GuiApi, GuiEvent, Icon

from eskin.page.colours import ColourScale
from eskin.page.html import (
    LINE,
    render_block,
    render_log,
    render_patches,
    render_warning,
    to_words,
    unpack_valid,
)
from eskin.page.messages import (
    GuideBoard,
    LogEntry,
    Order,
    PageOrder,
    SceneDescription,
    ViewUpdate,
)
from eskin.page.panel import LINES, add_scale

WAITING = GuideBoard("waiting for the skin", 0.0)
"""What is shown before the first scan."""


@final
class CalibrationPanel:
    """Shows what to do, what was felt and the result in place of the usual panel."""

    def __init__(
        self,
        gui: GuiApi,
        setup: SceneDescription,
        scale: ColourScale,
        send: Callable[[Order], None],
    ) -> None:
        """Lay out the panel.

        Args:
            gui: interface of the server.
            setup: description of the scene.
            scale: colour scale, whose maximum the panel can change.
            send: function called with the orders of the buttons.
        """
        self.setup, self.send = setup, send
        self.board = WAITING
        self.log_entries: deque[LogEntry] = deque(maxlen=LINES)
        if setup.warning:
            gui.add_html(render_warning(setup.warning))
        self.request = gui.add_html(render_request(self.board))
        self.progress = gui.add_progress_bar(0.0)
        self.skip = gui.add_button(
            "Skip this", visible=False, icon=Icon.PLAYER_SKIP_FORWARD
        )
        self.again = gui.add_button(
            "Repeat the last press", visible=False, icon=Icon.ARROW_BACK_UP
        )
        self.close = gui.add_button("Close", visible=False, icon=Icon.CHECK)
        self.result = gui.add_html("")
        self.log = gui.add_html(render_log(()))
        self.legend = gui.add_html(render_block(scale.legend()))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Skin", Icon.GRID_DOTS):
            self.patches = gui.add_html("")
        with tabs.add_tab("View", Icon.PALETTE):
            add_scale(gui, scale, self.legend)
        self.skip.on_click(self.order_skip)
        self.again.on_click(self.order_again)
        self.close.on_click(self.order_close)

    async def order_skip(self, event: GuiEvent) -> None:
        """Ask to leave out the patch or point that is shown."""
        if self.board.place is not None:
            self.send(PageOrder("skip", self.board.place.name))

    async def order_again(self, event: GuiEvent) -> None:
        """Ask to repeat the last press of those that are shown."""
        self.send(PageOrder("again", float(self.board.presses)))

    async def order_close(self, event: GuiEvent) -> None:
        """Ask to end the page."""
        self.send(PageOrder("close"))

    def take(self, update: ViewUpdate) -> None:
        """Store the guide and the log entries of an update."""
        self.board = update.guide or WAITING
        self.log_entries.extendleft(update.log_entries)

    def draw(self, update: ViewUpdate) -> None:
        """Draw an update."""
        board = self.board
        self.request.content = render_request(board)
        self.progress.value = round(100.0 * board.share, 1)
        self.skip.visible = board.place is not None
        if board.place is not None:
            self.skip.label = f"Skip {to_words(board.place.name)}"
        self.again.visible = board.presses > 0
        self.close.visible = bool(board.result)
        self.result.content = render_result(board) if board.result else ""
        self.log.content = render_log(tuple(self.log_entries))
        self.patches.content = render_patches(
            self.setup, unpack_valid(update, self.setup)
        )


def render_request(board: GuideBoard) -> str:
    """Return what to do now as HTML."""
    return render_block(
        '<div style="font-size:15px;font-weight:600;min-height:72px;padding:4px 0 8px">'
        f"{escape(board.request)}</div>"
    )


def render_result(board: GuideBoard) -> str:
    """Return the result as HTML, one line below the other."""
    lines = "".join(f"<div>{escape(line)}</div>" for line in board.result)
    style = f"padding:5px 8px;border-radius:6px;background:{LINE}"
    return render_block(f'<div style="{style}">{lines}</div>')
