"""What a fault is, and how faulty taxels are put together to rows, columns, patches."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Int

from eskin.skin.skin import Skin
from eskin.touch.lines import Lines

FaultKind = Literal[
    "stuck", "dead", "negative", "saturated", "noisy", "row", "column", "patch"
]
TAXEL_KINDS: tuple[FaultKind, ...] = ("stuck", "dead", "negative", "saturated", "noisy")
LEAST_LINE = 3


@dataclass(frozen=True)
class Fault:
    """Something of the skin that is out of order."""

    kind: FaultKind
    """What is wrong. `stuck`: frozen at a count; `dead`: frozen at zero; `negative`:
    counts below zero, which is how a converter says NaN; `saturated`: at full scale for
    longer than anybody touches; `noisy`: jumps to and fro on its own; `row`, `column`,
    `patch`: out as a whole, or silent."""

    patch: str
    """Its patch."""

    row: int | None
    """Its row, unless the fault is of a column or patch."""

    column: int | None
    """Its column, unless the fault is of a row or patch."""

    taxel: int | None
    """Its index in the skin, where the fault is of one taxel."""

    since: int
    """When it began, as far as can be told [ns since the epoch]."""


@final
class FaultLister:
    """Lists faults, a whole row, column or patch as one."""

    def __init__(self, skin: Skin) -> None:
        """Group the taxels."""
        self.skin = skin
        self.rows = Lines.of(skin, np.asarray(skin.rows))
        self.columns = Lines.of(skin, np.asarray(skin.columns))
        self.patches = Lines.of(skin, np.asarray(skin.patch_index))

    def report(
        self,
        code: Int[np.ndarray, "taxel"],
        silent: Bool[np.ndarray, "taxel"],
        since: Int[np.ndarray, "taxel"],
    ) -> list[Fault]:
        """List the faults: patches first, then rows, columns and what else is left.

        Args:
            code: the place in `TAXEL_KINDS` of each taxel's fault, or -1.
            silent: taxels unheard; they make no fault unless their whole patch is.
            since: stamp from which each taxel is faulty or silent [ns].
        """
        left = code >= 0
        faults: list[Fault] = []
        kinds: tuple[tuple[FaultKind, Lines, int], ...] = (
            ("patch", self.patches, 1),
            ("row", self.rows, LEAST_LINE),
            ("column", self.columns, LEAST_LINE),
        )
        for kind, lines, least in kinds:
            flags = left | silent if kind == "patch" else left
            out = lines.all_of(flags) & (lines.sizes >= least)
            for n in np.flatnonzero(out):
                begun = int(since[lines.line_index == n].max())
                faults.append(self.line_fault(kind, lines, int(n), begun))
            left = left & ~out[lines.line_index]
        return faults + [
            self.taxel_fault(int(i), int(code[i]), int(since[i]))
            for i in np.flatnonzero(left)
        ]

    def line_fault(self, kind: FaultKind, lines: Lines, line: int, since: int) -> Fault:
        """The fault of a row, column or patch."""
        number = int(lines.numbers[line])
        return Fault(
            kind=kind,
            patch=self.skin.patches[int(lines.patches[line])].id,
            row=number if kind == "row" else None,
            column=number if kind == "column" else None,
            taxel=None,
            since=since,
        )

    def taxel_fault(self, taxel: int, code: int, since: int) -> Fault:
        """The fault of one taxel."""
        return Fault(
            kind=TAXEL_KINDS[code],
            patch=self.skin.patches[int(self.skin.patch_index[taxel])].id,
            row=int(self.skin.rows[taxel]),
            column=int(self.skin.columns[taxel]),
            taxel=taxel,
            since=since,
        )
