"""This module detects taxels, rows, columns and patches with invalid data."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import TaxelGroups
from eskin.touch.belief import Belief
from eskin.touch.belief_kernels import MIN_LINE, NEVER, CountScan
from eskin.touch.calibration import Calibration
from eskin.touch.fault_kernels import (
    NOISY,
    FaultConfig,
    FaultContext,
    FaultParameters,
    build_history,
    update_codes,
    update_history,
)
from eskin.touch.reading import Scan, check_order
from eskin.units import NS_PER_S

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
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
MAX_ELAPSED = 0.2
"""Largest time between two checks that is added to the evidence [s]."""


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

    def __init__(self, skin: Skin) -> None:
        """Group the taxels by row, column and patch."""
        self.skin = skin
        self.rows = TaxelGroups.build(skin, np.asarray(skin.rows))
        self.columns = TaxelGroups.build(skin, np.asarray(skin.columns))
        self.patches = TaxelGroups.build(skin, np.asarray(skin.patch_index))

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
            ("patch", self.patches, 1),
            ("row", self.rows, MIN_LINE),
            ("column", self.columns, MIN_LINE),
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


@final
class FaultDetector:
    """A detector finds faults and noise from the counts over time; stateful.

    A fault needs evidence: constant counts of a quiet, quantised sensor, and zero where
    zero is rest, are valid until other taxels show that they should have changed.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        config: FaultConfig | None = None,
        contact: float = 0.7,
    ) -> None:
        """Start without faults on a skin where contact begins at a pressure [kPa]."""
        self.config = config or FaultConfig()
        self.full_scale = calibration.full_scale
        self.contact = calibration.compute_contact(contact)
        self.grouper = FaultGrouper(skin)
        self.history = build_history(skin.count)
        grouper = self.grouper
        self.noise = Belief(
            *(skin, calibration, self.contact, grouper.patches),
            (grouper.rows, grouper.columns),
        )
        self.context = FaultContext(
            *(self.full_scale, FaultParameters(**vars(self.config))),
            *(self.noise.adjacency, grouper.patches, grouper.rows, grouper.columns),
            self.history,
        )
        self.no_peak = np.zeros(skin.count)
        self.doubtful = np.zeros(skin.count, bool)
        self.mask = np.zeros(skin.count, bool)
        self.faults: tuple[Fault, ...] = ()
        self.first: int | None = None
        self.last: int | None = None
        self.last_check = NEVER

    def restart(self, taxels: Int[np.ndarray, "some"]) -> None:
        """Forget the history of some taxels, as if they had not been received yet."""
        self.history["last_received"][taxels] = NEVER

    def push(
        self,
        scan: Scan,
        pressure: Values,
        rest: Values,
        refused: Flags | None = None,
        peak: Values | None = None,
        dip_share: float = 0.0,
    ) -> tuple[Flags, tuple[Fault, ...]]:
        """Check the next scan, its calibrated pressure [kPa], and the counts at rest.

        `refused` are taxels whose data counts as not received, and tells of swings of
        a patch alone; below rest by `dip_share` of the recent `peak` of its counts
        each sensor may fall after a press.

        Returns:
            Which taxels are faulty; and the faults, with a whole row, column or patch
            as one.
        """
        check_order(self.last, scan.stamp)
        self.first = scan.stamp if self.first is None else self.first
        elapsed = 0.0 if self.last is None else (scan.stamp - self.last) / NS_PER_S
        self.last = scan.stamp
        now = (scan.stamp - self.first) / NS_PER_S
        self.mask = self.mask.copy()
        received = scan.received if refused is None else scan.received & ~refused
        counted = CountScan(
            counts=scan.counts,
            received=received,
            rest=rest,
            peak=self.no_peak if peak is None else peak,
            dip_share=dip_share,
            band=self.noise.limits.band,
            mask=self.mask,
            first_received=self.history["first_received"],
            now=now,
            elapsed=elapsed,
        )
        update_history(
            *(counted, self.full_scale, self.config.saturated_seconds, self.history)
        )
        self.noise.push(counted, refused)
        if now - self.last_check >= self.config.check_seconds - 1e-6:
            self.check(counted, pressure)
        return self.mask, self.faults

    def check(self, scan: CountScan, pressure: Values) -> None:
        """Check the evidence, and update the mask and the faults."""
        now, elapsed = scan.now, min(scan.now - self.last_check, MAX_ELAPSED)
        self.noise.check(scan)
        noisy, lifted = self.noise.limits.noisy, self.noise.limits.lifted
        update_codes(
            *(pressure, self.last_check, elapsed, scan, noisy, lifted, self.context)
        )
        self.last_check = now
        code = self.history["code"]
        if (code == NOISY).any():
            spread = self.noise.spread_lines(scan, code == NOISY)
            code = np.where((code < 0) & spread, NOISY, code)
        self.mask = code >= 0
        self.doubtful = now - self.noise.last_doubted <= self.config.recover_seconds
        self.doubtful |= self.mask
        received = np.maximum(self.history["last_received"], 0.0)
        silent = now - received >= self.config.line_seconds
        self.faults = ()
        if self.mask.any() or silent.any():
            begun = np.where(self.mask, self.history["since"], received) * NS_PER_S
            since = np.round(begun).astype(np.int64) + (self.first or 0)
            self.faults = tuple(self.grouper.list_faults(code, silent, since))
