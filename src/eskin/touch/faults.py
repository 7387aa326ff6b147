"""This module names faults: taxels, rows, columns and patches with invalid data."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Int

from eskin.skin import Skin
from eskin.touch.adjacency import TaxelGroups
from eskin.touch.fault_kernels import MIN_LINE
from eskin.touch.taxels import TaxelPlaces

Flags = Bool[np.ndarray, "taxel"]
Counts = Int[np.ndarray, "taxel"]

FaultKind = Literal[
    "stuck",
    "dead",
    "negative",
    "saturated",
    "noisy",
    "row",
    "column",
    "patch",
    "falling",
    "rising",
]
TAXEL_KINDS: tuple[FaultKind, ...] = ("stuck", "dead", "negative", "saturated", "noisy")


@dataclass(frozen=True)
class Fault:
    """A fault names a taxel, row, column or patch whose data cannot be trusted."""

    kind: FaultKind
    """Kind of the fault. `stuck`: constant above zero; `dead`: constant at zero;
    `negative`: counts below zero, by which a converter signals invalid data;
    `saturated`: at full scale for longer than a touch; `noisy`: jumps up and down more
    than its neighbours; `row`, `column`, `patch`: faulty as a whole, or silent;
    `falling`, `rising`: counts of the skin go this way under pressure, and are taken to
    go the other way."""
    patch: str
    row: int | None
    """Row, unless the fault is of a column or patch."""
    column: int | None
    """Column, unless the fault is of a row or patch."""
    taxel: int | None
    """Index in the skin, where the fault is of one taxel."""
    since: int
    """Estimated time at which it began [ns since the epoch]."""


@final
class FaultGrouper:
    """A grouper lists faults, with a whole faulty row, column or patch as one."""

    def __init__(self, skin: Skin, places: TaxelPlaces) -> None:
        """Store the places of the taxels of a skin."""
        self.skin = skin
        self.places = places

    def list_faults(self, code: Counts, silent: Flags, since: Counts) -> list[Fault]:
        """List the faults: patches first, then rows, columns and the remaining taxels.

        Args:
            code: index in `TAXEL_KINDS` of each taxel's fault, or -1.
            silent: taxels not received, which is a fault of a whole patch only.
            since: stamp from which each taxel is faulty or silent [ns].
        """
        left = code >= 0
        faults: list[Fault] = []
        kinds: tuple[tuple[FaultKind, TaxelGroups, int], ...] = (
            ("patch", self.places.patches, 1),
            ("row", self.places.rows, MIN_LINE),
            ("column", self.places.columns, MIN_LINE),
        )
        for kind, groups, min_size in kinds:
            flags = left | silent if kind == "patch" else left
            out = (groups.flagged_share(flags) == 1.0) & (groups.sizes >= min_size)
            for n in np.flatnonzero(out):
                patch, number = self.skin.patches[groups.patches[n]], groups.numbers[n]
                row = int(number) if kind == "row" else None
                column = int(number) if kind == "column" else None
                begun = int(since[groups.group_index == n].max())
                faults.append(Fault(kind, patch.id, row, column, None, begun))
            left = left & ~out[groups.group_index]
        for i in np.flatnonzero(left).tolist():
            patch = self.skin.patches[self.skin.patch_index[i]]
            row, column = int(self.skin.rows[i]), int(self.skin.columns[i])
            kind, begun = TAXEL_KINDS[code[i]], int(since[i])
            faults.append(Fault(kind, patch.id, row, column, i, begun))
        return faults
