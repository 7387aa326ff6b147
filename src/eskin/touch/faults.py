"""This module detects taxels, rows, columns and patches with invalid data."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.calibration import Calibration
from eskin.touch.fault_kernels import (
    NEVER,
    RECENT,
    CountHistory,
    CountLimits,
    CountScan,
    find_noisier,
    update_history,
    update_noise,
    update_unanswered,
)
from eskin.touch.noise import NoiseFloor
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
MIN_DEVIATION = 4.0
"""Smallest deviation from a straight course that is noisy [counts]: converters have a
noise of one or two."""
NOISIER = 2.0
"""Ratio of a taxel's deviation to the median of its neighbours, and to that of its
patch, from which it is the taxel that is noisy, and not all of them under a hand."""
DOUBTFUL_NOISIER = 3.0
"""The same from which a taxel is doubtful: the running median of each of thousands of
taxels, over a second, comes to twice that of its patch by chance."""
MIN_MIXED = 3
"""Number of taxels of a row or column that are away from rest, where some are above and
some below it, from which it is doubtful: beside a pressed taxel, one that was released
may be below rest for a while."""
MAX_CUT, CUT_CONTACTS = 8.0, 3.0
"""Largest counts that a converter which cuts small values may swing by about zero: in
counts, and in units of those at which contact begins."""
MIN_LEARNED = 0.3
"""Time from which the noise is known well enough to tell what is away from rest [s]."""
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
    start_floor: float = 7.0
    """Pressure that may be noise while the noise is neither calibrated nor learned yet
    [kPa]."""
    noisy: float = 0.9
    """Running median of the deviation of three scans from a straight course that makes
    a taxel noisy, in units of the counts at which contact begins."""
    noisy_level: float = 0.25
    """The same, in units of the mean counts above rest: a taxel that is touched may
    deviate more."""
    isolated_steps: float = 1.5
    """Number of steps within one scan, in which no neighbour takes part, that makes a
    taxel noisy. One after which it stays flat counts for two."""
    step_seconds: float = 10.0
    """Time constant with which such a step counts for less."""
    doubtful: float = 0.5
    """Limit of that deviation from which a taxel is doubtful: it may stop an arm, and
    nothing else. Six standard deviations of such noise are 1.8 times what makes
    contact."""
    doubtful_steps: float = 1.2
    """Number of isolated steps from which it is."""
    swing_share: float = 0.25
    """Share of a patch that is above rest by more than noise, and soon after below it,
    as no hand does."""
    swings: float = 1.5
    """Number of such changes of sign that makes all taxels of the patch noisy."""
    line_share: float = 0.2
    """Share of a row or column above rest by more than noise, and another below it,
    that makes it doubtful: it is not connected."""
    line_size: int = 6
    """Number of taxels of a row or column from which it must not be pressed evenly."""
    line_spread: float = 0.2
    """Standard deviation of the counts above rest along a row or column, in units of
    their mean, below which it is pressed evenly, as by hum and by no hand."""
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


@final
class SwingDetector:
    """A detector finds patches that swing about rest as a whole, as mains hum does.

    Attributes:
        going: whether a patch has lately been below rest.
        found: taxels of the patches that swing at present.
    """

    def __init__(self, groups: TaxelGroups, config: FaultConfig) -> None:
        """Start with patches at rest."""
        self.groups = groups
        self.config = config
        self.going = False
        self.found = np.zeros(len(groups.group_index), bool)
        self.sign = np.zeros(len(groups.sizes), np.int64)
        self.swings = np.zeros(len(groups.sizes))
        self.turned_at = np.full(len(groups.sizes), NEVER)
        self.last = 0.0

    def update(self, high: Flags, low: Flags, now: float) -> None:
        """Update by the taxels above rest and below it in a scan at a time [s]."""
        share, groups = self.config.swing_share, self.groups
        self.swings *= np.exp(-(now - self.last) / self.config.step_seconds)
        self.last = now
        sign = np.where(groups.flagged_share(high) >= share, 1, 0)
        sign = np.where(groups.flagged_share(low) >= share, -1, sign)
        turned = (sign != 0) & (sign != self.sign)
        self.swings += turned & (self.sign != 0)
        self.sign = np.where(turned, sign, self.sign)
        self.turned_at[turned] = now
        self.sign[now - self.turned_at > self.config.step_seconds] = 0
        self.going = bool(self.sign.any())
        self.found = (self.swings >= self.config.swings)[groups.group_index]


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
            deviation=np.maximum(self.config.noisy * counts, MIN_DEVIATION),
            cut=np.minimum(MAX_CUT, CUT_CONTACTS * counts),
            step_seconds=self.config.step_seconds,
            silence_seconds=self.config.silence_seconds,
            saturated_seconds=self.config.saturated_seconds,
            pressed=self.config.pressed,
            pressed_share=self.config.pressed_share,
        )
        self.adjacency = Adjacency.build(skin)
        self.grouper = FaultGrouper(skin)
        index = np.asarray(skin.patch_index)
        self.swings = SwingDetector(self.grouper.patches, self.config)
        self.members = [np.flatnonzero(index == n) for n in range(len(skin.patches))]
        self.history = build_count_history(skin.count)
        self.noise = NoiseFloor(
            calibration, counts, self.members, self.history, self.config.start_floor
        )
        self.code = np.full(skin.count, -1)
        self.since = np.zeros(skin.count)
        self.last_found = np.full(skin.count, NEVER)
        self.last_doubted = np.full(skin.count, NEVER)
        self.doubtful = np.zeros(skin.count, bool)
        self.mask = np.zeros(skin.count, bool)
        self.faults: tuple[Fault, ...] = ()
        self.first: int | None = None
        self.last: int | None = None
        self.last_check = NEVER
        self.turn = 0

    def restart(self, taxels: Int[np.ndarray, "some"]) -> None:
        """Forget the history of some taxels, as if they had not been received yet."""
        self.history.last_received[taxels] = NEVER

    def push(
        self,
        scan: Scan,
        pressure: Values,
        rest: Values,
        refused: Flags | None = None,
    ) -> tuple[Flags, tuple[Fault, ...]]:
        """Check the next scan, its calibrated pressure [kPa], and the counts at rest.

        `refused` are taxels whose data counts as not received, and tells of swings of
        a patch alone.

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
        self.turn = (self.turn + 1) % RECENT
        received = scan.received if refused is None else scan.received & ~refused
        counted = CountScan(
            counts=scan.counts,
            received=received,
            rest=rest,
            rest_band=self.noise.rest_band,
            mask=self.mask,
            now=now,
            elapsed=elapsed,
            turn=self.turn,
        )
        update_history(counted, self.limits, self.history)
        low_count = update_noise(counted, self.limits, self.adjacency, self.history)
        may_swing = now >= MIN_LEARNED and (
            low_count or self.swings.going or refused is not None
        )
        is_due = now - self.last_check >= self.config.check_seconds - 1e-6
        if may_swing or is_due:
            above = scan.counts - rest
            high = scan.received & (above > self.noise.rest_band)
            if may_swing:
                low = scan.received & (above < -self.noise.rest_band)
                self.swings.update(high, low, now)
                self.doubt_mixed_lines(high & received, low & received, now)
            if is_due:
                self.doubt_even_lines(above, high & received, now)
                self.check(counted, pressure)
        return self.mask, self.faults

    def check(self, scan: CountScan, pressure: Values) -> None:
        """Check the evidence, and update the mask and the faults."""
        now, elapsed = scan.now, min(scan.now - self.last_check, MAX_ELAPSED)
        update_unanswered(
            pressure, elapsed, scan, self.limits, self.adjacency, self.history
        )
        self.update_codes(scan.rest, now)
        self.noise.update(self.mask, now)
        self.last_check = now
        self.mask = self.code >= 0
        received = np.maximum(self.history.last_received, 0.0)
        begun = np.where(self.mask, self.since, received) * NS_PER_S
        self.faults = tuple(
            self.grouper.list_faults(
                self.code,
                now - received >= self.config.line_seconds,
                np.round(begun).astype(np.int64) + (self.first or 0),
            )
        )

    def update_codes(self, rest: Values, now: float) -> None:
        """Update the code of each taxel's fault, -1 for none."""
        history = self.history
        zero = history.counts == 0
        still, lost = self.find_still(), self.find_lost_lines()
        noisy, doubtful = self.find_noisy()
        evidence = {
            STUCK: (still & ~zero, history.last_changed),
            DEAD: ((still & zero) | lost, history.last_changed),
            NEGATIVE: (history.last_negative > self.last_check, history.last_negative),
            SATURATED: (self.find_saturated(), history.last_below_full),
            NOISY: (noisy, history.last_straight),
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
        self.code[self.find_lifted(rest) & ~noisy] = -1
        self.last_doubted[doubtful] = now
        self.doubtful = (now - self.last_doubted <= latch) | (self.code >= 0)

    def find_lifted(self, rest: Values) -> Flags:
        """Find noisy and saturated taxels that lie below rest now.

        A hand was on them when the skin was switched on, and has lifted: its pressure
        was taken for their rest, and its noise for theirs. They remain doubtful.
        """
        found = np.zeros(self.skin.count, bool)
        masked = np.flatnonzero((self.code == NOISY) | (self.code == SATURATED))
        highest = self.history.recent[:, masked].max(axis=0)
        found[masked] = highest < rest[masked] - self.noise.rest_band[masked]
        return found

    def doubt_mixed_lines(self, high: Flags, low: Flags, now: float) -> None:
        """Doubt rows and columns that are partly above rest and partly below it.

        So does a line that is not connected, of which at least `MIN_MIXED` taxels are
        away from rest; a hand presses, and presses nothing below rest.
        """
        share = self.config.line_share
        away = high | low
        for groups in (self.grouper.rows, self.grouper.columns):
            mixed = groups.flagged_count(away) >= MIN_MIXED
            for flags in (high, low):
                mixed &= groups.flagged_share(flags) >= share
            if mixed.any():
                self.last_doubted[mixed[groups.group_index]] = now

    def doubt_even_lines(self, above: Values, high: Flags, now: float) -> None:
        """Doubt rows and columns that are pressed evenly from end to end.

        That is where all taxels of one are `high`, and about as far above rest
        [counts].
        """
        config = self.config
        if np.count_nonzero(high) < config.line_size:
            return
        for groups in (self.grouper.rows, self.grouper.columns):
            even = groups.flagged_share(high) == 1.0
            even &= groups.sizes >= config.line_size
            if even.any():
                means, squares = (
                    np.bincount(groups.group_index, values) / groups.sizes
                    for values in (above, above**2)
                )
                even &= squares <= (1.0 + config.line_spread**2) * means**2
                self.last_doubted[even[groups.group_index]] = now

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

    def find_noisy(self) -> tuple[Flags, Flags]:
        """Find the taxels that are noisy, and those doubtful for their noise."""
        history, config = self.history, self.config
        level = config.noisy_level * history.level
        deviation = history.deviation / np.maximum(self.limits.deviation, level)
        noisy = self.swings.found | (history.steps >= config.isolated_steps)
        noisy |= self.find_noisier(deviation >= 1.0, NOISIER)
        doubtful = noisy | (history.steps >= config.doubtful_steps)
        deviates = deviation >= config.doubtful / config.noisy
        return noisy, doubtful | self.find_noisier(deviates, DOUBTFUL_NOISIER)

    def find_noisier(self, deviates: Flags, factor: float) -> Flags:
        """Find those of some taxels that deviate more than those around them.

        `factor` is the least ratio of the deviation of one to the median of its patch,
        and to that of its neighbours.
        """
        history, found = self.history, np.zeros(self.skin.count, bool)
        if deviates.any():
            usual = [np.median(history.deviation[each]) for each in self.members]
            least = factor * np.array(usual)[self.skin.patch_index]
            taxels = np.flatnonzero(deviates & (history.deviation >= least))
            found[find_noisier(taxels, factor, self.adjacency, history)] = True
        return found


def build_count_history(count: int) -> CountHistory:
    """Build the history of a skin before its first scan."""
    history: dict[str, np.ndarray] = {
        name: np.full(count, NEVER) for name in CountHistory._fields
    }
    history["counts"] = np.zeros(count, np.int64)
    history["first_received"] = np.full(count, np.inf)
    history["least"] = np.full(count, np.inf)
    history["unanswered"] = np.zeros(count)
    history["recent"] = np.full((RECENT, count), np.nan)
    history["in_contact"] = np.zeros(count, np.bool_)
    zeros = ("deviation", "noise", "start_noise", "slow_noise", "level", "steps")
    for name in (*zeros, "isolated_level", "isolated_step"):
        history[name] = np.zeros(count)
    return CountHistory(**history)
