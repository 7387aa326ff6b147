"""This module detects taxels, rows, columns and patches with invalid data."""

from dataclasses import dataclass, field
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.belief import Belief, BeliefConfig
from eskin.touch.belief_kernels import NEVER, CountScan
from eskin.touch.calibration import Calibration
from eskin.touch.fault_kernels import (
    CountHistory,
    CountLimits,
    update_history,
    update_unanswered,
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
STUCK, DEAD, NEGATIVE, SATURATED, NOISY = range(len(TAXEL_KINDS))
"""Codes of the faults of a taxel: indices of `TAXEL_KINDS`."""
MIN_LINE = 3
"""Number of taxels from which a row or column can be faulty as a whole."""
MAX_ELAPSED = 0.2
"""Largest time between two checks that is added to the evidence [s]."""
SAME_SECONDS = 0.5
"""Time without a change of the counts in which a still taxel remains a fault [s]."""


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
        if not (left | silent).any():
            return faults
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


@dataclass(frozen=True)
class FaultConfig:
    """Thresholds define the evidence that a fault needs. All times are in [s]."""

    check_seconds: float = 0.1
    """Period of the checks; negative counts are masked at once."""
    stuck_seconds: float = 5.0
    """Smallest time of constant counts of a stuck taxel while others of its patch show
    noise."""
    stuck_factor: float = 20.0
    """Smallest ratio of that time to the third quartile of its patch."""
    offset: float = 0.01
    """Part of full scale from which rest differs from zero. A taxel with such an offset
    must not read zero; one that rests about zero may."""
    offset_share: float = 0.7
    """Share of a patch with such an offset from which a taxel that was always at zero
    is dead."""
    pressed: float = 10.0
    """Pressure on neighbours at which a taxel is expected to respond [kPa]."""
    pressed_share: float = 0.9
    """Share of neighbours that must have that pressure."""
    ignored_seconds: float = 1.0
    """Time without response to them from which a taxel is stuck or dead."""
    saturated_start_seconds: float = 5.0
    """Time at full scale, from the start on, that is no fault."""
    saturated_seconds: float = 60.0
    """Time at full scale, later on, that is no fault."""
    line_seconds: float = 0.5
    """Time at zero from which a row or column with an offset is dead, and time without
    data from which a patch is silent."""
    silence_seconds: float = 10.0
    """Time without data after which the history restarts: the patch may be new."""
    recover_seconds: float = 30.0
    """Time without evidence after which a taxel is valid again, or no longer
    doubtful."""
    negative_seconds: float = 1.0
    """The same after negative counts, which are invalid one by one."""
    offset_seconds: float = 1.0
    """Time above zero after which an offset of a taxel is known."""
    belief: BeliefConfig = field(default_factory=BeliefConfig)
    """Noise and evidence from which a taxel is noisy or doubtful."""


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
        self.skin = skin
        self.config = config or FaultConfig()
        self.full_scale = calibration.full_scale
        counts = calibration.compute_contact(contact)
        self.limits = CountLimits(
            full_scale=calibration.full_scale,
            contact=counts,
            silence_seconds=self.config.silence_seconds,
            saturated_seconds=self.config.saturated_seconds,
            pressed=self.config.pressed,
            pressed_share=self.config.pressed_share,
        )
        self.adjacency = Adjacency.build(skin)
        self.grouper = FaultGrouper(skin)
        index = np.asarray(skin.patch_index)
        self.members = [np.flatnonzero(index == n) for n in range(len(skin.patches))]
        self.history = build_count_history(skin.count)
        grouper = self.grouper
        self.noise = Belief(
            *(skin, calibration, counts, grouper.patches),
            (grouper.rows, grouper.columns),
            self.config.belief,
        )
        self.no_dip = np.zeros(skin.count)
        self.last_sound = np.zeros(skin.count)
        self.code = np.full(skin.count, -1)
        self.since = np.zeros(skin.count)
        self.last_found = np.full(skin.count, NEVER)
        self.doubtful = np.zeros(skin.count, bool)
        self.mask = np.zeros(skin.count, bool)
        self.faults: tuple[Fault, ...] = ()
        self.first: int | None = None
        self.last: int | None = None
        self.last_check = NEVER

    def restart(self, taxels: Int[np.ndarray, "some"]) -> None:
        """Forget the history of some taxels, as if they had not been received yet."""
        self.history.last_received[taxels] = NEVER

    def push(
        self,
        scan: Scan,
        pressure: Values,
        rest: Values,
        refused: Flags | None = None,
        dip: Values | None = None,
    ) -> tuple[Flags, tuple[Fault, ...]]:
        """Check the next scan, its calibrated pressure [kPa], and the counts at rest.

        `refused` are taxels whose data counts as not received, and tells of swings of
        a patch alone; `dip` are the counts below rest to which each sensor may fall
        after a press, 0 for None.

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
            dip=self.no_dip if dip is None else dip,
            band=self.noise.band,
            mask=self.mask,
            first_received=self.history.first_received,
            now=now,
            elapsed=elapsed,
        )
        update_history(counted, self.limits, self.history)
        self.noise.push(counted, refused)
        if now - self.last_check >= self.config.check_seconds - 1e-6:
            self.check(counted, pressure)
        return self.mask, self.faults

    def check(self, scan: CountScan, pressure: Values) -> None:
        """Check the evidence, and update the mask and the faults."""
        now, elapsed = scan.now, min(scan.now - self.last_check, MAX_ELAPSED)
        update_unanswered(
            pressure, elapsed, scan, self.limits, self.adjacency, self.history
        )
        self.update_codes(scan)
        self.last_check = now
        code = self.code
        if (code == NOISY).any():
            spread = self.noise.spread_lines(code == NOISY)
            code = np.where((code < 0) & spread, NOISY, code)
        self.mask = code >= 0
        self.doubtful = now - self.noise.last_doubted <= self.config.recover_seconds
        self.doubtful |= self.mask
        received = np.maximum(self.history.last_received, 0.0)
        begun = np.where(self.mask, self.since, received) * NS_PER_S
        self.faults = tuple(
            self.grouper.list_faults(
                code,
                now - received >= self.config.line_seconds,
                np.round(begun).astype(np.int64) + (self.first or 0),
            )
        )

    def update_codes(self, scan: CountScan) -> None:
        """Update the code of each taxel's fault, -1 for none, and what is doubtful."""
        history, now = self.history, scan.now
        zero = history.counts == 0
        still, lost = self.find_still(), self.find_lost_lines()
        noisy = self.noise.check(scan)
        self.last_sound[~noisy] = now
        evidence = {
            STUCK: (still & ~zero, history.last_changed),
            DEAD: ((still & zero) | lost, history.last_changed),
            NEGATIVE: (history.last_negative > self.last_check, history.last_negative),
            SATURATED: (self.find_saturated(), history.last_below_full),
            NOISY: (noisy, self.last_sound),
        }
        for code, (flags, begun) in evidence.items():
            found = flags & (history.last_received > NEVER)
            new = found & (self.code != code)
            self.since[new] = np.maximum(begun, history.first_received)[new]
            self.code[found] = code
            self.last_found[found] = now
        latch = self.config.recover_seconds
        negative = self.code == NEGATIVE
        recover = np.where(negative, self.config.negative_seconds, latch)
        self.code[now - self.last_found > recover] = -1
        masked = np.flatnonzero((self.code == NOISY) | (self.code == SATURATED))
        lifted = self.noise.find_lifted(masked, scan.rest)
        self.code[masked[lifted & ~noisy[masked]]] = -1

    def find_still(self) -> Flags:
        """Find taxels with constant counts, zero included, that should have changed."""
        history, config = self.history, self.config
        counts = history.counts
        age = history.last_received - history.last_changed
        limit = np.full(self.skin.count, np.inf)
        live = (counts > 0) & (history.last_received > NEVER)
        for members in self.members:
            ages = age[members[live[members]]]
            if len(ages):
                rank = 3 * len(ages) // 4
                usual = np.partition(ages, rank)[rank]
                limit[members] = max(config.stuck_seconds, config.stuck_factor * usual)
        inside = (counts >= 0) & (counts < self.full_scale)
        patches = self.grouper.patches
        offset = patches.flagged_share(self.has_offset()) >= config.offset_share
        possible = inside & ((counts > 0) | offset[patches.group_index])
        ignored = inside & (history.unanswered >= config.ignored_seconds)
        was_still = (self.code == STUCK) | (self.code == DEAD)
        remains = was_still & inside & (age > SAME_SECONDS)
        return (possible & (age > limit)) | ignored | remains

    def has_offset(self) -> Flags:
        """Return which taxels have had counts well above zero for long enough."""
        history, least = self.history, self.history.least
        seconds = history.last_nonzero - history.first_received
        return (
            (seconds >= self.config.offset_seconds)
            & (least >= self.config.offset * self.full_scale)
            & np.isfinite(least)
        )

    def find_lost_lines(self) -> Flags:
        """Find the taxels of rows and columns with an offset that read zero."""
        history = self.history
        seconds = history.last_received - history.last_nonzero
        lost = (
            (history.counts == 0)
            & (seconds >= self.config.line_seconds)
            & self.has_offset()
        )
        result = np.zeros(self.skin.count, bool)
        for groups in (self.grouper.rows, self.grouper.columns):
            out = (groups.flagged_share(lost) == 1.0) & (groups.sizes >= MIN_LINE)
            result |= out[groups.group_index]
        return result

    def find_saturated(self) -> Flags:
        """Find taxels at full scale for longer than a touch."""
        history, config = self.history, self.config
        full = history.counts >= self.full_scale
        from_start = history.last_below_full < history.first_received
        begun = np.where(from_start, history.first_received, history.last_below_full)
        limit = np.where(
            from_start, config.saturated_start_seconds, config.saturated_seconds
        )
        long = history.last_received - begun >= limit
        return full & (long | (self.code == SATURATED))


def build_count_history(count: int) -> CountHistory:
    """Build the history of a skin before its first scan."""
    history: dict[str, np.ndarray] = {
        name: np.full(count, NEVER) for name in CountHistory._fields
    }
    history["counts"] = np.zeros(count, np.int64)
    history["first_received"] = np.full(count, np.inf)
    history["least"] = np.full(count, np.inf)
    history["unanswered"] = np.zeros(count)
    return CountHistory(**history)
