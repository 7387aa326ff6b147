"""This module detects taxels, rows, columns and patches whose data cannot be trusted."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.calibration import Calibration
from eskin.touch.fault_kernels import PAUSE, Watch, watch_counts, watch_neighbours
from eskin.touch.reading import Scan, check_order
from eskin.units import NS_PER_S

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
        self.rows = TaxelGroups.build(skin, np.asarray(skin.rows))
        self.columns = TaxelGroups.build(skin, np.asarray(skin.columns))
        self.patches = TaxelGroups.build(skin, np.asarray(skin.patch_index))

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
        kinds: tuple[tuple[FaultKind, TaxelGroups, int], ...] = (
            ("patch", self.patches, 1),
            ("row", self.rows, LEAST_LINE),
            ("column", self.columns, LEAST_LINE),
        )
        for kind, lines, least in kinds:
            flags = left | silent if kind == "patch" else left
            out = lines.all_flagged(flags) & (lines.sizes >= least)
            for n in np.flatnonzero(out):
                begun = int(since[lines.group_index == n].max())
                faults.append(self.line_fault(kind, lines, int(n), begun))
            left = left & ~out[lines.group_index]
        return faults + [
            self.taxel_fault(int(i), int(code[i]), int(since[i]))
            for i in np.flatnonzero(left)
        ]

    def line_fault(
        self, kind: FaultKind, lines: TaxelGroups, line: int, since: int
    ) -> Fault:
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


STUCK, DEAD, NEGATIVE, SATURATED, NOISY = range(5)
MOST_ELAPSED = 0.2
COMPANY = 0.3
"""Share of neighbours that jump too where a hand does it: three of eight at the corner
of a palm."""
LEAST_JUMP = 4
"""Of counts: converters flicker by one or two."""
NEVER = -1e9


@dataclass(frozen=True)
class FaultConfig:
    """How much evidence a fault needs. All times in [s]."""

    check_seconds: float = 0.1
    """How often the evidence is weighed; negative counts are masked at once."""

    stuck_seconds: float = 5.0
    """Least time that counts stand still while others of the patch show noise."""

    stuck_factor: float = 20.0
    """How many times longer than three in four others of the patch."""

    offset: float = 0.01
    """Part of full scale, but at least 8 counts, from which counts at rest are no zero.
    That such a taxel reads zero is a fault; where rest is about zero, it is none."""

    offset_share: float = 0.7
    """Share of a patch that must have such an offset for a zero from the start to be
    a fault."""

    pressed: float = 10.0
    """Pressure that neighbours must feel to expect an answer from a taxel [kPa]."""

    pressed_share: float = 0.9
    """Share of neighbours that must feel it."""

    ignored_seconds: float = 1.0
    """How long a taxel must not answer them."""

    saturated_start_seconds: float = 5.0
    """How long full scale since the start is taken for a touch."""

    saturated_seconds: float = 60.0
    """How long full scale is taken for a touch later on."""

    noisy: float = 2.0
    """Change from one scan to the next that nobody's hand makes and undoes [kPa]."""

    noisy_seconds: float = 3.0
    """How long a taxel must jump so, to and fro, while its neighbours do not."""

    line_seconds: float = 0.5
    """How long a row, column or patch may be at zero that never was, or unheard."""

    silence_seconds: float = 10.0
    """After how long unheard a taxel may be another one, and is judged anew."""

    recover_seconds: float = 1.0
    """How long a fault must be gone until it is believed."""


@final
class FaultDetector:
    """Finds faults from what the counts do over time; stateful.

    A fault needs evidence: a quiet sensor whose quantised counts do not change, and one
    at zero where zero is rest, are sound until others show that they should have moved.
    """

    def __init__(
        self, skin: Skin, calibration: Calibration, config: FaultConfig | None = None
    ) -> None:
        """Start with every taxel sound."""
        self.skin = skin
        self.config = config or FaultConfig()
        self.full_scale = calibration.full_scale
        self.jump = np.maximum(
            calibration.compute_counts(self.config.noisy), LEAST_JUMP
        )
        self.adjacency = Adjacency.build(skin)
        self.lister = FaultLister(skin)
        patch_index = np.asarray(skin.patch_index)
        self.members = [
            np.flatnonzero(patch_index == n) for n in range(len(skin.patches))
        ]
        self.watch = fresh_watch(skin.count)
        self.code = np.full(skin.count, -1)
        self.since = np.zeros(skin.count)
        self.seen = np.full(skin.count, NEVER)
        self.mask = np.zeros(skin.count, bool)
        self.faults: tuple[Fault, ...] = ()
        self.first: int | None = None
        self.last: int | None = None
        self.checked = NEVER

    def push(
        self, scan: Scan, pressure: Float[np.ndarray, "taxel"]
    ) -> tuple[Bool[np.ndarray, "taxel"], tuple[Fault, ...]]:
        """Look at the next scan and its calibrated pressure [kPa].

        Returns:
            Which taxels are faulty, and the faults; a row's is listed once.
        """
        check_order(self.last, scan.stamp)
        if self.first is None:
            self.first = scan.stamp
        self.last = scan.stamp
        now = (scan.stamp - self.first) / NS_PER_S
        self.mask = self.mask.copy()
        watch_counts(
            scan.counts,
            scan.received,
            now,
            self.full_scale,
            self.config.silence_seconds,
            self.config.saturated_seconds,
            self.jump,
            self.watch,
            self.mask,
        )
        if now - self.checked >= self.config.check_seconds - 1e-6:
            self.check(scan, pressure, now)
        return self.mask, self.faults

    def check(
        self, scan: Scan, pressure: Float[np.ndarray, "taxel"], now: float
    ) -> None:
        """Weigh the evidence."""
        config, adjacency = self.config, self.adjacency
        elapsed = min(now - self.checked, MOST_ELAPSED)
        watch_neighbours(
            pressure,
            scan.received & ~self.mask,
            now,
            elapsed,
            config.pressed,
            config.pressed_share,
            adjacency.starts,
            adjacency.neighbours,
            self.watch,
        )
        self.update(now)
        self.checked = now
        self.mask = self.code >= 0
        heard = np.maximum(self.watch.heard, 0.0)
        begun = np.where(self.mask, self.since, heard) * NS_PER_S
        self.faults = tuple(
            self.lister.report(
                self.code,
                now - heard >= config.line_seconds,
                np.round(begun).astype(np.int64) + (self.first or 0),
            )
        )

    def update(self, now: float) -> None:
        """Give each taxel the code of its fault, or -1."""
        watch = self.watch
        zero = watch.level == 0
        still, gone = self.standing_still(), self.lines_at_zero()
        evidence = np.stack(
            [
                still & ~zero,
                (still & zero) | gone,
                watch.negative > self.checked,
                self.saturated(),
                self.noisy(),
            ]
        )
        begun = np.stack(
            [
                watch.changed,
                watch.changed,
                watch.negative,
                watch.below,
                watch.restless,
            ]
        )
        for code in range(len(evidence)):
            found = evidence[code] & (watch.heard > NEVER)
            new = found & (self.code != code)
            self.since[new] = np.maximum(begun[code], watch.first)[new]
            self.code[found] = code
            self.seen[found] = now
        self.code[now - self.seen > self.config.recover_seconds] = -1

    def standing_still(self) -> Bool[np.ndarray, "taxel"]:
        """Taxels whose counts do not change though others say that they should."""
        watch, config = self.watch, self.config
        age = watch.heard - watch.changed
        limit = np.full(self.skin.count, np.inf)
        for members in self.members:
            moving = members[
                (watch.level > 0)[members] & (watch.heard > NEVER)[members]
            ]
            if len(moving):
                ages = age[moving]
                middle = 3 * len(ages) // 4
                usual = np.partition(ages, middle)[middle]
                limit[members] = max(config.stuck_seconds, config.stuck_factor * usual)
        inside = (watch.level >= 0) & (watch.level < self.full_scale)
        patches = self.lister.patches
        offset = patches.flagged_share(self.has_offset()) >= config.offset_share
        possible = inside & ((watch.level > 0) | offset[patches.group_index])
        found = (possible & (age > limit)) | (
            inside & (watch.ignored >= config.ignored_seconds)
        )
        was = (self.code == STUCK) | (self.code == DEAD)
        return found | (was & inside & (age > config.recover_seconds / 2))

    def has_offset(self) -> Bool[np.ndarray, "taxel"]:
        """Taxels whose counts have been well above zero for long enough to know."""
        least = self.watch.least
        known = self.watch.nonzero - self.watch.first >= self.config.recover_seconds
        return (
            known & (least >= self.config.offset * self.full_scale) & np.isfinite(least)
        )

    def lines_at_zero(self) -> Bool[np.ndarray, "taxel"]:
        """Taxels of rows and columns all at zero, though none of them ever was."""
        watch = self.watch
        lost = (
            (watch.level == 0)
            & (watch.heard - watch.nonzero >= self.config.line_seconds)
            & self.has_offset()
        )
        result = np.zeros(self.skin.count, bool)
        for lines in (self.lister.rows, self.lister.columns):
            out = lines.all_flagged(lost) & (lines.sizes >= LEAST_LINE)
            result |= out[lines.group_index]
        return result

    def saturated(self) -> Bool[np.ndarray, "taxel"]:
        """Taxels at full scale for longer than anybody touches them."""
        watch, config = self.watch, self.config
        full = watch.level >= self.full_scale
        from_start = watch.below < watch.first
        length = watch.heard - np.where(from_start, watch.first, watch.below)
        limit = np.where(
            from_start, config.saturated_start_seconds, config.saturated_seconds
        )
        return full & ((length >= limit) | (self.code == SATURATED))

    def noisy(self) -> Bool[np.ndarray, "taxel"]:
        """Taxels that jump to and fro while their neighbours do not."""
        watch, config, adjacency = self.watch, self.config, self.adjacency
        restless = watch.heard - watch.turned <= PAUSE
        starts = adjacency.starts
        around = np.concatenate([[0], np.cumsum(restless[adjacency.neighbours])])
        share = np.diff(around[starts]) / np.maximum(np.diff(starts), 1)
        long = watch.turned - watch.restless >= config.noisy_seconds
        return restless & long & ((share < COMPANY) | (self.code == NOISY))


def fresh_watch(count: int) -> Watch:
    """The memory of a skin never heard."""
    never = np.full(count, NEVER)
    return Watch(
        level=np.zeros(count, np.int64),
        first=np.full(count, np.inf),
        heard=never.copy(),
        changed=never.copy(),
        negative=never.copy(),
        below=never.copy(),
        nonzero=never.copy(),
        zero=never.copy(),
        least=np.full(count, np.inf),
        quiet=never.copy(),
        ignored=np.zeros(count),
        jump=np.zeros(count),
        turned=never.copy(),
        restless=never.copy(),
    )
