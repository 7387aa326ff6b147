"""The last ten seconds of force and pressure."""

from collections import deque
from typing import final

import numpy as np
from jaxtyping import Float
from viser import GuiApi

from eskin.page.picture import Picture

SECONDS = 10.0
PERIOD = 0.1
"""Between two points [s]."""
COUNT = round(SECONDS / PERIOD)
HIGH, OUTSIDE = 0.93, -9.0
"""Where marks are drawn, as a share of the height; the plot knows no missing values."""


@final
class Strip:
    """A plot that moves on ten times a second, with what was said marked in it."""

    def __init__(self, gui: GuiApi) -> None:
        """Start with nothing felt."""
        self.points: deque[tuple[float, float, float]] = deque(maxlen=COUNT)
        self.force = self.peak = 0.0
        self.said = False
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
                    "label": "said",
                    "stroke": "#d55e00",
                    "width": 0,
                    "scale": "said",
                    "points": {"show": True, "size": 9, "fill": "#d55e00"},
                },
            ),
            scales={
                "x": {"time": False, "range": (-SECONDS, 0.0)},
                "N": {"auto": True},
                "kPa": {"auto": True},
                "said": {"range": (0.0, 1.0)},
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

    def take(self, picture: Picture) -> None:
        """Keep the greatest of what comes between two points."""
        self.force = max(self.force, picture.force)
        self.peak = max(self.peak, picture.peak)
        self.said |= any(saying.kind == "detection" for saying in picture.sayings)

    def draw(self) -> None:
        """Move on by one point."""
        mark = HIGH if self.said else OUTSIDE
        self.points.append((self.force, self.peak, mark))
        self.force, self.peak, self.said = 0.0, 0.0, False
        self.plot.data = self.data()

    def data(self) -> tuple[Float[np.ndarray, "time"], ...]:
        """Seconds before now, force [N], peak [kPa], and where words were said."""
        columns = np.zeros((4, COUNT))
        columns[3] = OUTSIDE
        columns[0] = np.linspace(-SECONDS + PERIOD, 0.0, COUNT)
        if self.points:
            columns[1:, -len(self.points) :] = np.array(self.points).T
        return tuple(columns)
