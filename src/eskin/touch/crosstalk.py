"""What a taxel shows of the others in its row and column, taken off again."""

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.skin.skin import Skin
from eskin.touch.lines import Lines
from eskin.touch.reading import Reading


@final
class Crosstalk:
    """Undoes the crosstalk of taxels that are read out by rows and columns.

    Current through a pressed taxel also finds ways through others of its row and
    column, which then show a small part of a pressure that is not theirs. The part
    differs between builds and is hardly ever known, so a constant one is taken off: a
    little of an honest touch rather than rows of taxels that nobody touches.
    """

    def __init__(self, skin: Skin, share: float) -> None:
        """Prepare.

        Args:
            skin: whose readings.
            share: of the pressure of each other taxel in its row and column that a
                taxel shows.
        """
        self.share = share
        self.lines = (Lines.of(skin, skin.rows), Lines.of(skin, skin.columns))

    def taken_off(self, reading: Reading) -> Reading:
        """The reading without it; what is not valid counts for nothing."""
        if self.share == 0.0:
            return reading
        own = np.where(reading.valid, reading.pressure, 0.0)
        others = sum(summed(own, lines) - own for lines in self.lines)
        left = np.maximum(reading.pressure - self.share * others, 0.0)
        return replace(reading, pressure=left.astype(reading.pressure.dtype))


def summed(
    values: Float[np.ndarray, "taxel"], lines: Lines
) -> Float[np.ndarray, "taxel"]:
    """The sum over the line of each taxel."""
    sums = np.bincount(lines.line_index, values, minlength=len(lines.sizes))
    return sums[lines.line_index]
