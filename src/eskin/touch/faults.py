"""This module names faults: taxels, rows, columns and patches with invalid data."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import TaxelGroups
from eskin.touch.fault_kernels import LINE
from eskin.touch.taxels import Instant, TaxelPlaces

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


def list_faults(
    skin: Skin,
    places: TaxelPlaces,
    code: Counts,
    silent: Flags,
    since: Float[np.ndarray, "taxel"],
    instant: Instant,
) -> list[Fault]:
    """List the faults: patches first, then rows, columns and the remaining taxels.

    Args:
        skin: the skin.
        places: places of its taxels.
        code: index in `TAXEL_KINDS` of each taxel's fault, or -1.
        silent: taxels not received, which is a fault of a whole patch only.
        since: time from which each taxel is faulty or silent [s].
        instant: the time of the latest scan.
    """
    faulty = code >= 0
    faults: list[Fault] = []
    is_out = places.patches.flagged_share(faulty | silent) == 1.0
    for n in np.flatnonzero(is_out):
        begun = instant.stamp_at(since[places.patches.group_index == n].max())
        faults.append(Fault("patch", skin.patches[n].id, None, None, None, begun))
    faulty &= ~is_out[places.patches.group_index]
    # A dead row that crosses a dead column takes no taxel away from it.
    left = faulty.copy()
    lines: tuple[tuple[FaultKind, TaxelGroups], ...] = (
        ("row", places.rows),
        ("column", places.columns),
    )
    for kind, groups in lines:
        is_lost = (groups.flagged_share(faulty) == 1.0) & (groups.sizes >= LINE.least)
        for n in np.flatnonzero(is_lost):
            patch = skin.patches[groups.patches[n]].id
            number = int(groups.numbers[n])
            row = number if kind == "row" else None
            column = number if kind == "column" else None
            begun = instant.stamp_at(since[groups.group_index == n].max())
            faults.append(Fault(kind, patch, row, column, None, begun))
        left &= ~is_lost[groups.group_index]
    for i in np.flatnonzero(left).tolist():
        patch = skin.patches[skin.patch_index[i]].id
        row = int(skin.rows[i])
        column = int(skin.columns[i])
        kind = TAXEL_KINDS[code[i]]
        faults.append(Fault(kind, patch, row, column, i, instant.stamp_at(since[i])))
    return faults
