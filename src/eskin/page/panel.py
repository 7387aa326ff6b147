"""This module lays out the panels beside the scene, with their controls."""

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, final

import numpy as np
from jaxtyping import Float
from viser import GuiApi, GuiEvent, GuiHtmlHandle, Icon, IconName
from viser.uplot import Axis, Axis_Grid, Series, Series_Points

from eskin.page.hand import MouseHand, PaintBrush, TouchMode
from eskin.page.html import (
    AT_WORK,
    choose_gesture_colours,
    list_gestures,
    render_bars,
    render_block,
    render_correction,
    render_dot,
    render_log,
    render_notice,
    render_patch_map,
    render_patches,
    render_purpose,
    render_request,
    render_result,
    render_scale,
    render_status,
    render_warning,
    to_words,
)
from eskin.page.messages import (
    CorrectionOrder,
    GuideBoard,
    LogEntry,
    Order,
    PageKind,
    PageOrder,
    SceneDescription,
    ViewUpdate,
)
from eskin.page.scene import PagePart
from eskin.skin.colours import ColourScale

Key = Literal[
    "space", "arrowleft", "arrowright", "arrowup", "arrowdown", "I", "O", "Z", "S",
    "delete", "M", "R", "T", "1", "2", "3", "4", "5", "6", "7", "8", "9",
]  # fmt: skip
DIGITS: tuple[Key, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")


LINES = 20
"""Number of lines of the log, of which the latest are visible."""


class Panel(PagePart):
    """A panel shows updates beside the scene, and sends orders.

    Attributes:
        log_entries: latest entries of the log, newest first.
    """

    def __init__(
        self, gui: GuiApi, setup: SceneDescription, send: Callable[[Order], None]
    ) -> None:
        """Start with an empty log, below the warning of the scene if it has one.

        Args:
            gui: interface of the server.
            setup: description of the scene.
            send: function called with the orders of the controls.
        """
        self.gui = gui
        self.setup = setup
        self.send = send
        self.log_entries: deque[LogEntry] = deque(maxlen=LINES)
        if setup.warning:
            gui.add_html(render_warning(setup.warning))

    def update(self, update: ViewUpdate) -> None:
        """Store the log entries of an update."""
        self.log_entries.extendleft(update.log_entries)

    def note(self, seconds: float, text: str) -> None:
        """Add an answer to what was done in the page, at a time [s], to the log.

        The same answer again replaces the one before.
        """
        if self.log_entries and self.log_entries[0].text == text:
            self.log_entries.popleft()
        self.log_entries.appendleft(LogEntry(seconds, "note", text))

    @abstractmethod
    def render(self, update: ViewUpdate) -> None:
        """Show the stored and the latest update, about ten times a second."""


def obey(register: Callable[[Any], object], act: Callable[[Any], object]) -> None:
    """Call a function with the value of a control that a person has changed or clicked.

    Args:
        register: method of the control that registers a handler.
        act: function that is called, in the loop of the server.
    """

    async def handle(event: GuiEvent) -> None:
        # A change made by this program has no client.
        if event.client_id is not None:
            act(event.target.value)

    register(handle)


def add_key(gui: GuiApi, key: Key, title: str, act: Callable[[], None]) -> None:
    """Add a key that calls a function, in a thread."""
    gui.add_command(title, hotkey=key).on_trigger(lambda event: act())


def add_scale(
    gui: GuiApi, scale: ColourScale, legend: GuiHtmlHandle | None = None
) -> None:
    """Add a slider that changes the maximum of the colour scale, below its legend."""
    shown = legend or gui.add_html(render_scale(scale))
    slider = gui.add_slider(
        "scale to [kPa]", min=5, max=200, step=5, initial_value=int(scale.maximum)
    )

    def change(value: float) -> None:
        scale.maximum = float(value)
        shown.content = render_scale(scale)

    obey(slider.on_update, change)


SECONDS = 10.0
"""Duration of the plot [s]."""
PERIOD = 0.1
"""Interval between two points [s]."""
COUNT = round(SECONDS / PERIOD)
FORCE_COLOUR = "#1f2733"
PEAK_COLOUR = "#7b8fb8"
HIGH = 0.93
OUTSIDE = -9.0
"""Heights of visible and hidden marks as shares of the height of the plot.

The plot has no missing values, so hidden marks are drawn outside it.
"""


@final
class HistoryPlot:
    """Plots force and peak pressure ten times a second, and marks detections."""

    def __init__(self, gui: GuiApi, gestures: Sequence[str]) -> None:
        """Start with an empty plot."""
        self.points: deque[tuple[float, ...]] = deque(maxlen=COUNT)
        self.force = self.peak = 0.0
        self.colours = choose_gesture_colours(gestures)
        self.names = tuple(dict.fromkeys([*gestures, "unknown"]))
        self.detected: set[str] = set()
        gui.add_html(
            render_block(
                f"{render_dot(FORCE_COLOUR)}force [N], left &nbsp; "
                f"{render_dot(PEAK_COLOUR)}peak pressure [kPa], right"
            )
        )
        self.plot = gui.add_uplot(
            self.data(),
            (
                Series(label="s"),
                Series(label="force", stroke=FORCE_COLOUR, width=1.5, scale="N"),
                Series(label="peak", stroke=PEAK_COLOUR, width=1, scale="kPa"),
                *(describe_marks(name, self.colours[name]) for name in self.names),
            ),
            scales={
                "x": {"time": False, "range": (-SECONDS, 0.0)},
                "N": {"auto": True},
                "kPa": {"auto": True},
                "mark": {"range": (0.0, 1.0)},
            },
            axes=(
                describe_axis("x", "seconds from now", 2),
                describe_axis("N", "force [N]"),
                describe_axis("kPa", "peak [kPa]", 1),
            ),
            legend={"show": False},
            cursor={"show": False},
            height=150,
            padding=(6, 0, 0, 0),
        )

    def update(self, update: ViewUpdate) -> None:
        """Store the greatest values between two points."""
        self.force = max(self.force, update.force)
        self.peak = max(self.peak, update.peak)
        self.detected |= {entry.gesture for entry in update.log_entries}

    def render(self, update: ViewUpdate) -> None:
        """Advance the plot by one point."""
        marks = (HIGH if name in self.detected else OUTSIDE for name in self.names)
        self.points.append((self.force, self.peak, *marks))
        self.force = 0.0
        self.peak = 0.0
        self.detected = set()
        self.plot.data = self.data()

    def data(self) -> tuple[Float[np.ndarray, "time"], ...]:
        """Return times before now [s], forces [N], peaks [kPa] and detection marks."""
        columns = np.full((3 + len(self.names), COUNT), OUTSIDE)
        columns[0] = np.linspace(-SECONDS + PERIOD, 0.0, COUNT)
        columns[1:3] = 0.0
        if self.points:
            columns[1:, -len(self.points) :] = np.array(self.points).T
        return tuple(columns)


def describe_marks(name: str, colour: str) -> Series:
    """Return the series of the marks of a gesture, in its colour."""
    points = Series_Points(show=True, size=9, fill=colour, stroke=colour)
    return Series(label=to_words(name), width=0, scale="mark", points=points)


def describe_axis(scale: str, title: str, side: Literal[1, 2, 3] = 3) -> Axis:
    """Return an axis with a title: at the bottom (2), to the left (3) or right (1)."""
    return Axis(
        scale=scale,
        side=side,
        label=title,
        size=28 if side == 2 else 30,
        labelSize=14,
        font="10px system-ui",
        labelFont="10px system-ui",
        grid=Axis_Grid(show=side != 1),
    )


NOT_CERTIFIED = "eskin is no certified safety function."
"""Notice that the page always shows."""
MODES: tuple[TouchMode, ...] = ("poke", "double pat", "grab", "stroke")
TASK_ORDERS: dict[str, PageKind] = {"pause": "pause_task", "resume": "resume_task"}
"""Order of each button of the task, by its label."""
HOW_TO_TOUCH = (
    "Press and hold to touch for as long, click twice for a double pat, drag for a "
    "stroke, shift and click for a grab, or choose it here, as on a phone; a drag "
    "beside the skin turns the view"
)
TOUCHED = "the touched one"
"""Choice of the patch that is touched most."""
MAP_PERIOD = 0.2
"""Interval between redraws of the patch [s]."""
KILL_SHARE = 0.1
"""Share of the taxels that one click of `kill` disables."""


@final
class TouchPanel(Panel):
    """Shows touches, their gestures and the skin, with the controls of the mouse."""

    def __init__(
        self, gui: GuiApi, setup: SceneDescription, scale: ColourScale, hand: MouseHand
    ) -> None:
        """Lay out the panel.

        Args:
            gui: interface of the server.
            setup: description of the scene.
            scale: colour scale, whose maximum the panel can change.
            hand: hand that receives mode, force and duration; other orders are sent
                through its `send`.
        """
        super().__init__(gui, setup, hand.send)
        self.scale = scale
        self.hand = hand
        self.colours = choose_gesture_colours(setup.gestures)
        known = [name for name in setup.gestures if name != "unknown"]
        self.names = tuple(list_gestures(known))
        self.seconds = 0.0
        self.last: LogEntry | None = None
        self.running = True
        self.maps_due = 0.0
        self.mapped = 0
        gui.add_html(render_purpose(setup))
        self.status = gui.add_html("")
        if setup.touchable and setup.is_arm:
            task = gui.add_button_group("task", tuple(TASK_ORDERS))
            obey(task.on_click, self.order_task)
        if setup.touchable:
            mode = gui.add_dropdown("a click is a", MODES, hint=HOW_TO_TOUCH)
            obey(mode.on_update, partial(setattr, hand, "mode"))
        self.bars = gui.add_html(render_bars((), setup))
        self.log = gui.add_html(render_log(()))
        tabs = gui.add_tab_group()
        if setup.touchable:
            with tabs.add_tab("Hand", Icon.HAND_FINGER):
                self.add_touch_controls()
        with tabs.add_tab("Last 10 s", Icon.CHART_LINE):
            self.history = HistoryPlot(gui, setup.gestures)
        with tabs.add_tab("Skin", Icon.GRID_DOTS):
            self.shown_patch = gui.add_dropdown("patch", (TOUCHED, *setup.patches))
            self.map = gui.add_html("")
            add_scale(gui, scale)
            self.patches = gui.add_html("")
            if setup.touchable:
                self.add_skin_controls()
        if setup.corrects:
            with tabs.add_tab("Correct", Icon.PENCIL):
                self.add_correction()
        gui.add_html(render_notice(NOT_CERTIFIED))
        if setup.touchable and setup.is_arm:
            add_key(gui, "space", "pause or resume the task", self.pause_or_resume)

    def add_correction(self) -> None:
        """Add the controls and keys that correct the last detection."""
        gui = self.gui
        self.corrected = gui.add_html(render_correction(None, self.names, self.colours))
        name = gui.add_dropdown("that was a", tuple(map(to_words, self.names)))
        other = gui.add_text("or another", "", hint="name of any gesture of your own")
        keep = gui.add_button("keep in the recording", icon=Icon.TAG)
        named = dict(zip(map(to_words, self.names), self.names, strict=True))

        def keep_correction(_: object) -> None:
            words = other.value.strip() or name.value
            self.correct(named.get(words, words))

        obey(keep.on_click, keep_correction)
        for digit, gesture in zip(DIGITS, self.names, strict=False):
            title = f"that was a {to_words(gesture)}"
            add_key(gui, digit, title, partial(self.correct, gesture))

    def correct(self, gesture: str) -> None:
        """Send what the last detected touch was."""
        if self.last is not None:
            self.send(CorrectionOrder(self.last.touch, gesture))

    def add_touch_controls(self) -> None:
        """Add the controls of how firm and slow touches are."""
        for name, attribute in (("force", "firmness"), ("duration", "slowness")):
            times = self.gui.add_slider(
                f"{name}: 1 = usual", min=0.2, max=4.0, step=0.1, initial_value=1.0,
                hint=f"{name} of the next touches; 1 is what people usually do",
            )  # fmt: skip
            obey(times.on_update, partial(setattr, self.hand, attribute))

    def add_skin_controls(self) -> None:
        """Add the controls of cables, dead taxels, skins and recording."""
        gui = self.gui
        setup = self.setup
        patch = gui.add_dropdown("cable of", setup.patches)
        cable: dict[str, PageKind] = {"unplug": "unplug", "plug in": "plug"}
        self.add_orders("is to", cable, lambda kind: patch.value)
        kill = f"kill {KILL_SHARE:.0%}"
        taxels: dict[str, PageKind] = {kill: "kill", "restore": "restore"}
        self.add_orders("taxels", taxels, {"kill": KILL_SHARE}.get)
        self.add_orders("recording", {"record": "record", "stop": "stop_recording"})
        if len(setup.skins) > 1:
            skin = gui.add_dropdown("skin", setup.skins)
            obey(skin.on_update, lambda name: self.send(PageOrder("skin", name)))

    def add_orders(
        self,
        name: str,
        kinds: dict[str, PageKind],
        find_value: Callable[[PageKind], str | float | None] = lambda kind: None,
    ) -> None:
        """Add a group of buttons that send orders.

        Args:
            name: name of the group.
            kinds: kind of the order of each button, by its label.
            find_value: function that returns the value of an order by its kind.
        """
        group = self.gui.add_button_group(name, tuple(kinds))
        obey(
            group.on_click,
            lambda label: self.send(PageOrder(kinds[label], find_value(kinds[label]))),
        )

    def pause_or_resume(self) -> None:
        """Pause the task of the arm while it runs, else resume it."""
        self.order_task("pause" if self.running else "resume")

    def order_task(self, label: str) -> None:
        """Send the order of a button of the task, and log that it was pressed."""
        self.note(self.seconds, f"you pressed {label}")
        self.send(PageOrder(TASK_ORDERS[label]))

    def update(self, update: ViewUpdate) -> None:
        """Store the values and log entries of an update."""
        super().update(update)
        self.history.update(update)
        self.seconds = update.seconds
        found = [entry for entry in update.log_entries if entry.kind == "detection"]
        self.last = found[-1] if found else self.last
        self.running = update.arm is None or update.arm.state in AT_WORK

    def render(self, update: ViewUpdate) -> None:
        """Show the touches, the log, the plot and the skin."""
        self.history.render(update)
        self.status.content = render_status(update)
        self.bars.content = render_bars(update.touches, self.setup)
        self.log.content = render_log(self.log_entries, self.colours)
        self.patches.content = render_patches(self.setup, update.valid)
        if self.setup.corrects:
            self.corrected.content = render_correction(
                self.last, self.names, self.colours
            )
        if not 0.0 <= self.maps_due - update.seconds <= MAP_PERIOD:
            self.maps_due = update.seconds + MAP_PERIOD
            self.draw_map(update)

    def draw_map(self, update: ViewUpdate) -> None:
        """Draw the chosen patch, or the one that is touched most."""
        setup = self.setup
        chosen = self.shown_patch.value
        names = [chosen, *(contact.patch for contact in update.contacts)]
        patch = next((name for name in names if name in setup.patches), None)
        if patch is None and self.map.content:
            # The patch that was touched last stays, with its pressures now.
            patch = setup.patches[self.mapped]
        self.mapped = setup.patches.index(patch) if patch else 0
        self.map.content = render_patch_map(
            setup, self.mapped, update.pressure, update.valid, self.scale
        )


WAITING = GuideBoard("waiting for the skin", 0.0)
"""Text that is shown before the first scan."""


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
        super().__init__(gui, setup, send)
        self.board = WAITING
        self.request = gui.add_html(render_request(self.board))
        self.progress = gui.add_progress_bar(0.0)
        buttons = (
            ("Skip this", Icon.PLAYER_SKIP_FORWARD),
            ("Repeat the last press", Icon.ARROW_BACK_UP),
            ("Close", Icon.CHECK),
        )
        self.skip, self.again, self.close = (
            gui.add_button(name, visible=False, icon=icon) for name, icon in buttons
        )
        self.result = gui.add_html("")
        self.log = gui.add_html(render_log(()))
        legend = gui.add_html(render_scale(scale))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Skin", Icon.GRID_DOTS):
            self.patches = gui.add_html("")
        with tabs.add_tab("View", Icon.PALETTE):
            add_scale(gui, scale, legend)
        obey(self.skip.on_click, lambda _: self.order_skip())
        obey(
            self.again.on_click,
            lambda _: send(PageOrder("again", float(self.board.presses))),
        )
        obey(self.close.on_click, lambda _: send(PageOrder("close")))

    def order_skip(self) -> None:
        """Ask to leave out the patch or point that is shown."""
        if self.board.place is not None:
            self.send(PageOrder("skip", self.board.place.name))

    def render(self, update: ViewUpdate) -> None:
        """Show the guide, the log and the patches."""
        board = self.board = update.guide or WAITING
        self.request.content = render_request(board)
        self.progress.value = round(100.0 * board.share, 1)
        self.skip.visible = board.place is not None
        if board.place is not None:
            self.skip.label = f"Skip {to_words(board.place.name)}"
        self.again.visible = board.presses > 0
        self.close.visible = bool(board.result)
        self.result.content = render_result(board)
        self.log.content = render_log(self.log_entries)
        self.patches.content = render_patches(self.setup, update.valid)


RADII_MM = (5, 150)
"""Smallest and largest radius of the brush [mm]."""
KINDS = ("skin", "keep out", "matrix")


MATRIX = (("rows", 16, 1), ("columns", 16, 1), ("pitch [mm]", 6.0, 0.1))
"""Controls of a matrix, with their first values and steps."""


@final
class PaintPanel(Panel):
    """Shows the brush and the painted regions."""

    def __init__(self, gui: GuiApi, setup: SceneDescription, brush: PaintBrush) -> None:
        """Lay out the panel, which sets a brush and sends orders as it does."""
        super().__init__(gui, setup, brush.send)
        self.request = gui.add_html(render_request(WAITING))
        low, high = RADII_MM
        radius = gui.add_slider(
            "radius [mm]", min=low, max=high, step=1, initial_value=40
        )
        kind = gui.add_dropdown("paint", options=KINDS, initial_value=KINDS[0])
        obey(radius.on_update, lambda mm: setattr(brush, "radius", 1e-3 * float(mm)))
        sizes = rows, columns, pitch = tuple(
            gui.add_number(name, value, min=1, max=200, step=step, visible=False)
            for name, value, step in MATRIX
        )

        def choose(_: object) -> None:
            brush.keeps_out = kind.value == KINDS[1]
            matrix = int(rows.value), int(columns.value), 1e-3 * float(pitch.value)
            is_matrix = kind.value == KINDS[2]
            brush.matrix = matrix if is_matrix else None
            radius.visible = not is_matrix
            for control in sizes:
                control.visible = is_matrix

        for control in (kind, *sizes):
            obey(control.on_update, choose)
        buttons: tuple[tuple[PageKind, IconName], ...] = (
            ("undo", Icon.ARROW_BACK_UP),
            ("save", Icon.DEVICE_FLOPPY),
            ("close", Icon.CHECK),
        )
        for order, icon in buttons:
            button = gui.add_button(order.capitalize(), icon=icon)
            obey(button.on_click, lambda _, order=order: brush.send(PageOrder(order)))
        self.result = gui.add_html("")

    def render(self, update: ViewUpdate) -> None:
        """Show the board."""
        board = update.guide or WAITING
        self.request.content = render_request(board)
        self.result.content = render_result(board)
