"""This module maps pressure to colours that people of any colour vision can order."""

from collections.abc import Iterable
from itertools import cycle
from typing import final

import numpy as np
from jaxtyping import Bool, Float, UInt8

PRESSED = np.array(
    [
        (255, 224, 102),
        (254, 196, 62),
        (252, 161, 40),
        (240, 120, 35),
        (222, 82, 38),
        (196, 48, 46),
        (160, 24, 60),
        (118, 8, 62),
        (74, 0, 46),
    ],
    np.float64,
)
"""Stops of the scale from a light touch to a strong one, ever darker, so that people of
any colour vision can order them."""
REST_COLOUR = (150, 160, 172)
"""Colour of a taxel at rest, a grey from which all colours of touches differ."""
STEPS = 64
"""Number of colours; a taxel is sent to the browser only when its colour changes."""
INVALID_COLOUR = (255, 255, 255)
"""Colour of a taxel that is not valid: red, green and blue, each to 255."""
MIN_SHOWN_PRESSURE = 0.5
"""Pressure below which a taxel is at rest [kPa]."""


@final
class ColourScale:
    """Maps pressures to colours, by the square root of their share of a maximum.

    Attributes:
        maximum: pressure of the darkest colour [kPa].
    """

    def __init__(self, maximum: float) -> None:
        """Create a scale up to a maximum pressure [kPa]."""
        self.maximum = maximum
        stops = np.linspace(0.0, 1.0, len(PRESSED))
        steps = np.linspace(0.0, 1.0, STEPS)
        columns = [np.interp(steps, stops, column) for column in PRESSED.T]
        self.table = np.stack(columns, axis=-1).round().astype(np.uint8)

    def colours(
        self, pressure: Float[np.ndarray, "taxel"], valid: Bool[np.ndarray, "taxel"]
    ) -> UInt8[np.ndarray, "taxel 3"]:
        """Return red, green and blue of each taxel.

        Args:
            pressure: pressure of the taxels [kPa].
            valid: whether each taxel is valid.
        """
        share = np.sqrt(np.clip(pressure / self.maximum, 0.0, 1.0))
        colours = self.table[np.nan_to_num(share * (STEPS - 1)).astype(np.intp)]
        colours[pressure < MIN_SHOWN_PRESSURE] = REST_COLOUR
        colours[~valid] = INVALID_COLOUR
        return colours

    def legend(self, ticks: int = 5) -> str:
        """Return the scale as HTML: a bar with its pressures."""
        shares = np.linspace(0.0, 1.0, ticks)
        stops = ", ".join(f"rgb({r},{g},{b})" for r, g, b in self.table[::7].tolist())
        values = [f"{self.maximum * s * s:.3g}" for s in shares.tolist()]
        names = "".join(
            f"<span>{value}</span>" for value in [*values[:-1], values[-1] + " kPa"]
        )
        marks = render_dot(REST_COLOUR) + "at rest " + render_dot(INVALID_COLOUR)
        return (
            f'<div style="height:10px;border-radius:5px;'
            f'background:linear-gradient(90deg,{stops})"></div>'
            '<div style="display:flex;justify-content:space-between;font-size:11px;'
            f'color:#667">{names}</div><div style="font-size:11px;color:#667">'
            f"{marks}not used</div>"
        )


def render_dot(colour: tuple[int, int, int] | str) -> str:
    """Return a dot of a colour as HTML, beside the text that it explains."""
    if not isinstance(colour, str):
        colour = "rgb({},{},{})".format(*colour)
    return (
        '<span style="display:inline-block;width:9px;height:9px;margin-right:4px;'
        f'border:1px solid #99a;border-radius:5px;background:{colour}"></span>'
    )


GESTURE_COLOURS = {
    "none": "#4a525e",
    "unknown": "#c8cdd4",
    "poke": "#d55e00",
    "double_pat": "#0072b2",
    "grab": "#009e73",
    "stroke": "#cc79a7",
}
"""Colours of the gestures that eskin comes with (Okabe and Ito 2008), and of none."""
OTHER_COLOURS = ("#e69f00", "#56b4e9", "#5d3a9b", "#8c510a", "#b8de29")
"""Colours of other gestures, in turns."""


def choose_gesture_colours(gestures: Iterable[str]) -> dict[str, str]:
    """Return the colour of each gesture, the same wherever the same ones are shown."""
    others = sorted(set(gestures) - set(GESTURE_COLOURS))
    named = zip(others, cycle(OTHER_COLOURS), strict=False)
    return GESTURE_COLOURS | dict(named)
