"""This module judges whether a touch can be a fault of the skin."""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Bool, Int

from eskin.skin import Skin
from eskin.stream import RecognitionState
from eskin.touch import Adjacency, ContactConfig
from eskin.touch.fault_kernels import LINE_SHARE
from eskin.touch.outage_kernels import MAX_PRESSED, NEARLY_ALL
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class EvidenceConfig:
    """Limits say how much of a touch one fault of the skin may explain."""

    strong: float = 2.0
    """Pressure on a taxel that a touch needs, in units of that at which contact begins,
    or of 0.7 kPa where contact begins below."""

    share: float = LINE_SHARE
    """Share of a row or column that is active when a fault of it may explain the touch,
    and share of the taxels of a touch that are doubtful when nothing of it counts."""

    together: float = 0.1
    """Longest time between the moments from which two fingers press strongly, and for
    which one reading counts [s]."""

    slide: float = 0.5
    """Longest time for which a taxel that a fingertip has slid over counts [s]."""

    seconds: float = 0.07
    """Time for which a touch must be in contact, in all contacts together [s]; of 476
    simulated double pats 9 were shorter, and 5 of 11 accidents taken for one."""

    readings: int = 2
    """Number of readings that no fault explains."""

    keep: float = 3.0
    """How long the evidence of a touch, and the activity of a taxel, is kept [s]."""


Pairs = Int[np.ndarray, "2 pair"]
Taxels = Bool[np.ndarray, "taxel"]
NEVER = 2.0
"""Share that no row, column or patch reaches."""
KEPT = 16
"""Number of plausible readings of a touch that are kept, the latest ones."""


@dataclass
class Evidence:
    """Evidence holds what a touch has pressed, and its latest plausible readings."""

    felt: Taxels
    """Taxels that it has pressed, also those that are doubtful."""
    full: Bool[np.ndarray, "line"]
    """Rows and columns of which a large share was active meanwhile."""
    readings: list[tuple[Pairs, int]] = field(default_factory=list)
    """The pairs of taxels of each that no fault explains, and how many it needs."""
    last: int = 0
    """Stamp of the latest contact [ns since the epoch]."""
    broad: int = 0
    """Stamp of the latest reading with several taxels pressed [ns since the epoch]."""
    seconds: float = 0.0
    """Time in contact [s]."""


def number_lines(skin: Skin) -> Int[np.ndarray, "3 taxel"]:
    """Return the numbers of the row, the column and the patch of each taxel.

    No row, column or patch has the number of another one.
    """
    patches = np.asarray(skin.patch_index)
    lines: list[np.ndarray] = []
    for numbers in (np.asarray(skin.rows), np.asarray(skin.columns), 0 * patches):
        keys = patches * (numbers.max(initial=0) + 1) + numbers
        index = np.unique(keys, return_inverse=True)[1]
        lines.append(index + (lines[-1].max() + 1 if lines else 0))
    return np.stack(lines)


@final
class EvidenceMonitor:
    """A monitor collects of every touch what no single fault of the skin explains.

    A fault may be one taxel, one row, one column or one patch. So a touch needs two
    taxels side by side, one of them strongly pressed, that do not lie in one row,
    column or patch that a fault may have made active: where a large share of it is
    active, or a taxel in it that is not of the touch, or doubtful.

    In place of these, the touch of a fingertip may have slid over two pairs of taxels
    side by side, and two fingers may press two taxels of different rows and columns
    from the same moment, of which one lies beside a taxel that the touch has felt.

    Doubtful taxels do not count, also in the readings before they became so.
    """

    def __init__(self, skin: Skin, config: EvidenceConfig) -> None:
        """Start without touches."""
        self.config = config
        self.starts, self.neighbours, _ = Adjacency.build(skin)
        self.lines = number_lines(skin)
        self.sizes = np.bincount(self.lines.ravel())
        self.is_line = np.arange(len(self.sizes)) < self.lines[2].min()
        self.shares = np.where(self.is_line, config.share, NEARLY_ALL)
        self.shares[~self.is_line & (self.sizes <= MAX_PRESSED)] = NEVER
        self.doubtful = self.strong = np.zeros(skin.count, bool)
        self.active_at = np.full(skin.count, np.iinfo(np.int64).min)
        self.strong_since = np.zeros(skin.count, np.int64)
        self.stamp = 0
        self.touches: dict[int, Evidence] = {}

    def update(self, recognition: RecognitionState) -> None:
        """Update the evidence by the next recognition state."""
        state, config = recognition.state, self.config
        reading, stamp = state.reading, state.reading.stamp
        before, self.stamp = self.stamp or stamp, stamp
        least = max(state.contact, ContactConfig.on)
        active = reading.pressure >= least
        self.active_at[active] = stamp
        self.doubtful = state.doubtful
        if not state.open and not self.touches:
            return
        strong = reading.pressure >= config.strong * least
        self.strong_since[strong & ~self.strong] = stamp
        self.strong = np.where(reading.valid, strong, self.strong)
        for touch in state.closed:
            if touch.merged_into and touch.id in self.touches:
                self.merge(self.touches.pop(touch.id), touch.merged_into)
        pressed = [row for row in state.rows if row.last == stamp and not row.closed]
        if pressed:
            valid = reading.valid & ~state.doubtful
            counts = self.count(active)
            sizes = self.sizes - self.count(~reading.valid)
            full = counts > self.shares * sizes
            interval = min((stamp - before) / NS_PER_S, config.together)
            for row in pressed:
                taxels = row.taxels
                if row.id not in self.touches:
                    self.touches[row.id] = self.begin()
                evidence = self.touches[row.id]
                evidence.last, evidence.seconds = stamp, evidence.seconds + interval
                evidence.felt[taxels] |= active[taxels]
                now = np.zeros_like(active)
                now[taxels] = active[taxels] & valid[taxels]
                own = self.count(now)
                evidence.full |= (own > self.shares * sizes) & self.is_line
                mixed = (counts > own) & self.is_line
                explained = full | mixed | evidence.full
                self.update_touch(evidence, now, strong & now, valid, explained)
        limit = stamp - config.keep * NS_PER_S
        self.touches = {i: one for i, one in self.touches.items() if one.last >= limit}

    def begin(self) -> Evidence:
        """Return the evidence of a touch that has pressed nothing."""
        count, lines = len(self.doubtful), len(self.sizes)
        return Evidence(np.zeros(count, bool), np.zeros(lines, bool))

    def merge(self, ended: Evidence, heir: int) -> None:
        """Let a touch have the evidence of one that merged into it, if that is more."""
        evidence = self.touches.setdefault(heir, ended)
        evidence.felt |= ended.felt
        evidence.full |= ended.full
        evidence.readings = max(evidence.readings, ended.readings, key=len)
        evidence.seconds = max(evidence.seconds, ended.seconds)

    def is_plausible(self, touch: int) -> bool:
        """Return whether a touch is no fault."""
        evidence, config = self.touches.get(touch), self.config
        if evidence is None or evidence.seconds < config.seconds:
            return False
        doubted, felt = self.doubtful & evidence.felt, evidence.felt
        if np.count_nonzero(doubted) >= config.share * np.count_nonzero(felt):
            return False
        lately = self.active_at >= self.stamp - config.keep * NS_PER_S
        known = self.count(self.doubtful & lately)
        explained = evidence.full | (2 * known > self.shares * self.sizes)
        left = [
            np.count_nonzero(self.is_left(pairs, explained)) >= least
            for pairs, least in evidence.readings
        ]
        return bool(sum(left) >= config.readings)

    def update_touch(
        self,
        evidence: Evidence,
        now: Taxels,
        strong: Taxels,
        valid: Taxels,
        explained: Bool[np.ndarray, "line"],
    ) -> None:
        """Add the pairs of a reading to the evidence of a touch that is in contact.

        Args:
            evidence: evidence of the touch.
            now: taxels that it presses and that can be believed.
            strong: those of them that it presses strongly.
            valid: taxels that can be believed.
            explained: rows, columns and patches that a fault may have made active.
        """
        if not strong.any():
            return
        least = 1
        if np.count_nonzero(now) > 1:
            evidence.broad = self.stamp
            pairs = self.list_pairs(strong, now)
        else:
            since = max(self.stamp - self.config.slide * NS_PER_S, evidence.broad + 1)
            slid = evidence.felt & valid & (self.active_at >= since)
            pairs, least = self.list_pairs(slid, slid), 2
            pairs = pairs[:, pairs[0] < pairs[1]]
        pairs = pairs[:, self.is_left(pairs, explained)]
        if not pairs.size:
            pairs = self.list_fingers(strong, evidence.felt & valid)
            pairs = pairs[:, self.is_left(pairs, explained | self.is_line)]
        if pairs.shape[1] >= least:
            evidence.readings = [*evidence.readings[1 - KEPT :], (pairs, least)]

    def list_pairs(self, taxels: Taxels, others: Taxels) -> Pairs:
        """Return the pairs of some taxels and of others that lie beside them."""
        some = np.flatnonzero(taxels)
        starts, sizes = self.starts[some], self.starts[some + 1] - self.starts[some]
        places = np.repeat(starts + sizes - np.cumsum(sizes), sizes)
        beside = self.neighbours[places + np.arange(len(places))]
        return np.stack([np.repeat(some, sizes), beside])[:, others[beside]]

    def list_fingers(self, strong: Taxels, felt: Taxels) -> Pairs:
        """Return pairs of taxels that are strongly pressed since about one moment.

        Beside the first one of each lies a taxel that the touch has felt.
        """
        rooted = np.unique(self.list_pairs(strong, felt)[0])
        pairs = np.stack(np.meshgrid(rooted, np.flatnonzero(strong))).reshape(2, -1)
        since = self.strong_since[pairs]
        longest = self.config.together * NS_PER_S
        return pairs[:, np.abs(since[0] - since[1]) <= longest]

    def is_left(
        self, pairs: Pairs, explained: Bool[np.ndarray, "line"]
    ) -> Bool[np.ndarray, "pair"]:
        """Tell which pairs are sound and do not lie in one line that is explained."""
        lines, others = self.lines[:, pairs[0]], self.lines[:, pairs[1]]
        hidden = ((lines == others) & explained[lines]).any(axis=0)
        return ~hidden & ~self.doubtful[pairs].any(axis=0)

    def count(self, taxels: Taxels) -> Int[np.ndarray, "line"]:
        """Return how many of some taxels lie in each row, column and patch."""
        lines = self.lines[:, np.flatnonzero(taxels)]
        return np.bincount(lines.ravel(), minlength=len(self.sizes))
