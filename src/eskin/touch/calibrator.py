"""This module turns the counts of a skin into pressure, scan by scan."""

from dataclasses import replace
from typing import final

import numpy as np

from eskin.skin.skin import Skin
from eskin.touch.calibration import Calibration
from eskin.touch.calibration_kernels import GHOST, LEAK, Cells, Law, Learned, take_off
from eskin.touch.reading import Reading

TOUCHED = 1.5
"""Pressure without which nothing of a patch is looked at [kPa]."""

MEMORY = 200
"""Observations of which the median is taken."""


@final
class CrosstalkCompensator:
    """Learns and undoes the crosstalk of taxels read out by rows and columns; stateful.

    Current through a pressed taxel also flows elsewhere: it leaks into the others of
    its row and column, and where touched rows and columns cross, it takes detours over
    three taxels, so that a fourth seems touched (a ghost). Both are fixed parts of
    what the others let through, the same all over one device, and stand in plain sight
    whenever it is touched: most taxels where they show are not touched themselves.
    """

    def __init__(self, skin: Skin, calibration: Calibration) -> None:
        """Start without having seen any."""
        self.cells: list[Cells] = []
        if calibration.matrix:
            patches = range(len(skin.patches))
            self.cells = [cells_of(skin, patch, calibration) for patch in patches]
        power = 1.0 if calibration.curve == "linear" else calibration.exponent
        self.law = Law(power, calibration.unfelt)
        parts = 2
        self.learned = Learned(
            np.zeros(parts), np.zeros(parts, np.int64), np.zeros((parts, MEMORY))
        )

    @property
    def leak(self) -> float:
        """Share of what each other taxel of its lines lets through that one shows."""
        return float(self.learned.value[LEAK])

    @property
    def ghost(self) -> float:
        """Share of what detours over three others let through that a taxel shows."""
        return float(self.learned.value[GHOST])

    def compensate(self, reading: Reading) -> Reading:
        """Learn from the reading, and give it without what is not its taxels' own.

        What is not valid counts for nothing.
        """
        if not self.cells or reading.pressure.max() <= TOUCHED:
            return reading
        pressure = np.where(reading.valid, reading.pressure, np.float32(0.0))
        for cells in self.cells:
            if pressure[cells.taxels].max() > TOUCHED:
                take_off(pressure, reading.valid, self.law, cells, self.learned)
        return replace(reading, pressure=pressure)


def cells_of(skin: Skin, patch: int, calibration: Calibration) -> Cells:
    """A patch of a skin."""
    taxels = np.flatnonzero(skin.patch_index == patch)
    _, rows = np.unique(skin.rows[taxels], return_inverse=True)
    _, columns = np.unique(skin.columns[taxels], return_inverse=True)
    shape, count = (rows.max() + 1, columns.max() + 1), len(taxels)
    return Cells(
        taxels,
        rows,
        columns,
        half=np.asarray(calibration.gain, np.float64)[taxels] * calibration.full_scale,
        shown=np.zeros(shape),
        own=np.zeros(shape),
        along=np.zeros(shape[0]),
        across=np.zeros(shape[1]),
        lines=np.zeros(count),
        detours=np.zeros(count),
        shares=np.zeros(count),
    )
