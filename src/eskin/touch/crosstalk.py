"""What a taxel shows of the others of its patch, learned and taken off."""

from collections import deque
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin.skin import Skin
from eskin.touch.calibration import Calibration
from eskin.touch.reading import Reading

TOUCHED = 1.5
"""Pressure without which nothing of a patch is looked at [kPa]."""

VISIBLE = 0.3
"""Conductance of others, by that at half scale, of which a part stands out of noise."""

DIRECT = 0.02
"""A taxel whose detours conduct less than this by its lines tells of leak alone."""

SATURATED = 6.0
"""Conductance by that at half scale that a converter does not tell well."""

FEWEST = 8
"""Taxels of a patch that it takes to tell."""

WIDEST = 0.25
"""Share of a patch that may be touched while it is learned from."""

FAINT = 0.1
"""Conductance by the largest of the patch that is not called touched there."""

MEMORY = 200
"""Observations of which the median is taken."""

CAUTION = 2.5
"""How many times what was learned is taken off. Taxels that the bend of the skin
presses at rest lend themselves to detours, too, and rest does not show; from what is
truly touched this takes little."""

TINY = 1e-9
"""Conductance that is none."""


class Part:
    """How much of something every taxel shows, as learned until now."""

    def __init__(self, largest: float, rank: float) -> None:
        """Start without having seen any.

        Args:
            largest: above it a taxel is touched itself, and nothing is learned.
            rank: which of the sorted parts that taxels show at one instant is believed.
        """
        self.largest = largest
        self.rank = rank
        self.value = 0.0
        self.seen = deque[float](maxlen=MEMORY)

    def learn(
        self, shown: Float[np.ndarray, "taxel"], source: Float[np.ndarray, "taxel"]
    ) -> None:
        """Observe what taxels show, and what it may be a part of."""
        if len(shown) < FEWEST:
            return
        observed = float(np.quantile(shown / source, self.rank))
        if observed <= self.largest:
            self.seen.append(max(observed, 0.0))
            self.value = float(np.median(self.seen))


@dataclass(frozen=True, eq=False)
class Matrix:
    """One patch as its rows and columns; cells without a taxel conduct nothing."""

    taxels: Int[np.ndarray, "taxel"]
    """Its taxels in the skin."""
    cells: tuple[Int[np.ndarray, "taxel"], Int[np.ndarray, "taxel"]]
    """Row and column of each, from 0."""
    calibration: Calibration
    """Of these taxels."""

    @classmethod
    def of(cls, skin: Skin, patch: int, calibration: Calibration) -> "Matrix":
        """A patch of a skin."""
        taxels = np.flatnonzero(skin.patch_index == patch)
        _, rows = np.unique(skin.rows[taxels], return_inverse=True)
        _, columns = np.unique(skin.columns[taxels], return_inverse=True)
        own = replace(calibration, gain=np.asarray(calibration.gain)[taxels])
        return cls(taxels, (rows, columns), own)

    def conductance(
        self, pressure: Float[np.ndarray, "taxel"]
    ) -> Float[np.ndarray, "row column"]:
        """What each cell lets through by what it does at half scale."""
        rows, columns = self.cells
        cells = np.zeros((rows.max() + 1, columns.max() + 1))
        cells[self.cells] = self.calibration.conductance_at(pressure)
        return cells


@final
class Crosstalk:
    """Learns and undoes the crosstalk of taxels read out by rows and columns; stateful.

    Current through a pressed taxel also flows elsewhere: it leaks into the others of
    its row and column, and where touched rows and columns cross, it takes detours over
    three taxels, so that a fourth seems touched (a ghost). Both are fixed parts of
    what the others let through, the same all over one device, and stand in plain sight
    whenever it is touched: most taxels where they show are not touched themselves.
    """

    def __init__(self, skin: Skin, calibration: Calibration) -> None:
        """Start without having seen any."""
        self.matrices: list[Matrix] = []
        if calibration.matrix:
            patches = range(len(skin.patches))
            self.matrices = [Matrix.of(skin, patch, calibration) for patch in patches]
        self.leak = Part(largest=0.03, rank=0.4)
        self.ghost = Part(largest=0.15, rank=0.25)

    def taken_off(self, reading: Reading) -> Reading:
        """Learn from the reading, and give it without what is not its taxels' own.

        What is not valid counts for nothing.
        """
        if not self.matrices or reading.pressure.max() <= TOUCHED:
            return reading
        pressure = np.where(reading.valid, reading.pressure, 0.0)
        touched = [m for m in self.matrices if pressure[m.taxels].max() > TOUCHED]
        left = reading.pressure.copy()
        for matrix in touched:
            shown = matrix.conductance(pressure[matrix.taxels])
            own = self.own(shown, reading.valid[matrix.taxels], matrix)
            left[matrix.taxels] = matrix.calibration.pressure_of(own[matrix.cells])
        return replace(reading, pressure=left)

    def own(
        self,
        shown: Float[np.ndarray, "row column"],
        valid: Bool[np.ndarray, "taxel"],
        matrix: Matrix,
    ) -> Float[np.ndarray, "row column"]:
        """Learn from one patch, and give what its cells let through of themselves."""
        lines, _ = others(shown)
        # What others show has leaked into them, too; the second look is without that.
        lines, detours = others(np.maximum(shown - self.leak.value * lines, 0.0))
        wide = np.mean(shown[matrix.cells] > FAINT * shown.max()) > WIDEST
        if shown.max() < SATURATED and not wide:
            told = np.zeros(shown.shape, dtype=bool)
            told[matrix.cells] = valid
            direct = told & (lines > VISIBLE) & (detours < DIRECT * lines)
            crossing = told & (detours > 0.5 * VISIBLE)
            self.leak.learn(shown[direct], lines[direct])
            ghosts = shown - self.leak.value * lines
            self.ghost.learn(ghosts[crossing], detours[crossing])
        foreign = self.leak.value * lines + self.ghost.value * detours
        return np.maximum(shown - CAUTION * foreign, 0.0)


def others(
    own: Float[np.ndarray, "row column"],
) -> tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]:
    """What the others of each cell's lines let through, and detours past it."""
    row = own.sum(axis=1, keepdims=True) - own
    column = own.sum(axis=0, keepdims=True) - own
    beyond = np.maximum(own.sum() - row - column - own, 0.0)
    series = 1.0 / (row + TINY) + 1.0 / (beyond + TINY) + 1.0 / (column + TINY)
    return row + column, 1.0 / series
