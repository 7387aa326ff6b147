"""This module shows a recording in the browser, on a timeline for labelling."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from threading import RLock
from typing import Literal, final

import numpy as np
from jaxtyping import Float
from viser import GuiApi, Icon, ViserServer
from viser.uplot import Series

from eskin.errors import RecordingError
from eskin.labelling.editing import (
    LabelEditor,
    LoadedRecording,
    compute_envelope,
    match_detections,
)
from eskin.page import html
from eskin.page.appearance import describe_scene
from eskin.page.panel import (
    DIGITS,
    OUTSIDE,
    Key,
    add_key,
    add_scale,
    describe_axis,
    describe_marks,
    obey,
)
from eskin.page.scene import WIDER, lay_out
from eskin.page.viewer import build_still
from eskin.recording import NONE, DetectionRecord, Label
from eskin.skin import MountedSkin


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


PURPOSE = (
    "This page plays a recording: drag the two ends of “range” over a touch, and label "
    "it with its gesture."
)
"""What the page says of itself, and of what to do first."""
BINS = 500
"""Greatest number of points of the plot."""
PEAK_COLOUR = "#3b4f7a"
RANGE_COLOUR = "rgba(31,39,51,0.14)"
HERE_COLOUR = "#1f2733"


@final
class Overview:
    """Draws the recording again when the labels, the range or the position change."""

    def __init__(
        self,
        gui: GuiApi,
        loaded: LoadedRecording,
        editor: LabelEditor,
        detections: Sequence[DetectionRecord],
    ) -> None:
        """Draw the recording with the position at its beginning."""
        self.editor = editor
        self.detections = detections
        self.peak = compute_envelope(loaded.peak, BINS)
        self.length = float(loaded.seconds[-1])
        self.times = np.linspace(0.0, self.length, len(self.peak))
        self.names: tuple[str, ...] = ()
        self.plot = gui.add_uplot(
            self.data(0.0, (0.0, 0.0)),
            self.describe_series(),
            scales={
                "x": {"time": False, "range": (0.0, self.length)},
                "kPa": {"auto": True},
                "mark": {"range": (0.0, 1.0)},
            },
            axes=(
                describe_axis("x", "time [s]", 2),
                describe_axis("kPa", "peak [kPa]"),
            ),
            legend={"show": False},
            cursor={"show": False},
            height=170,
            padding=(6, 6, 0, 0),
        )

    def draw(
        self, seconds: float, span: tuple[float, float], names: tuple[str, ...]
    ) -> None:
        """Draw labels and detections of some gestures, the range and the position.

        Args:
            seconds: the position [s].
            span: start and end of the range [s].
            names: names of all gestures.
        """
        if names != self.names:
            self.names = names
            self.plot.series = self.describe_series()
        self.plot.data = self.data(seconds, span)

    def describe_series(self) -> tuple[Series, ...]:
        """Return the series: each gesture has one for labels and one for detections."""
        colours = html.choose_gesture_colours(self.names)
        labels = (
            Series(label=name, scale="mark", width=0, fill=colours[name] + "59")
            for name in self.names
        )
        found = (describe_marks(name, colours[name]) for name in self.names)
        return (
            Series(label="s"),
            Series(label="peak", scale="kPa", stroke=PEAK_COLOUR, width=1),
            Series(label="range", scale="mark", width=0, fill=RANGE_COLOUR),
            Series(label="here", scale="mark", stroke=HERE_COLOUR, width=1.5),
            *labels,
            *found,
        )

    def data(
        self, seconds: float, span: tuple[float, float]
    ) -> tuple[Float[np.ndarray, "bin"], ...]:
        """Return times [s], peaks [kPa], range, position, labels and detections."""
        editor = self.editor
        times = self.times
        ranged, here = np.full((2, len(times)), OUTSIDE)
        labelled, detected = np.full((2, len(self.names), len(times)), OUTSIDE)
        rows = {name: row for row, name in enumerate(self.names)}
        ranged[(times >= span[0]) & (times < span[1])] = 1.0
        here[self.find_bin(seconds)] = 1.0
        for label in editor.labels:
            start, end = editor.span(label)
            inside = (times >= start) & (times < end)
            inside[self.find_bin(start)] = True  # However short the label is.
            labelled[rows.get(label.gesture, ...), inside] = 0.86
        for found in self.detections:
            place = self.find_bin(editor.seconds(found.stamp))
            detected[rows.get(found.gesture, ...), place] = 0.95
        return times, self.peak, ranged, here, *labelled, *detected

    def find_bin(self, seconds: float) -> int:
        """Return the index of a time [s] in the plot."""
        share = seconds / (self.length or 1.0)
        last = len(self.times) - 1
        return min(max(round(share * last), 0), last)


SHOWN_NS = 1_000_000_000
"""Time for which a detection is shown [ns]."""
GESTURES = ("poke", "double_pat", "grab", "stroke")
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
STEP = 0.01
"""Step of the sliders [s]."""
NUDGE = 0.1
"""Step of the arrow keys [s]."""
KEYS: dict[Key, str] = {
    "space": "play or pause",
    "arrowleft": "back by 0.1 s",
    "arrowright": "forward by 0.1 s",
    "arrowup": "previous label",
    "arrowdown": "next label",
    "I": "begin the range here",
    "O": "end the range here",
    "delete": "remove the labels in the range",
    "Z": "undo",
    "S": "save",
}
"""What keys do, besides the digits, which label the range."""
HELP = (
    "space plays, arrows move, I and O begin and end the range, 1 to 9 label it, "
    "delete removes, Z undoes, S saves"
)


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
        detections: Sequence[DetectionRecord],
    ) -> None:
        """Show the first reading.

        Args:
            server: server of the page.
            mounted: skin of the recording, on its robot.
            loaded: readings of the recording.
            editor: editor of its labels.
            detections: what a model recognised in it, to compare with the labels.
        """
        self.server = server
        self.mounted = mounted
        self.loaded = loaded
        self.editor = editor
        self.detections = detections
        self.lock = RLock()
        self.clock = PlaybackClock(float(loaded.seconds[-1]))
        self.shown = -1
        gui = server.gui
        title = editor.recording.path.name
        setup = replace(describe_scene(mounted, GESTURES), title=title)
        self.scene = lay_out(server, setup, WIDER)
        gui.add_html(html.render_block(PURPOSE))
        self.status = gui.add_html("")
        self.overview = Overview(gui, loaded, editor, detections)
        self.add_transport()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Label", Icon.TAG):
            self.add_label()
        with tabs.add_tab("Compare", Icon.LIST_CHECK):
            self.table = gui.add_html("")
        with tabs.add_tab("Colours", Icon.PALETTE):
            add_scale(gui, self.scene.scale)
        self.note = gui.add_html("")
        digits: dict[Key, str] = {
            key: f"label the range with gesture {key}" for key in DIGITS
        }
        for key, title in (KEYS | digits).items():
            add_key(gui, key, title, partial(self.press, key))
        self.list_labels()

    def add_transport(self) -> None:
        """Add the controls of the playback: time, range, speed."""
        gui = self.server.gui
        clock = self.clock
        longest = max(clock.length, STEP)
        self.slider = gui.add_slider("time [s]", 0.0, longest, STEP, 0.0)
        self.range = gui.add_multi_slider(
            "range [s]",
            0.0,
            longest,
            STEP,
            (0.0, min(1.0, longest)),
            hint="Drag both ends over a touch, or set them at the position by I and O",
        )
        keys = gui.add_button_group("go", ("play/pause", "previous", "next"))
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        go: dict[str, Key] = {"previous": "arrowup", "next": "arrowdown"}
        obey(self.slider.on_update, self.seek)
        obey(self.range.on_update, lambda span: self.draw())
        obey(keys.on_click, lambda label: self.press(go.get(label, "space")))
        obey(speed.on_update, lambda value: setattr(clock, "speed", float(value)))

    def seek(self, seconds: float) -> None:
        """Move to a time [s]."""
        with self.lock:
            self.clock.seek(float(seconds))

    def add_label(self) -> None:
        """Add the controls that label the range, remove, undo and save."""
        gui = self.server.gui
        self.legend = gui.add_html("")
        self.gesture = gui.add_text("gesture", "", hint="any name of a gesture")
        keys: dict[str, Key] = {"begin (I)": "I", "end (O)": "O"}
        ends = gui.add_button_group("range here", tuple(keys))
        change = gui.add_button_group("range", ("label", "remove", "undo"))
        save = gui.add_button("save", icon=Icon.DEVICE_FLOPPY)
        gui.add_html(html.render_notice(HELP))
        acts = {
            "label": lambda: self.label(str(self.gesture.value)),
            "remove": self.remove,
            "undo": self.undo,
        }
        obey(ends.on_click, lambda text: self.press(keys[text]))
        obey(change.on_click, lambda text: self.attempt(acts[text]))
        # In a thread, since it takes a while.
        save.on_click(lambda event: self.press("S"))

    def press(self, key: Key) -> None:
        """Do what a key stands for."""
        with self.lock:
            match key:
                case "space":
                    self.clock.toggle()
                case "arrowleft" | "arrowright":
                    step = NUDGE if key == "arrowright" else -NUDGE
                    self.clock.seek(self.clock.seconds + step)
                case "arrowup" | "arrowdown":
                    self.select_neighbour(1 if key == "arrowdown" else -1)
                case "I" | "O":
                    self.begin_or_end(key)
                case "delete":
                    self.attempt(self.remove)
                case "Z":
                    self.attempt(self.undo)
                case "S":
                    self.attempt(self.save)
                case _:
                    place = int(key) - 1
                    if place < len(self.names):
                        self.attempt(lambda: self.label(self.names[place]))
            self.slider.value = round(self.clock.seconds, 2)

    @property
    def names(self) -> tuple[str, ...]:
        """Gestures of the labels, then the common ones, then the model's own."""
        known = sorted({label.gesture for label in self.editor.labels} - {NONE})
        found = [record.gesture for record in self.detections]
        return tuple(dict.fromkeys([*known, *GESTURES, NONE, *found]))

    def span(self) -> tuple[float, float]:
        """Return start and end of the range [s]."""
        start, end = map(float, self.range.value)
        return start, end

    def begin_or_end(self, key: Literal["I", "O"]) -> None:
        """Begin (I) or end (O) the range at the position."""
        here = round(self.clock.seconds, 2)
        (start, end) = self.span()
        begins = key == "I"
        span = (here, max(here, end)) if begins else (min(start, here), here)
        self.range.value = span
        self.draw()

    def format_label(self, label: Label) -> str:
        """Return a label in words."""
        start, end = self.editor.span(label)
        return f"{html.to_words(label.gesture)} from {start:.2f} to {end:.2f} s"

    def select_neighbour(self, step: int) -> None:
        """Go to the label before or after the position; the range becomes its."""
        now = self.editor.stamp(self.clock.seconds)
        labels = self.editor.labels[::step]
        for label in [x for x in labels if (x.start - now) * step > 0][:1]:
            start, end = self.editor.span(label)
            self.clock.seek(start)
            start, end = round(start, 2), round(end, 2)
            self.range.value = start, min(max(end, start), self.clock.length)
            self.gesture.value = label.gesture
            self.draw()

    def label(self, gesture: str) -> str:
        """Label the range with a gesture, and return a message."""
        name = gesture.strip()
        label = self.editor.set_range(name, *self.span())
        self.gesture.value = name
        self.list_labels()
        return f"{self.format_label(label)}; not saved yet"

    def remove(self) -> str:
        """Remove the labels in the range, and return a message."""
        inside = self.editor.find_overlapping(*self.span())
        if not inside:
            return "no label is in the range; drag it over one"
        self.editor.remove(*inside)
        self.list_labels()
        return f"removed {', '.join(map(self.format_label, inside))}; not saved yet"

    def undo(self) -> str:
        """Undo the last change, and return a message."""
        if not self.editor.undo():
            return "nothing to undo"
        self.list_labels()
        return "undone; not saved yet"

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

    def draw(self) -> None:
        """Draw the overview."""
        self.overview.draw(self.clock.seconds, self.span(), self.names)

    def list_labels(self) -> None:
        """Show the current labels in the plot, the legend and the comparison."""
        names = self.names
        labels = self.editor.labels
        counts = Counter(label.gesture for label in labels)
        colours = html.choose_gesture_colours(names)
        keys = html.render_keys(names, colours, [counts[name] for name in names])
        self.legend.content = html.render_block(keys)
        with self.server.atomic():
            self.draw()
        rows = [
            (
                self.editor.seconds(pair.time),
                pair.label.gesture if pair.label else "-",
                describe_detection(pair.detection),
                pair.is_right,
            )
            for pair in match_detections(labels, self.detections)
        ]
        self.table.content = html.render_comparison(rows)

    def tick(self, elapsed: float) -> None:
        """Advance by a time [s] and show the reading at the new position."""
        with self.lock, self.server.atomic():
            if self.clock.advance(elapsed):
                self.slider.value = round(self.clock.seconds, 2)
            row = self.loaded.at(self.clock.seconds)
            if row != self.shown:
                self.shown = row
                loaded = self.loaded
                seconds = float(loaded.seconds[row])
                q = loaded.q[row]
                shown = loaded.pressure[row], loaded.valid[row]
                self.scene.update(build_still(self.mounted, seconds, q, *shown))
                self.status.content = self.render_status(row)
                self.draw()

    def render_status(self, row: int) -> str:
        """Return time, force and peak of a reading, and what it is, as HTML."""
        now = self.editor.stamp(float(self.loaded.seconds[row]))
        label = ""
        found = None
        for each in self.editor.labels:
            label = each.gesture if each.start <= now < each.end else label
        for record in self.detections:
            found = record if record.onset <= now < record.stamp + SHOWN_NS else found
        numbers = html.render_numbers(
            ("time", f"{self.loaded.seconds[row]:.2f} s"),
            ("force", f"{self.loaded.force[row]:.1f} N"),
            ("peak", f"{self.loaded.peak[row]:.0f} kPa"),
        )
        return numbers + html.render_instant(
            (label, label or "no label"),
            (found.gesture if found else "", describe_detection(found)),
            html.choose_gesture_colours(self.names),
        )


def describe_detection(found: DetectionRecord | None) -> str:
    """Return gesture and confidence of a detection, or a dash for none."""
    return f"{found.gesture} {found.confidence:.0%}" if found else "-"
