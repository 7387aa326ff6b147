"""This module maps pressure to colours that people of any colour vision can order."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, UInt8

VIRIDIS = np.array(
    [
        (68, 1, 84),
        (72, 24, 106),
        (71, 45, 123),
        (66, 64, 134),
        (59, 82, 139),
        (51, 99, 141),
        (44, 114, 142),
        (38, 130, 142),
        (33, 145, 140),
        (31, 160, 136),
        (40, 174, 128),
        (63, 188, 115),
        (94, 201, 98),
        (132, 212, 75),
        (173, 220, 48),
        (216, 226, 25),
        (253, 231, 37),
    ],
    np.float64,
)
"""Seventeen stops of viridis (van der Walt and Smith 2015), even in lightness."""
STEPS = 64
"""Number of colours; a taxel is sent to the browser only when its colour changes."""
INVALID_COLOUR = (205, 205, 210)
"""Colour of a taxel that is not valid: red, green and blue, each to 255."""
MIN_SHOWN_PRESSURE = 0.5
"""Pressure below which a taxel is at rest [kPa]."""


@final
class ColourScale:
    """Maps pressures to colours, by the square root of their share of a maximum.

    Attributes:
        maximum: pressure of the lightest colour [kPa].
    """

    def __init__(self, maximum: float) -> None:
        """Create a scale up to a maximum pressure [kPa]."""
        self.maximum = maximum
        stops = np.linspace(0.0, 1.0, len(VIRIDIS))
        steps = np.linspace(0.0, 1.0, STEPS)
        columns = [np.interp(steps, stops, column) for column in VIRIDIS.T]
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
        share[pressure < MIN_SHOWN_PRESSURE] = 0.0
        colours = self.table[np.nan_to_num(share * (STEPS - 1)).astype(np.intp)]
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
        return (
            f'<div style="height:10px;border-radius:5px;'
            f'background:linear-gradient(90deg,{stops})"></div>'
            '<div style="display:flex;justify-content:space-between;font-size:11px;'
            f'color:#667">{names}</div>'
        )
