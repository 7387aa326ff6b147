"""This module judges whether a touch can be a fault of the skin."""

from collections.abc import Iterator, Set
from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Bool, Int

from eskin.skin import Skin
from eskin.stream import RecognitionState
from eskin.touch import Adjacency, TouchRecord, TouchState
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class EvidenceConfig:
    """Limits define how much of a touch must be sound, so that no fault explains it."""

    strong: float = 1.4
    """Pressure on one taxel that a touch needs [kPa]; twice the pressure at which
    contact begins. Where contact begins at more than `weak`, both rise with it."""

    weak: float = 0.7
    """Pressure on a taxel beside it that supports it [kPa]."""

    together: float = 0.1
    """Longest time between the moments from which two taxels that do not lie beside
    each other, as of two fingers, are strongly pressed [s]."""

    fingers: int = 20
    """Largest number of strongly pressed taxels that may be of separate fingers."""

    line_share: float = 0.34
    """Share of a row or column that may be pressed for two of its taxels to count."""

    doubted_share: float = 0.2
    """Share of a row or column that must be doubtful, and active lately, so that none
    of its taxels counts in the readings before."""

    readings: int = 2
    """Number of readings in which it needs all this."""

    path: int = 3
    """Number of neighbouring taxels that a fingertip has to press one after the other,
    within `path_seconds`, so that one of them counts as beside the next."""

    path_width: int = 2
    """Greatest number of taxels that the touch of such a fingertip presses at once."""

    path_seconds: float = 0.5
    """Time for which a pressed taxel belongs to that path [s]."""

    seconds: float = 0.07
    """Time for which it must be in contact, in all of its contacts together [s]; of 476
    simulated double pats 9 were shorter, and so were 5 of 11 accidents that were
    surely taken for one."""

    max_interval: float = 0.1
    """Longest time for which one reading counts [s]."""

    patch_share: float = 0.8
    """Share of a patch that must not be active at once: hum of a patch is."""

    min_patch: int = 12
    """Number of taxels of a patch from which that share counts."""

    keep_readings: int = 16
    """Number of sound readings of a touch that are kept, the latest ones."""

    keep_seconds: float = 3.0
    """How long after its last contact the evidence of a touch is kept [s]."""


@dataclass(frozen=True)
class PlausibleReading:
    """A sound reading holds the taxels of a touch that no fault explains."""

    pressed: Int[np.ndarray, "pressed"]
    """Taxels that were pressed and not doubtful, with those of the path to them."""
    strong: Int[np.ndarray, "strong"]
    """Those that were strongly pressed."""
    since: Int[np.ndarray, "strong"]
    """Stamps since when these were [ns since the epoch]."""
    full: Bool[np.ndarray, "line"]
    """Rows and columns of which two taxels do not support each other."""


@dataclass
class Evidence:
    """Evidence holds the readings in which a touch was sound."""

    readings: list[PlausibleReading]
    """The latest sound readings, without the taxels that became doubtful since."""
    last: int
    """Stamp of the latest contact [ns since the epoch]."""
    seconds: float = 0.0
    """Time in contact [s]."""
    felt: set[int] = field(default_factory=set)
    """Taxels that it has pressed, also those that are doubtful."""
    doubted: set[int] = field(default_factory=set)
    """Those that are or were doubtful."""
    strong: dict[int, int] = field(default_factory=dict)
    """Taxels that it presses strongly, each with the stamp since when it does [ns since
    the epoch]."""
    path: dict[int, int] = field(default_factory=dict)
    """Taxels that a fingertip has slid over lately, each with the stamp of its latest
    pressure [ns since the epoch]."""


def number_lines(skin: Skin) -> Int[np.ndarray, "2 taxel"]:
    """Return the number of the row of each taxel, and that of its column.

    No row, of any patch, has the number of another one or of a column.
    """
    patches = np.asarray(skin.patch_index)
    rows, columns = (
        np.unique(patches * (numbers.max(initial=0) + 1) + numbers, return_inverse=True)
        for numbers in (np.asarray(skin.rows), np.asarray(skin.columns))
    )
    return np.stack([rows[1], columns[1] + len(rows[0])])


@final
class EvidenceMonitor:
    """A monitor collects the evidence of every touch from its readings.

    In a sound reading, a taxel is strongly pressed, and a taxel beside it is pressed
    too, or was lately by a fingertip that slides from taxel to taxel; or another one,
    of another row and column, became strongly pressed at the same time, and the touch
    has felt a taxel beside one of the two. Two of one row or column support each other
    if a small part of it is pressed, all of it by the touch.

    Taxels that are doubtful, as faulty ones are, or of a patch that is active as a
    whole, do not count. When a taxel becomes doubtful, it no longer counts in the
    readings before. If the touch presses it, the two taxels must not both lie in its
    row or its column, and if several taxels of that line are doubtful and active, none
    of the line counts: a line that is not connected shows itself taxel by taxel.
    """

    def __init__(self, skin: Skin, config: EvidenceConfig) -> None:
        """Start without touches."""
        self.config = config
        self.adjacency = Adjacency.build(skin)
        self.patch_index = np.asarray(skin.patch_index)
        self.lines = number_lines(skin)
        self.line_sizes = np.bincount(self.lines.ravel())
        self.patch_count = len(skin.patches)
        self.doubtful = np.zeros(skin.count, bool)
        self.active_at = np.full(skin.count, np.iinfo(np.int64).min)
        self.stamp, self.factor = 0, 1.0
        self.touches: dict[int, Evidence] = {}

    def update(self, recognition: RecognitionState) -> None:
        """Update the evidence by the next recognition state."""
        state = recognition.state
        stamp = state.reading.stamp
        before = self.stamp or stamp
        self.stamp = stamp
        pressure = state.reading.pressure
        self.factor = max(1.0, state.contact / self.config.weak)
        active = pressure >= self.factor * self.config.weak
        self.active_at[active] = stamp
        is_idle = not state.open and not self.touches
        rows = [] if is_idle else state.rows
        pressed = [row for row in rows if row.last == stamp and not row.closed]
        for row in pressed:
            evidence = self.touches.setdefault(row.id, Evidence([], row.last))
            taxels = row.taxels
            felt = taxels[active[taxels]]
            evidence.felt.update(felt.tolist())
            doubted = set(felt[state.doubtful[felt]].tolist())
            if not doubted <= evidence.doubted:
                self.doubt(evidence, doubted)
        if state.doubtful is not self.doubtful:
            new = np.flatnonzero(state.doubtful & ~self.doubtful)
            self.doubtful = state.doubtful
            self.reset_doubted(new)
        for touch in state.closed:
            if touch.merged_into and touch.id in self.touches:
                self.merge(self.touches.pop(touch.id), touch.merged_into)
        if pressed:
            sound = self.find_valid(state, active)
            interval = min((stamp - before) / NS_PER_S, self.config.max_interval)
            for row in pressed:
                self.update_touch(row, state, sound, active)
                self.touches[row.id].seconds += interval
        limit = stamp - self.config.keep_seconds * NS_PER_S
        self.touches = {i: one for i, one in self.touches.items() if one.last >= limit}

    def merge(self, ended: Evidence, heir: int) -> None:
        """Let a touch have the evidence of one that merged into it, if that is more."""
        evidence = self.touches.get(heir)
        if evidence is None:
            self.touches[heir] = ended
            return
        evidence.felt |= ended.felt
        evidence.path = evidence.path or ended.path
        evidence.readings = max(evidence.readings, ended.readings, key=len)
        evidence.seconds = max(evidence.seconds, ended.seconds)
        self.doubt(evidence, ended.doubted)

    def is_plausible(self, touch: int) -> bool:
        """Return whether a touch is no fault."""
        evidence = self.touches.get(touch)
        if evidence is None or evidence.seconds < self.config.seconds:
            return False
        return len(evidence.readings) >= self.config.readings

    def reset_doubted(self, taxels: Int[np.ndarray, "doubted"]) -> None:
        """Take taxels that became doubtful out of the readings before.

        So are the lines of which a share is doubtful and active.
        """
        if not self.touches:
            return
        believed = np.ones(len(self.patch_index), bool)
        believed[taxels] = False
        limit = self.stamp - self.config.keep_seconds * NS_PER_S
        active = self.doubtful & (self.active_at >= limit)
        for taxel in taxels.tolist():
            for line in self.select_lines(taxel):
                if active[line].mean() >= self.config.doubted_share:
                    believed &= ~line
        doubted = set(taxels.tolist())
        lost = set(np.flatnonzero(~believed).tolist())
        for evidence in self.touches.values():
            evidence.doubted |= doubted & evidence.felt
            if not lost.isdisjoint(evidence.felt):
                self.reduce_evidence(evidence, believed)

    def doubt(self, evidence: Evidence, taxels: Set[int]) -> None:
        """Doubt what a touch has pressed, also in the readings before."""
        evidence.doubted |= taxels
        believed = np.ones(len(self.patch_index), bool)
        believed[list(evidence.doubted)] = False
        self.reduce_evidence(evidence, believed)

    def reduce_evidence(
        self, evidence: Evidence, believed: Bool[np.ndarray, "taxel"]
    ) -> None:
        """Keep what can be believed of the readings of a touch."""
        evidence.path = {i: at for i, at in evidence.path.items() if believed[i]}
        evidence.readings = [
            left
            for reading in evidence.readings
            if (left := self.reduce_reading(reading, believed, evidence))
        ]

    def reduce_reading(
        self,
        reading: PlausibleReading,
        believed: Bool[np.ndarray, "taxel"],
        evidence: Evidence,
    ) -> PlausibleReading | None:
        """Return what can be believed of a reading; None if that is not sound.

        Where less is believed, two taxels of one row or column are no support.
        """
        kept = believed[reading.strong]
        left = PlausibleReading(
            reading.pressed[believed[reading.pressed]],
            reading.strong[kept],
            reading.since[kept],
            reading.full | (not believed[reading.pressed].all()),
        )
        return left if self.is_sound(left, evidence) else None

    def update_touch(
        self,
        row: TouchRecord,
        state: TouchState,
        sound: Bool[np.ndarray, "taxel"],
        active: Bool[np.ndarray, "taxel"],
    ) -> None:
        """Update the evidence of a touch that is in contact.

        Args:
            row: record of the touch.
            state: contacts and touches of the reading.
            sound: which taxels can be believed.
            active: which taxels are pressed.
        """
        evidence = self.touches[row.id]
        evidence.last = row.last
        taxels = row.taxels
        pressed = taxels[sound[taxels] & active[taxels]]
        path = self.update_path(evidence, pressed)
        least = self.factor * self.config.strong
        strong = pressed[state.reading.pressure[pressed] >= least]
        self.update_strong(evidence, strong, state.reading.valid)
        if not len(strong):
            return
        since = np.array([evidence.strong[i] for i in strong.tolist()], dtype=np.int64)
        full = self.find_full_lines(pressed, active)
        reading = PlausibleReading(path, strong, since, full)
        if self.is_sound(reading, evidence):
            kept = evidence.readings[1 - self.config.keep_readings :]
            evidence.readings = [*kept, reading]

    def update_strong(
        self,
        evidence: Evidence,
        strong: Int[np.ndarray, "strong"],
        valid: Bool[np.ndarray, "taxel"],
    ) -> None:
        """Update since when a touch presses taxels strongly.

        One without valid data goes on as it was.
        """
        now = set(strong.tolist())
        since = {i: at for i, at in evidence.strong.items() if i in now or not valid[i]}
        evidence.strong = dict.fromkeys(now, self.stamp) | since

    def find_full_lines(
        self, pressed: Int[np.ndarray, "pressed"], active: Bool[np.ndarray, "taxel"]
    ) -> Bool[np.ndarray, "line"]:
        """Find rows and columns of which too much is pressed, or not by the touch.

        Args:
            pressed: taxels that the touch presses and that are not doubtful.
            active: which taxels of the skin are pressed.
        """
        count = len(self.line_sizes)
        touched, all_active = (
            np.bincount(self.lines[:, taxels].ravel(), minlength=count)
            for taxels in (pressed, np.flatnonzero(active))
        )
        most = self.config.line_share * self.line_sizes
        return (all_active > touched) | (all_active > most)

    def update_path(
        self, evidence: Evidence, pressed: Int[np.ndarray, "pressed"]
    ) -> Int[np.ndarray, "path"]:
        """Return pressed taxels, and those of the path that led to them if it counts.

        Args:
            evidence: evidence of the touch that presses them.
            pressed: taxels that are pressed now and not doubtful.
        """
        if len(pressed) > self.config.path_width:
            evidence.path = {}
            return pressed
        limit = self.stamp - self.config.path_seconds * NS_PER_S
        path = {i: at for i, at in evidence.path.items() if at >= limit}
        known, now = set(path), set(pressed.tolist())
        if not all(self.has_neighbour(taxel, known) for taxel in now - known):
            path = {}
        evidence.path = path | dict.fromkeys(now, self.stamp)
        if len(evidence.path) < self.config.path:
            return pressed
        return np.array(list(evidence.path), dtype=np.int64)

    def is_sound(self, reading: PlausibleReading, evidence: Evidence) -> bool:
        """Return whether a pressed taxel supports a strongly pressed one.

        Two that both lie in the rows, or both in the columns, of doubtful taxels that
        the touch has pressed are no support.
        """
        suspect = np.zeros(len(self.line_sizes), bool)
        suspect[self.lines[:, list(evidence.doubted)]] = True
        strong, others = self.list_pairs(reading.strong)
        pressed = np.zeros(len(self.patch_index), bool)
        pressed[reading.pressed] = True
        pairs = pressed[others]
        lines, other_lines = self.lines[:, strong[pairs]], self.lines[:, others[pairs]]
        hidden = (lines == other_lines) & reading.full[lines]
        hidden |= suspect[lines] & suspect[other_lines]
        if not hidden.any(axis=0).all():
            return True
        if len(reading.strong) > self.config.fingers:
            return False
        felt = np.isin(others, list(evidence.felt - evidence.doubted))
        anchored = np.isin(reading.strong, strong[felt])
        lines, since = self.lines[:, reading.strong], reading.since
        hidden = lines[:, :, None] == lines[:, None]
        hidden |= suspect[lines][:, :, None] & suspect[lines][:, None]
        together = np.abs(since[:, None] - since) <= self.config.together * NS_PER_S
        apart = together & ~hidden.any(axis=0)
        return bool(apart[anchored].any())

    def list_pairs(
        self, taxels: Int[np.ndarray, "some"]
    ) -> tuple[Int[np.ndarray, "pair"], Int[np.ndarray, "pair"]]:
        """Return each of some taxels as often as taxels lie beside it, and those."""
        lists = [self.list_neighbours(taxel) for taxel in taxels.tolist()]
        others = np.array([i for each in lists for i in each], dtype=np.int64)
        return np.repeat(taxels, [len(each) for each in lists]), others

    def has_neighbour(self, taxel: int, others: set[int]) -> bool:
        """Return whether a taxel lies beside one of some others."""
        return not others.isdisjoint(self.list_neighbours(taxel))

    def list_neighbours(self, taxel: int) -> list[int]:
        """Return the taxels beside one."""
        starts, neighbours = self.adjacency.starts, self.adjacency.neighbours
        return neighbours[starts[taxel] : starts[taxel + 1]].tolist()

    def select_lines(self, taxel: int) -> Iterator[Bool[np.ndarray, "taxel"]]:
        """Yield the taxels of the row of a taxel, then those of its column."""
        for numbers in self.lines:
            yield numbers == numbers[taxel]

    def find_valid(
        self, state: TouchState, active: Bool[np.ndarray, "taxel"]
    ) -> Bool[np.ndarray, "taxel"]:
        """Find the taxels whose pressure can be believed."""
        reading, config = state.reading, self.config
        count = self.patch_count
        sizes = np.bincount(self.patch_index[reading.valid], minlength=count)
        shares = np.bincount(self.patch_index[active], minlength=count)
        whole = (sizes >= config.min_patch) & (shares >= config.patch_share * sizes)
        return reading.valid & ~state.doubtful & ~whole[self.patch_index]
