"""This module monitors whether the skin can be relied on, and unrecognised touches."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.command.command_map import NON_GESTURES
from eskin.live import Detection
from eskin.skin import Skin
from eskin.stream import RecognitionState
from eskin.touch import TouchRecord
from eskin.units import NS_PER_S

UNDER_HAND = 0.2
"""Time before a patch went out in which a contact on it counts as one under it [s]."""


@dataclass(frozen=True)
class SkinMonitorConfig:
    """Limits beyond which the arm is slowed, paused or held because of its skin."""

    max_age: float = 0.1
    """Age from which a reading or a touch is stale [s]."""

    max_silence: float = 0.11
    """Age of a patch's newest data from which the patch is out [s]: at 50 readings a
    second, three may be lost in a row."""

    min_valid: float = 0.25
    """Share of a patch's taxels that must be valid; with fewer it sends no data."""

    max_out_share: float = 0.25
    """Share of the skin's taxels that may be on patches that are out; with more the
    arm is held at once."""

    max_out_seconds: float = 0.5
    """Age of a patch's newest data from which the arm is held, where a hand on the
    patch could be missed [s]; before, it is slowed, or stands if a hand was on it."""

    hand: float = 0.04
    """Distance from a working taxel up to which a hand is felt [m]; half the width of
    a palm."""

    clear_seconds: float = 2.0
    """Time without a reason after which the arm is no longer slowed [s]."""

    max_force: float = 40.0
    """Force of an unrecognised touch above which a moving arm is held [N]."""

    max_seconds: float = 2.0
    """Duration of an unrecognised touch above which a moving arm stands until the touch
    is recognised or has ended [s]."""

    pause_seconds: float = 5.0
    """Duration of an unrecognised touch above which such an arm is paused [s]."""

    light_force: float = 2.0
    """Force up to which a touch is light [N]."""

    light_seconds: float = 10.0
    """Time for which a touch is light without interruption after which it lasts: it
    slows the arm, but neither pauses it nor keeps it from being resumed [s]."""


@dataclass(frozen=True)
class UnrecognisedTouch:
    """An unrecognised touch is too strong or too long for a moving arm to go on."""

    touch: int
    """Id of the touch."""

    effect: Literal["hold", "pause", "wait"]
    """What it does to a moving arm."""

    reason: str
    """Description with its force or duration."""


@final
class SkinMonitor:
    """A skin monitor keeps the age of readings, failed patches and recognised touches.

    Attributes:
        latest: stamp of the latest reading [ns since the epoch].
        last_valid: stamp of the latest reading with data of each patch [ns].
        last_touched: stamp of the latest contact on each patch [ns]; 0 before one.
        faulty_patches: ids of patches that are faulty as a whole.
        last_contact: time of the last contact anywhere, but for those of touches that
            last [ns since the epoch].
        lasting: patch of each touch that lasts, by its id.
        touches: onset [ns since the epoch] and patch of each touch, by its id.
    """

    def __init__(self, skin: Skin, config: SkinMonitorConfig, now: int) -> None:
        """Start with a working skin, read at a time [ns since the epoch]."""
        self.config = config
        self.patches = tuple(patch.id for patch in skin.patches)
        self.links = np.array([patch.link for patch in skin.patches])
        self.patch_index = np.asarray(skin.patch_index)
        self.positions = np.asarray(skin.positions)
        self.sizes = np.bincount(self.patch_index, minlength=len(self.patches))
        self.least_valid = np.maximum(1, np.ceil(config.min_valid * self.sizes))
        self.latest = now
        self.last_contact = now
        self.last_valid = np.full(len(self.patches), now, np.int64)
        self.last_touched = np.zeros(len(self.patches), np.int64)
        self.faulty_patches: frozenset[str] = frozenset()
        self.recognised: set[int] = set()
        self.light_since: dict[int, int] = {}
        self.lasting: dict[int, str] = {}
        self.touches: dict[int, tuple[int, str]] = {}
        self.closed: tuple[int, ...] = ()
        self.reach: dict[tuple[int, ...], np.ndarray] = {}

    def update(self, recognition: RecognitionState) -> None:
        """Update from the next recognition state."""
        state = recognition.state
        self.latest = stamp = state.reading.stamp
        self.faulty_patches = frozenset(
            fault.patch for fault in state.faults if fault.kind == "patch"
        )
        valid = np.bincount(
            self.patch_index[state.reading.valid], minlength=len(self.patches)
        )
        has_data = valid >= self.least_valid
        if self.faulty_patches:
            has_data &= ~np.isin(self.patches, list(self.faulty_patches))
        self.last_valid[has_data] = stamp
        for touch in self.closed:
            self.touches.pop(touch, None)
        self.closed = tuple(touch.id for touch in state.closed)
        for touch in state.closed:
            self.recognised.discard(touch.id)
            self.light_since.pop(touch.id, None)
            self.lasting.pop(touch.id, None)
        if state.open:
            for row in state.rows:
                if row.confirmed and not row.closed and row.last == stamp:
                    patch = state.records.contacts[row.contact]["patch"]
                    self.update_touch(row, int(patch))

    def update_touch(self, row: TouchRecord, patch: int) -> None:
        """Update from a touch that is in contact, and the index of its patch."""
        self.last_touched[patch] = self.latest
        self.touches[row.id] = row.onset, self.patches[patch]
        if row.force > self.config.light_force:
            self.light_since[row.id] = self.latest
        since = self.light_since.setdefault(row.id, self.latest)
        seconds = (self.latest - since) / NS_PER_S
        if seconds <= self.config.light_seconds:
            self.lasting.pop(row.id, None)
            self.last_contact = self.latest
        else:
            self.lasting[row.id] = self.patches[patch]

    def find_touch(self, touch: int | None) -> tuple[int | None, str | None]:
        """Return onset [ns since the epoch] and patch of a touch, None if unknown."""
        return (None, None) if touch is None else self.touches.get(touch, (None, None))

    def find_latest_onset(self, touch: int) -> int | None:
        """Return the latest onset of the other open touches [ns since the epoch].

        None where no other touch is open, but for those that last.
        """
        ended = {touch, *self.lasting, *self.closed}
        others = [onset for i, (onset, _) in self.touches.items() if i not in ended]
        return max(others, default=None)

    def add_detection(self, detection: Detection) -> None:
        """Note that a touch was recognised as a gesture."""
        if detection.gesture not in NON_GESTURES:
            self.recognised.add(detection.touch)

    def has_data(self, patch: str) -> bool:
        """Return whether the latest reading has data of a patch."""
        return bool(self.last_valid[self.patches.index(patch)] == self.latest)

    def is_out(self, patch: str, now: int) -> bool:
        """Return whether a patch is out at a time [ns since the epoch]."""
        return self.patches.index(patch) in self.find_out(now)

    def find_out(self, now: int) -> tuple[int, ...]:
        """Return the indices of patches that are out: without data for too long."""
        oldest = now - round(self.config.max_silence * NS_PER_S)
        return tuple(np.flatnonzero(self.last_valid < oldest).tolist())

    def find_problem(self, now: int) -> str | None:
        """Return why the arm is held at a time, or None where it is not.

        The skin is stale; or patches are out that are a large share of it; or one is
        out for too long that a hand was on, or on which a hand could be missed.
        """
        age = (now - self.latest) / NS_PER_S
        if age > self.config.max_age:
            return f"stale skin: no reading for {1e3 * age:.0f} ms"
        out = self.find_out(now)
        if not out:
            return None
        share = self.sizes[list(out)].sum() / self.sizes.sum()
        if share > self.config.max_out_share:
            return f"broken skin: {self.name(out)} out, {share:.0%} of the taxels"
        for index in out:
            silence = (now - self.last_valid[index]) / NS_PER_S
            if silence > self.config.max_out_seconds and (
                self.is_under_hand(index) or self.misses_hand(index, out)
            ):
                return f"broken skin: {self.name((index,))} out"
        return None

    def is_hand_lost(self, now: int) -> bool:
        """Return whether a patch is out that a hand was on when it went out."""
        return any(map(self.is_under_hand, self.find_out(now)))

    def find_slowing(self, now: int) -> str | None:
        """Return why the arm may only go slowly at a time, or None where it may."""
        if out := self.find_out(now):
            return f"broken skin: {self.name(out)} out"
        for patch in self.lasting.values():
            return (
                f"a light touch on patch '{patch}' lasts for more than "
                f"{self.config.light_seconds:g} s"
            )
        return None

    def name(self, out: tuple[int, ...]) -> str:
        """Return the names of patches that are out, with a verb."""
        names = ", ".join(f"'{self.patches[index]}'" for index in out)
        return f"patch {names} is" if len(out) == 1 else f"patches {names} are"

    def is_under_hand(self, index: int) -> bool:
        """Return whether a patch was touched when it went out."""
        limit = self.last_valid[index] - round(UNDER_HAND * NS_PER_S)
        return bool(self.last_touched[index] >= max(limit, 1))

    def misses_hand(self, index: int, out: tuple[int, ...]) -> bool:
        """Return whether a hand on a patch could be felt by no working taxel.

        Args:
            index: the patch.
            out: all patches that are out.
        """
        if out not in self.reach:
            self.reach = {out: self.compute_reach(out)}
        return bool(self.reach[out][index] > self.config.hand)

    def compute_reach(self, out: tuple[int, ...]) -> Float[np.ndarray, "patch"]:
        """Compute how far taxels of each patch that is out are from working ones [m].

        It is the largest distance of a taxel to the nearest working one of its link.
        """
        reach = np.zeros(len(self.patches))
        broken = np.isin(self.patch_index, out)
        for index in out:
            beside = (self.links == self.links[index])[self.patch_index] & ~broken
            if not beside.any():
                reach[index] = np.inf
                continue
            ours, others = self.positions[self.patch_index == index], beside
            gaps = ours[:, None] - self.positions[others][None]
            reach[index] = np.linalg.norm(gaps, axis=2).min(axis=1).max()
        return reach

    def find_unrecognised(
        self, recognition: RecognitionState
    ) -> UnrecognisedTouch | None:
        """Find the strong or longest touch that was not recognised; None if none is."""
        state, config = recognition.state, self.config
        longest: UnrecognisedTouch | None = None
        most = config.max_seconds
        if not state.open:
            return None
        for row in state.rows:
            if row.closed or not row.confirmed or row.last < self.latest:
                continue
            if row.id in self.recognised:
                continue
            seconds = (self.latest - row.onset) / NS_PER_S
            if row.force > config.max_force:
                reason = f"unrecognised touch of {row.force:.0f} N"
                return UnrecognisedTouch(row.id, "hold", reason)
            if seconds > most and row.id not in self.lasting:
                reason, most = f"unrecognised touch for {seconds:.1f} s", seconds
                effect = "pause" if seconds > config.pause_seconds else "wait"
                longest = UnrecognisedTouch(row.id, effect, reason)
        return longest
