"""This module shows a recording in the browser, on a timeline for labelling."""

from collections.abc import Callable
from html import escape
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Float
from viser import GuiApi, GuiEvent, Icon, ViserServer

from eskin.errors import RecordingError
from eskin.page import ColourScale, ViewUpdate, html
from eskin.page.page import BRAND, CAMERA_DISTANCE, CAMERA_TARGET, SCALE, WIDTH
from eskin.page.scene import Scene
from eskin.recording import NONE, Label
from eskin.skin import MountedSkin
from eskin.viewer.appearance import describe_scene
from eskin.viewer.editing import (
    LabelEditor,
    LoadedRecording,
    Pair,
    compute_envelope,
    match_detections,
)
from eskin.viewer.viewer import pack_poses


@final
class PlaybackClock:
    """Holds a position on a timeline that advances during playback.

    Attributes:
        length: length of the recording [s].
        seconds: position since the first reading [s].
        speed: speed of playback as a multiple of real time.
        is_on: whether the recording is played.
    """

    def __init__(self, length: float) -> None:
        """Start at the beginning of a recording of a length [s]."""
        self.length = length
        self.seconds = 0.0
        self.speed = 1.0
        self.is_on = False

    def seek(self, seconds: float) -> None:
        """Move to a time [s], within the recording."""
        self.seconds = min(max(seconds, 0.0), self.length)

    def toggle(self) -> None:
        """Play or pause; at the end, play from the beginning."""
        if not self.is_on and self.seconds >= self.length:
            self.seconds = 0.0
        self.is_on = not self.is_on

    def advance(self, elapsed: float) -> bool:
        """Advance by a time [s] and return whether the position has changed."""
        if not self.is_on:
            return False
        self.seek(self.seconds + elapsed * self.speed)
        self.is_on = self.seconds < self.length
        return True


BINS = 500
"""Greatest number of points of the plot."""
OUTSIDE = -9.0
"""Height of hidden marks, outside the plot, which has no missing values."""


@final
class Overview:
    """Draws the recording again when the labels or the position change."""

    def __init__(
        self, gui: GuiApi, loaded: LoadedRecording, editor: LabelEditor
    ) -> None:
        """Draw the recording with the position at its beginning."""
        self.editor = editor
        self.peak = compute_envelope(loaded.peak, BINS)
        self.length = float(loaded.seconds[-1])
        self.times = np.linspace(0.0, self.length, len(self.peak))
        self.plot = gui.add_uplot(
            self.data(0.0),
            (
                {"label": "s"},
                {
                    "label": "labels",
                    "scale": "mark",
                    "width": 0,
                    "fill": "rgba(31,158,137,0.28)",
                },
                {
                    "label": "peak [kPa]",
                    "scale": "kPa",
                    "stroke": "#3b4f7a",
                    "width": 1,
                },
                {
                    "label": "detection",
                    "scale": "mark",
                    "width": 0,
                    "points": {"show": True, "size": 7, "fill": "#d55e00"},
                },
                {"label": "here", "scale": "mark", "stroke": "#d55e00", "width": 1},
            ),
            scales={
                "x": {"time": False, "range": (0.0, self.length)},
                "kPa": {"auto": True},
                "mark": {"range": (0.0, 1.0)},
            },
            axes=(
                {"scale": "x", "size": 24, "font": "10px system-ui"},
                {"scale": "kPa", "size": 34, "font": "10px system-ui"},
            ),
            legend={"show": False},
            cursor={"show": False},
            height=150,
            padding=(6, 6, 0, 0),
        )

    def draw(self, seconds: float) -> None:
        """Draw the current labels and detections, and the position [s]."""
        self.plot.data = self.data(seconds)

    def data(self, seconds: float) -> tuple[Float[np.ndarray, "bin"], ...]:
        """Return times [s], labels, peaks [kPa], detections and the position."""
        editor, times = self.editor, self.times
        labelled, detected, here = np.full((3, len(times)), OUTSIDE)
        for label in editor.labels:
            start, end = editor.seconds(label.start), editor.seconds(label.end)
            labelled[(times >= start) & (times < end)] = 0.94
        for found in editor.recording.detections:
            detected[self.find_bin(editor.seconds(found.stamp))] = 0.9
        here[self.find_bin(seconds)] = 1.0
        return times, labelled, self.peak, detected, here

    def find_bin(self, seconds: float) -> int:
        """Return the index of a time [s] in the plot."""
        share = seconds / self.length if self.length else 0.0
        return int(
            np.clip(round(share * (len(self.times) - 1)), 0, len(self.times) - 1)
        )


GESTURES = ("poke", "double_pat", "grab", "stroke")
NEW = "new label"
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
STEP = 0.01
"""Step of the slider [s]."""


@final
class Timeline:
    """Shows the scene and the panel of a recording; `tick` advances it.

    Attributes:
        clock: clock of the playback.
        editor: editor of the labels.
    """

    def __init__(
        self,
        server: ViserServer,
        mounted: MountedSkin,
        loaded: LoadedRecording,
        editor: LabelEditor,
    ) -> None:
        """Show the first reading."""
        self.server, self.mounted, self.loaded = server, mounted, loaded
        self.editor = editor
        self.lock = RLock()
        self.clock = PlaybackClock(float(loaded.seconds[-1]))
        self.shown = -1
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        gui.set_panel_label(editor.recording.path.name)
        self.scale = ColourScale(SCALE)
        self.scene = Scene(server, describe_scene(mounted, GESTURES), self.scale)
        self.scene.set_camera(CAMERA_TARGET, CAMERA_DISTANCE)
        self.status = gui.add_html("")
        self.overview = Overview(gui, loaded, editor)
        self.legend = gui.add_html(html.render_block(self.scale.legend()))
        self.add_transport()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Label", Icon.TAG):
            self.add_label()
        with tabs.add_tab("Compare", Icon.LIST_CHECK):
            self.table = gui.add_html("")
        self.note = gui.add_html("")
        self.list_labels()

    def add_transport(self) -> None:
        """Add the controls of the playback: time, speed, previous and next label."""
        gui, clock = self.server.gui, self.clock
        self.slider = gui.add_slider(
            "time [s]",
            min=0.0,
            max=max(clock.length, STEP),
            step=STEP,
            initial_value=0.0,
        )
        keys = gui.add_button_group("go", ("play/pause", "previous", "next"))
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")

        @self.slider.on_update
        async def _(event: GuiEvent) -> None:
            # A change made by `tick` has no client.
            if event.client_id is not None:
                with self.lock:
                    clock.seek(float(event.target.value))

        @keys.on_click
        async def _(event: GuiEvent) -> None:
            with self.lock:
                if event.target.value == "play/pause":
                    clock.toggle()
                else:
                    self.select_neighbour(1 if event.target.value == "next" else -1)

        @speed.on_update
        async def _(event: GuiEvent) -> None:
            clock.speed = float(event.target.value)

    def add_label(self) -> None:
        """Add the controls that select, add, change, remove and save labels."""
        gui = self.server.gui
        names: list[str] = [NEW]
        self.pick = gui.add_dropdown("label", names)
        self.gesture = gui.add_dropdown("gesture", self.gestures())
        self.start = gui.add_number("start [s]", 0.0, step=STEP)
        self.end = gui.add_number("end [s]", 0.0, step=STEP)
        here = gui.add_button_group("from here", ("start", "end"))
        change = gui.add_button_group("label it", ("set", "remove"))
        save = gui.add_button("save", icon=Icon.DEVICE_FLOPPY)

        @self.pick.on_update
        async def _(event: GuiEvent) -> None:
            if event.client_id is not None:
                with self.lock:
                    self.show_label(self.selected())

        @here.on_click
        async def _(event: GuiEvent) -> None:
            field = self.start if event.target.value == "start" else self.end
            field.value = round(self.clock.seconds, 3)

        @change.on_click
        async def _(event: GuiEvent) -> None:
            is_set = event.target.value == "set"
            self.attempt(self.set_label if is_set else self.remove_label)

        @save.on_click
        def _(event: GuiEvent) -> None:
            self.attempt(self.save)

    def gestures(self) -> tuple[str, ...]:
        """Return the gestures of the recording, then the common ones."""
        known = [label.gesture for label in self.editor.labels]
        return tuple(dict.fromkeys([*known, *GESTURES, NONE]))

    def format_label(self, label: Label) -> str:
        """Return the name of a label in the list of labels."""
        start, end = (self.editor.seconds(x) for x in (label.start, label.end))
        return f"{start:.2f} to {end:.2f} s: {label.gesture}"

    def selected(self) -> Label | None:
        """Return the selected label; None for a new one."""
        found = {self.format_label(label): label for label in self.editor.labels}
        return found.get(self.pick.value)

    def show_label(self, label: Label | None) -> None:
        """Show a label in the fields and move to its start."""
        if label is not None:
            self.gesture.value = label.gesture
            self.start.value = round(self.editor.seconds(label.start), 3)
            self.end.value = round(self.editor.seconds(label.end), 3)
            self.clock.seek(self.editor.seconds(label.start))

    def select_neighbour(self, step: int) -> None:
        """Select the label before or after the current position."""
        now = self.editor.stamp(self.clock.seconds)
        labels = self.editor.labels
        after = [label for label in labels if label.start > now]
        before = [label for label in labels if label.start < now]
        beside = after[:1] if step > 0 else before[-1:]
        for label in beside:
            self.pick.value = self.format_label(label)
            self.show_label(label)

    def set_label(self) -> str:
        """Change the selected label or add a new one, and return a message."""
        fields = self.gesture.value, float(self.start.value), float(self.end.value)
        old = self.selected()
        label = (
            self.editor.add(*fields)
            if old is None
            else self.editor.change(old, *fields)
        )
        self.list_labels(label)
        return f"{self.format_label(label)}; not saved yet"

    def remove_label(self) -> str:
        """Remove the selected label and return a message."""
        label = self.selected()
        if label is None:
            return "no label is selected"
        self.editor.remove(label)
        self.list_labels()
        return f"removed {self.format_label(label)}; not saved yet"

    def save(self) -> str:
        """Write the recording and return a message."""
        kept = self.editor.save()
        return f"saved; the recording as it was is {kept.name}"

    def attempt(self, action: Callable[[], str]) -> None:
        """Perform an action and show its message, or its error."""
        with self.lock:
            try:
                text = action()
            except (RecordingError, OSError) as error:
                text = str(error)
            self.note.content = html.render_block(escape(text))

    def list_labels(self, chosen: Label | None = None) -> None:
        """Show the current labels in the list, the plot and the comparison."""
        names = [self.format_label(label) for label in self.editor.labels]
        self.pick.options = (NEW, *names)
        self.pick.value = NEW if chosen is None else self.format_label(chosen)
        self.overview.draw(self.clock.seconds)
        pairs = match_detections(self.editor.labels, self.editor.recording.detections)
        self.table.content = self.render_table(pairs)

    def render_table(self, pairs: tuple[Pair, ...]) -> str:
        """Return labels beside detections as HTML."""
        right = sum(pair.is_right for pair in pairs)
        rows = [
            (
                self.editor.seconds(pair.label.start)
                if pair.label
                else self.editor.seconds(pair.detection.onset)
                if pair.detection
                else 0.0,
                pair.label.gesture if pair.label else "-",
                f"{pair.detection.gesture} {pair.detection.confidence:.0%}"
                if pair.detection
                else "-",
                pair.is_right,
            )
            for pair in pairs
        ]
        return html.render_comparison(rows, right)

    def tick(self, elapsed: float) -> None:
        """Advance by a time [s] and show the reading at the new position."""
        with self.lock, self.server.atomic():
            if self.clock.advance(elapsed):
                self.slider.value = round(self.clock.seconds, 2)
            row = self.loaded.at(self.clock.seconds)
            if row != self.shown:
                self.shown = row
                self.scene.show(self.build_update(row))
                self.status.content = self.render_status(row)
                self.overview.draw(self.clock.seconds)

    def render_status(self, row: int) -> str:
        """Return time, force, peak and label of a reading as HTML."""
        now = self.editor.recording.start + round(self.loaded.seconds[row] * 1e9)
        here = [x.gesture for x in self.editor.labels if x.start <= now < x.end]
        return html.render_numbers(
            ("time", f"{self.loaded.seconds[row]:.2f} s"),
            ("force", f"{self.loaded.force[row]:.1f} N"),
            ("peak", f"{self.loaded.peak[row]:.0f} kPa"),
            ("label", html.to_words(here[-1]) if here else "-"),
        )

    def build_update(self, row: int) -> ViewUpdate:
        """Return the update for one reading."""
        loaded = self.loaded
        return ViewUpdate(
            seconds=float(loaded.seconds[row]),
            poses=pack_poses(self.mounted.kinematics.poses(loaded.q[row])),
            pressure=loaded.pressure[row],
            valid=np.packbits(loaded.valid[row]),
            contacts=(),
            touches=(),
            force=float(loaded.force[row]),
            peak=float(loaded.peak[row]),
            log_entries=(),
            rate=0.0,
            step=0.0,
            age=0.0,
        )
