"""The whole recording in one plot: pressure, labels, detections, and where it is."""

from typing import final

import numpy as np
from jaxtyping import Float
from viser import GuiApi

from eskin.viewer.timeline.editing import Editing
from eskin.viewer.timeline.take import Take, envelope

BINS = 500
OUTSIDE = -9.0
"""Of marks that are not there; the plot knows no missing values."""


@final
class Overview:
    """Draws the recording anew when labels change or the place does."""

    def __init__(self, gui: GuiApi, take: Take, editing: Editing) -> None:
        """Draw the beginning."""
        self.editing = editing
        self.peak = envelope(take.peak, BINS)
        self.length = float(take.seconds[-1])
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
                    "label": "said",
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
        """Draw labels and detections as they are, and the place [s]."""
        self.plot.data = self.data(seconds)

    def data(self, seconds: float) -> tuple[Float[np.ndarray, "bin"], ...]:
        """Times [s], labels, peak [kPa], detections, and the place."""
        editing, times = self.editing, self.times
        labelled, said, here = np.full((3, len(times)), OUTSIDE)
        for label in editing.labels:
            start, end = editing.seconds(label.start), editing.seconds(label.end)
            labelled[(times >= start) & (times < end)] = 0.94
        for found in editing.recording.detections:
            said[self.bin_at(editing.seconds(found.stamp))] = 0.9
        here[self.bin_at(seconds)] = 1.0
        return times, labelled, self.peak, said, here

    def bin_at(self, seconds: float) -> int:
        """The place of a time in the plot."""
        share = seconds / self.length if self.length else 0.0
        return int(
            np.clip(round(share * (len(self.times) - 1)), 0, len(self.times) - 1)
        )
