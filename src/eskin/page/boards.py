"""This module lays out the panels that tell a person what to do."""

from collections import deque
from collections.abc import Callable
from html import escape
from typing import final

from viser import GuiApi, Icon, IconName

from eskin.page.colours import ColourScale
from eskin.page.hand import PaintBrush
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
    PageKind,
    PageOrder,
    SceneDescription,
    ViewUpdate,
)
from eskin.page.panel import LINES, Panel, add_scale, obey

WAITING = GuideBoard("waiting for the skin", 0.0)
"""What is shown before the first scan."""


@final
class GuidePanel(Panel):
    """Guides through a calibration: what to do, what was felt and the result."""

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
        legend = gui.add_html(render_block(scale.legend()))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Skin", Icon.GRID_DOTS):
            self.patches = gui.add_html("")
        with tabs.add_tab("View", Icon.PALETTE):
            add_scale(gui, scale, legend)
        obey(self.skip.on_click, lambda _: self.order_skip())
        obey(self.again.on_click, lambda _: self.order_again())
        obey(self.close.on_click, lambda _: send(PageOrder("close")))

    def order_skip(self) -> None:
        """Ask to leave out the patch or point that is shown."""
        if self.board.place is not None:
            self.send(PageOrder("skip", self.board.place.name))

    def order_again(self) -> None:
        """Ask to repeat the last press of those that are shown."""
        self.send(PageOrder("again", float(self.board.presses)))

    def update(self, update: ViewUpdate) -> None:
        """Store the guide and the log entries of an update."""
        self.board = update.guide or WAITING
        self.log_entries.extendleft(update.log_entries)

    def render(self, update: ViewUpdate) -> None:
        """Show the guide, the log and the patches."""
        board = self.board
        self.request.content = render_request(board)
        self.progress.value = round(100.0 * board.share, 1)
        self.skip.visible = board.place is not None
        if board.place is not None:
            self.skip.label = f"Skip {to_words(board.place.name)}"
        self.again.visible = board.presses > 0
        self.close.visible = bool(board.result)
        self.result.content = render_result(board)
        self.log.content = render_log(tuple(self.log_entries))
        self.patches.content = render_patches(
            self.setup, unpack_valid(update, self.setup)
        )


RADII_MM = (5, 150)
"""Smallest and largest radius of the brush [mm]."""
KINDS = ("skin", "keep out")


@final
class PaintPanel(Panel):
    """Shows the brush and what is painted."""

    def __init__(
        self, gui: GuiApi, brush: PaintBrush, send: Callable[[Order], None]
    ) -> None:
        """Lay out the panel.

        Args:
            gui: interface of the server.
            brush: brush that the panel sets.
            send: function called with the orders of the buttons.
        """
        self.board = WAITING
        self.request = gui.add_html(render_request(self.board))
        low, high = RADII_MM
        radius = gui.add_slider(
            "radius [mm]", min=low, max=high, step=1, initial_value=40
        )
        kind = gui.add_dropdown("paint", options=KINDS, initial_value=KINDS[0])
        obey(radius.on_update, lambda mm: setattr(brush, "radius", 1e-3 * float(mm)))
        obey(kind.on_update, lambda k: setattr(brush, "keeps_out", k == KINDS[1]))
        buttons: tuple[tuple[PageKind, IconName], ...] = (
            ("undo", Icon.ARROW_BACK_UP),
            ("save", Icon.DEVICE_FLOPPY),
            ("close", Icon.CHECK),
        )
        for order, icon in buttons:
            button = gui.add_button(order.capitalize(), icon=icon)
            obey(button.on_click, lambda _, order=order: send(PageOrder(order)))
        self.result = gui.add_html("")

    def update(self, update: ViewUpdate) -> None:
        """Store the board of an update."""
        self.board = update.guide or WAITING

    def render(self, update: ViewUpdate) -> None:
        """Show the board."""
        self.request.content = render_request(self.board)
        self.result.content = render_result(self.board)


def render_request(board: GuideBoard) -> str:
    """Return what to do now as HTML."""
    return render_block(
        '<div style="font-size:15px;font-weight:600;min-height:72px;padding:4px 0 8px">'
        f"{escape(board.request)}</div>"
    )


def render_result(board: GuideBoard) -> str:
    """Return the result as HTML, one line below the other; empty without one."""
    if not board.result:
        return ""
    lines = "".join(f"<div>{escape(line)}</div>" for line in board.result)
    style = f"padding:5px 8px;border-radius:6px;background:{LINE}"
    return render_block(f'<div style="{style}">{lines}</div>')
