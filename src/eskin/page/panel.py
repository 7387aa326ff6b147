"""This module lays out the panel beside the scene, with its texts and plot."""

from collections import deque
from collections.abc import Sequence
from html import escape
from typing import cast, final

import numpy as np
from jaxtyping import Bool, Float
from viser import GuiApi, GuiEvent, GuiHtmlHandle, Icon

from eskin.page.colours import ColourScale
from eskin.page.hand import MouseHand, TouchMode
from eskin.page.messages import (
    ArmSummary,
    LogEntry,
    OpenTouch,
    PageKind,
    PageOrder,
    SceneDescription,
    ViewUpdate,
)

INK, PALE, LINE = "#1f2733", "#7b8594", "#e6e9ee"
TEAL, AMBER, RED, BLUE = "#1f9e89", "#c77700", "#c43a31", "#3b6fb6"
STATE_COLOURS = {
    "running": TEAL,
    "paused": AMBER,
    "held": RED,
    "stopped": RED,
    "waiting": PALE,
}
"""Colour of each state of the arm."""
KIND_COLOURS = {"detection": TEAL, "command": BLUE, "refused": AMBER, "event": PALE}
FONT = f"font:12px/1.45 system-ui,sans-serif;color:{INK};padding:0 14px"


def render_block(inside: str) -> str:
    """Return a part of the panel as HTML in the font of the panel."""
    return f'<div style="{FONT}">{inside}</div>'


def render_status(update: ViewUpdate) -> str:
    """Return rate, latency, faults and the state of the arm as HTML."""
    faults = f"{update.faults} fault{'s' * (update.faults != 1)}"
    colour = RED if update.faults else TEAL
    return render_numbers(
        ("readings/s", f"{update.rate:.0f}"),
        ("step", f"{1e3 * update.step:.2f} ms"),
        ("age", f"{1e3 * update.age:.1f} ms"),
        ("skin", f'<span style="color:{colour}">{faults}</span>'),
    ) + (render_block(render_arm(update.arm)) if update.arm else "")


def render_notice(text: str) -> str:
    """Return a notice in small print as HTML."""
    return render_block(f'<div style="color:{PALE}">{escape(text)}</div>')


def render_warning(text: str) -> str:
    """Return a warning as HTML."""
    return render_block(
        f'<div style="margin-bottom:6px;padding:5px 8px;border-radius:6px;color:#fff;'
        f'background:{RED}">{escape(text)}</div>'
    )


def render_numbers(*pairs: tuple[str, str]) -> str:
    """Return names with their values side by side as HTML."""
    cells = "".join(
        f'<div><div style="color:{PALE};font-size:10px">{name}</div>'
        f'<div style="font-weight:600;font-variant-numeric:tabular-nums">{value}</div>'
        "</div>"
        for name, value in pairs
    )
    return render_block(
        f'<div style="display:flex;justify-content:space-between">{cells}</div>'
    )


def render_comparison(rows: Sequence[tuple[float, str, str, bool]], right: int) -> str:
    """Return a table of labels and detections as HTML.

    Args:
        rows: time [s], label, detection, and whether they agree.
        right: number of rows that agree.
    """
    head = f'<div style="color:{PALE}">{right} of {len(rows)} match</div>'
    body = "".join(
        f'<div style="display:flex;gap:8px;border-bottom:1px solid {LINE}">'
        f'<span style="color:{PALE};width:52px;text-align:right">{seconds:.1f} s</span>'
        f'<span style="flex:1">{escape(to_words(label))}</span>'
        f'<span style="flex:1;color:{TEAL if is_right else RED}">'
        f"{escape(to_words(detection))}</span></div>"
        for seconds, label, detection, is_right in rows
    )
    return render_block(head + body)


def render_arm(summary: ArmSummary) -> str:
    """Return the state of the arm as HTML."""
    state = summary.state + (f": {summary.why}" if summary.why else "")
    colour = STATE_COLOURS[summary.state]
    target = summary.target or "-"
    rest = f"{summary.speed:.0%} speed, gripper {summary.gripper}, to {target}"
    return (
        f'<div style="margin-top:6px;padding:5px 8px;border-radius:6px;'
        f'background:{LINE}"><b style="color:{colour}">{escape(state)}</b>'
        f'<br><span style="color:{PALE}">{escape(rest)}</span></div>'
    )


def render_bars(touches: Sequence[OpenTouch], gestures: Sequence[str]) -> str:
    """Return the probabilities of the strongest touch as HTML bars."""
    first = touches[0] if touches else None
    head = "no touch"
    if first is not None:
        head = f"touch {first.id} on {escape(first.link)}, {first.force:.1f} N"
    probabilities = np.zeros(len(gestures)) if first is None else first.probabilities
    best = int(np.argmax(probabilities)) if first is not None else -1
    rows = "".join(
        render_bar(gesture, float(probability), number == best)
        for number, (gesture, probability) in enumerate(
            zip(gestures, probabilities, strict=True)
        )
    )
    head = f'<div style="color:{PALE};margin:4px 0 3px">{head}</div>'
    return render_block(head + rows)


def render_bar(gesture: str, probability: float, is_best: bool) -> str:
    """Return one probability as an HTML bar."""
    colour = TEAL if is_best else "#b9c2cd"
    weight = 600 if is_best else 400
    return (
        '<div style="display:flex;align-items:center;gap:8px;height:18px">'
        f'<span style="width:72px;font-weight:{weight}">'
        f"{escape(to_words(gesture))}</span>"
        f'<span style="flex:1;height:9px;border-radius:5px;background:{LINE}">'
        '<span style="display:block;height:9px;border-radius:5px;'
        f'width:{probability:.0%};background:{colour}"></span></span>'
        f'<span style="width:36px;text-align:right;color:{PALE};'
        f'font-variant-numeric:tabular-nums">{probability:.0%}</span></div>'
    )


def render_log(log_entries: Sequence[LogEntry]) -> str:
    """Return detections, commands and events as HTML, newest first."""
    rows = "".join(
        f'<div style="display:flex;gap:8px;border-bottom:1px solid {LINE};'
        'padding:1px 0">'
        f'<span style="color:{PALE};width:46px;flex:none;text-align:right;'
        f'font-variant-numeric:tabular-nums">{entry.seconds:.1f} s</span>'
        f'<span style="color:{KIND_COLOURS[entry.kind]}">'
        f"{escape(entry.text)}</span></div>"
        for entry in log_entries
    )
    return render_block(rows or f'<span style="color:{PALE}">nothing yet</span>')


def unpack_valid(
    update: ViewUpdate, setup: SceneDescription
) -> Bool[np.ndarray, "taxel"]:
    """Return whether each taxel of an update is valid."""
    return np.unpackbits(update.valid, count=setup.patch_index.size).astype(bool)


def render_patches(setup: SceneDescription, valid: Bool[np.ndarray, "taxel"]) -> str:
    """Return how many taxels of each patch are not valid, as HTML."""
    sizes = np.bincount(setup.patch_index, minlength=len(setup.patches))
    good = np.bincount(setup.patch_index, valid, minlength=len(setup.patches))
    cells = "".join(
        render_patch_state(name, int(size - whole), int(size))
        for name, whole, size in zip(setup.patches, good, sizes, strict=True)
    )
    style = "display:flex;flex-wrap:wrap;gap:4px"
    return render_block(f'<div style="{style}">{cells}</div>')


def render_patch_state(patch: str, out: int, size: int) -> str:
    """Return the state of one patch as HTML."""
    colour, note = TEAL, ""
    if out:
        colour, note = (RED, " silent") if out == size else (AMBER, f" {out} out")
    return (
        f'<span style="border:1px solid {LINE};border-radius:9px;padding:0 7px;'
        f'font-size:11px"><span style="color:{colour}">&#9679;</span> '
        f"{escape(to_words(patch))}{note}</span>"
    )


def to_words(name: str) -> str:
    """Return a name with spaces in place of underscores."""
    return name.replace("_", " ")


SECONDS = 10.0
"""Duration of the plot [s]."""
PERIOD = 0.1
"""Interval between two points [s]."""
COUNT = round(SECONDS / PERIOD)
HIGH, OUTSIDE = 0.93, -9.0
"""Heights of visible and hidden marks as shares of the height of the plot.

The plot has no missing values, so hidden marks are drawn outside it.
"""


@final
class HistoryPlot:
    """Plots force and peak pressure ten times a second, and marks detections."""

    def __init__(self, gui: GuiApi) -> None:
        """Start with an empty plot."""
        self.points: deque[tuple[float, float, float]] = deque(maxlen=COUNT)
        self.force = self.peak = 0.0
        self.detected = False
        self.plot = gui.add_uplot(
            self.data(),
            (
                {"label": "s"},
                {"label": "force [N]", "stroke": "#1f9e89", "width": 1.5, "scale": "N"},
                {
                    "label": "peak [kPa]",
                    "stroke": "#7b8fb8",
                    "width": 1,
                    "scale": "kPa",
                },
                {
                    "label": "detection",
                    "stroke": "#d55e00",
                    "width": 0,
                    "scale": "detection",
                    "points": {"show": True, "size": 9, "fill": "#d55e00"},
                },
            ),
            scales={
                "x": {"time": False, "range": (-SECONDS, 0.0)},
                "N": {"auto": True},
                "kPa": {"auto": True},
                "detection": {"range": (0.0, 1.0)},
            },
            axes=(
                {"scale": "x", "size": 24, "font": "10px system-ui"},
                {"scale": "N", "size": 34, "font": "10px system-ui"},
                {
                    "scale": "kPa",
                    "side": 1,
                    "size": 34,
                    "font": "10px system-ui",
                    "grid": {"show": False},
                },
            ),
            legend={"show": False},
            cursor={"show": False},
            height=120,
            padding=(6, 0, 0, 0),
        )

    def take(self, update: ViewUpdate) -> None:
        """Store the greatest values between two points."""
        self.force = max(self.force, update.force)
        self.peak = max(self.peak, update.peak)
        self.detected |= any(entry.kind == "detection" for entry in update.log_entries)

    def draw(self) -> None:
        """Advance the plot by one point."""
        mark = HIGH if self.detected else OUTSIDE
        self.points.append((self.force, self.peak, mark))
        self.force, self.peak, self.detected = 0.0, 0.0, False
        self.plot.data = self.data()

    def data(self) -> tuple[Float[np.ndarray, "time"], ...]:
        """Return times before now [s], forces [N], peaks [kPa] and detection marks."""
        columns = np.zeros((4, COUNT))
        columns[3] = OUTSIDE
        columns[0] = np.linspace(-SECONDS + PERIOD, 0.0, COUNT)
        if self.points:
            columns[1:, -len(self.points) :] = np.array(self.points).T
        return tuple(columns)


NOT_CERTIFIED = "eskin is no certified safety function."
"""Notice that the page always shows."""
LINES = 8
"""Number of lines of the log."""
MODES: tuple[TouchMode, ...] = ("poke", "double-pat", "grab", "stroke")
KILL_SHARE = 0.1
"""Share of the taxels that one click of `kill` disables."""


@final
class Panel:
    """Draws the panel beside the scene ten times a second."""

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
        self.gui = gui
        self.setup = setup
        self.scale = scale
        self.hand = hand
        self.log_entries: deque[LogEntry] = deque(maxlen=LINES)
        if setup.warning:
            gui.add_html(render_warning(setup.warning))
        self.status = gui.add_html("")
        self.bars = gui.add_html(render_bars((), setup.gestures))
        self.history = HistoryPlot(gui)
        self.legend = gui.add_html(render_block(scale.legend()))
        if setup.commands:
            gui.add_html(render_notice("; ".join(setup.commands)))
        gui.add_html(render_notice(NOT_CERTIFIED))
        tabs = gui.add_tab_group()
        if setup.touchable:
            with tabs.add_tab("Hand", Icon.HAND_FINGER):
                self.add_touch_controls()
        with tabs.add_tab("Skin", Icon.GRID_DOTS):
            self.patches = gui.add_html("")
            if setup.touchable:
                self.add_skin_controls()
        with tabs.add_tab("View", Icon.PALETTE):
            add_scale(gui, scale, self.legend)
        self.log = gui.add_html(render_log(()))

    def add_touch_controls(self) -> None:
        """Add the controls of touches: mode, force and duration."""
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
            self.add_task_controls()

        @mode.on_update
        async def _(event: GuiEvent) -> None:
            hand.mode = cast(TouchMode, event.target.value)

        @force.on_update
        async def _(event: GuiEvent) -> None:
            hand.force = float(event.target.value)

        @seconds.on_update
        async def _(event: GuiEvent) -> None:
            hand.seconds = float(event.target.value)

    def add_task_controls(self) -> None:
        """Add the buttons that pause and resume the task of the arm."""
        task = self.gui.add_button_group("task", ("pause", "resume"))

        @task.on_click
        async def _(event: GuiEvent) -> None:
            is_pause = event.target.value == "pause"
            self.order("pause_task" if is_pause else "resume_task")

    def add_skin_controls(self) -> None:
        """Add the controls of cables, dead taxels, skins and recording."""
        gui, setup = self.gui, self.setup
        patch = gui.add_dropdown("patch", setup.patches)
        cable = gui.add_button_group("its cable", ("unplug", "plug in"))
        taxels = gui.add_button_group("taxels", (f"kill {KILL_SHARE:.0%}", "restore"))
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
                self.order("kill", KILL_SHARE)

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
        """Send an order other than a touch."""
        self.hand.send(PageOrder(kind, value))

    def take(self, update: ViewUpdate) -> None:
        """Store the values and log entries of an update."""
        self.history.take(update)
        self.log_entries.extendleft(update.log_entries)

    def draw(self, update: ViewUpdate) -> None:
        """Draw an update."""
        self.history.draw()
        self.status.content = render_status(update)
        self.bars.content = render_bars(update.touches, self.setup.gestures)
        self.log.content = render_log(tuple(self.log_entries))
        valid = unpack_valid(update, self.setup)
        self.patches.content = render_patches(self.setup, valid)


def add_scale(gui: GuiApi, scale: ColourScale, legend: GuiHtmlHandle) -> None:
    """Add a slider that changes the maximum of the colour scale."""
    slider = gui.add_slider(
        "scale to [kPa]", min=5, max=200, step=5, initial_value=int(scale.maximum)
    )

    @slider.on_update
    async def _(event: GuiEvent) -> None:
        scale.maximum = float(event.target.value)
        legend.content = render_block(scale.legend())
