"""This module finds out whether counts rise under pressure, as they are taken to."""

from dataclasses import dataclass, field
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import Skin
from eskin.touch.fault_kernels import LINE
from eskin.touch.faults import Fault, FaultKind
from eskin.touch.outage_kernels import MAX_PRESSED
from eskin.touch.reading import Scan
from eskin.touch.taxels import Instant, TaxelPlaces
from eskin.units import seconds_between

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]


@final
class PolarityRule(NamedTuple):
    """The rule tells a touch from other moves of counts, and when enough is known."""

    period: float = 0.045
    """Shortest time between two scans that are looked at [s]."""
    track_seconds: float = 2.0
    """Time constant of tracking the level of untouched taxels [s]."""
    longest: float = 10.0
    """Time after which counts that have moved away are not expected to return [s]."""
    returned: float = 0.2
    """Share of the greatest move below which counts have returned."""
    one_way: float = 4.0
    """Least ratio of the counts that move one way to those that move the other way."""
    whole: float = 0.9
    """Share of the taxels of a patch that moves as a whole, which one of up to
    `MAX_PRESSED` taxels may do under a hand."""
    end: float = 0.01
    """Distance from either end of the scale, as a share of it, at which a taxel may be
    one whose line is lost."""
    beside: float = 0.25
    """Share of the counts from which a taxel may be touched by which another one moves
    the same way under a finger."""
    least_others: int = 3
    """Number of unmoved taxels of a patch whose median tells how it is at rest."""
    enough: int = 2
    """Number of touches under which counts rise, more than under which they fall, from
    which nothing is doubted any more."""


RULE = PolarityRule()


@dataclass
class Move:
    """A move of the counts of a patch away from their level, until they return."""

    since: int
    """Stamp at which it was seen first [ns]."""
    faulty: Flags
    """Which taxels of the patch were faulty then: a press the wrong way looks like a
    fault, which must not hide the rest of it."""
    scans: int = 0
    """Number of scans looked at."""
    most: Float[np.ndarray, "way"] = field(default_factory=lambda: np.zeros(2))
    """Greatest sums of the counts that moved down, and up."""
    taxels: Int[np.ndarray, "some"] = field(default_factory=lambda: np.zeros(0, int))
    """Taxels that have moved in the greater way when most did."""
    counts: Float[np.ndarray, "some"] = field(default_factory=lambda: np.zeros(0))
    """Their counts then."""
    is_alone: bool = False
    """Whether no other taxel moved the same way."""


@final
class PolarityDetector:
    """A detector tells when counts fall under pressure; stateful.

    A touch takes the counts of some taxels away from their level, one way, and back. So
    do neither a hand that lay on the skin at the start and lifts, nor drift, which do
    not return; nor the dip after a touch, which is less than the touch; nor a patch or
    line that is lost, which moves as a whole or to an end of the scale. A hand that
    lifts and lies down again takes counts to the level of the others, and back. A taxel
    that moves alone may jump: a second one must move so, too.

    Attributes:
        faults: the patch where it was seen first; empty while nothing is known.
    """

    def __init__(
        self,
        skin: Skin,
        places: TaxelPlaces,
        taxels: np.ndarray,
        way: FaultKind,
        full_scale: int,
        least: Values,
    ) -> None:
        """Start without any touch.

        Args:
            skin: the skin.
            places: places of its taxels.
            taxels: (taxel) `TAXEL`, whose margins are read.
            way: kind of the fault where counts fall.
            full_scale: counts at which the converter saturates.
            least: counts above rest from which a move of a taxel may be a touch.
        """
        self.skin = skin
        self.way: FaultKind = way
        self.full_scale = full_scale
        self.least = least
        self.patches = places.patches
        self.margin = taxels["margin"]
        # Not in `TAXEL`, since numpy reads an array by itself faster.
        self.level = np.full(skin.count, np.nan)
        self.moves: dict[int, Move] = {}
        self.alone: tuple[set[int], set[int]] = (set(), set())
        self.risen = 0
        self.last = -np.inf
        self.faults: tuple[Fault, ...] = ()

    def check_polarity(
        self, scan: Scan, instant: Instant, mask: Flags
    ) -> tuple[Fault, ...]:
        """Check the next scan.

        Args:
            scan: the scan.
            instant: its time.
            mask: taxels that are faulty.
        """
        elapsed = instant.now - self.last
        if self.risen >= RULE.enough or elapsed < RULE.period:
            return self.faults
        self.last = instant.now
        mask = mask.copy()
        for patch, move in self.moves.items():
            mask[self.patches.members(patch)] = move.faulty
        use = scan.received & ~mask & (scan.counts >= 0)
        new = use & np.isnan(self.level)
        self.level[new] = scan.counts[new]
        away = scan.counts - self.level
        moved = use & (np.abs(away) > self.margin)
        step = 1.0 - np.exp(-elapsed / RULE.track_seconds)
        self.level += np.where(use & ~moved, step * away, 0.0)
        if self.moves or moved.any():
            for patch in range(len(self.patches.sizes)):
                members = self.patches.members(patch)
                own = members[use[members]]
                if len(own) and (patch in self.moves or moved[own].any()):
                    move = Move(scan.stamp, mask[members])
                    self.moves.setdefault(patch, move)
                    self.follow(patch, own, scan, away)
        return self.faults

    def follow(
        self,
        patch: int,
        own: Int[np.ndarray, "own"],
        scan: Scan,
        away: Values,
    ) -> None:
        """Follow the move of a patch, and judge it when it ends.

        Args:
            patch: index of the patch.
            own: its taxels with data.
            scan: the scan.
            away: counts of all taxels from their level.
        """
        move = self.moves[patch]
        far = away[own]
        least = self.margin[own]
        sums = np.array([-far[far < -least].sum(), far[far > least].sum()])
        if sums.max() > move.most.max():
            far = -far if sums[0] > sums[1] else far
            move.taxels = own[far > least]
            move.counts = scan.counts[move.taxels].astype(np.float64)
            move.is_alone = bool(
                np.count_nonzero(far > RULE.beside * least) == 1 < len(own)
            )
        move.scans += bool(sums.any())
        move.most = np.maximum(move.most, sums)
        if not np.isin(move.taxels, own).all():
            # Nobody knows where a taxel without data is.
            del self.moves[patch]
        elif sums.sum() <= RULE.returned * move.most.max():
            del self.moves[patch]
            if self.is_touch(move, own):
                self.count(patch, move)
        elif seconds_between(move.since, scan.stamp) > RULE.longest:
            del self.moves[patch]
            self.level[own] = scan.counts[own]

    def is_touch(self, move: Move, own: Int[np.ndarray, "own"]) -> bool:
        """Tell whether a touch alone explains a move that has returned."""
        taxels = move.taxels
        counts = move.counts
        before = self.level[taxels]
        is_whole = len(taxels) >= RULE.whole * len(own)
        for numbers in (self.skin.rows, self.skin.columns):
            line = own[numbers[own] == numbers[taxels[0]]]
            is_line = len(own) > len(line) >= LINE.least
            if (
                is_line
                and len(taxels) >= RULE.whole * len(line)
                and np.isin(taxels, line).all()
            ):
                return False
        if (
            move.scans < 2
            or move.most.max() < RULE.one_way * move.most.min()
            or (np.abs(counts - before) < self.least[taxels]).all()
            or (is_whole and len(own) > MAX_PRESSED)
        ):
            return False
        end = RULE.end * self.full_scale
        if ((counts <= end) | (counts >= self.full_scale - end)).all():
            return False
        others = np.setdiff1d(own, taxels)
        if len(others) < RULE.least_others:
            return True
        usual = np.median(self.level[others])
        return bool(abs(counts.mean() - usual) > abs(before.mean() - usual))

    def count(self, patch: int, move: Move) -> None:
        """Count a touch, and update the fault."""
        falls = bool(move.most[0] > move.most[1])
        if move.is_alone:
            seen = self.alone[falls]
            taxel = int(move.taxels[0])
            is_new = taxel not in seen
            seen.add(taxel)
            if not is_new or len(seen) < 2:
                return
        self.risen += -1 if falls else 1
        if self.risen >= 0:
            self.faults = ()
        elif not self.faults:
            name = self.skin.patches[patch].id
            self.faults = (Fault(self.way, name, None, None, None, move.since),)
