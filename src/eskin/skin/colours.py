"""This module gives taxels colours by their pressure."""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, UInt8

PRESSED = "ffe066 fec43e fca128 f07823 de5226 c4302e a0183c 76083e 4a002e"
"""Stops of the scale from a light touch to a strong one, as red, green and blue, ever
darker, so that people of any colour vision can order them."""
REST_COLOUR = (150, 160, 172)
"""Colour of a taxel at rest, a grey from which all colours of touches differ."""
INVALID_COLOUR = (255, 255, 255)
"""Colour of a taxel that is not valid: red, green and blue, each to 255."""
STEPS = 64
"""Number of colours; a taxel is sent to the browser only when its colour changes."""
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
        stops = np.array([list(bytes.fromhex(stop)) for stop in PRESSED.split()])
        places = np.linspace(0, 1, len(stops))
        steps = np.linspace(0, 1, STEPS)
        columns = [np.interp(steps, places, column) for column in stops.T]
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
