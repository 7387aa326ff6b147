"""This module monitors whether the skin can be relied on, and unrecognised touches."""

from dataclasses import dataclass
from typing import final

import numpy as np

from eskin.command.command_map import NON_GESTURES
from eskin.live import Detection
from eskin.skin import Skin
from eskin.stream import RecognitionState
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class SkinMonitorConfig:
    """Limits beyond which the arm is held because of its skin."""

    max_age: float = 0.1
    """Age from which a reading or a touch is stale [s]."""

    max_silence: float = 0.11
    """Age of a patch's newest data from which the patch is out [s]: at 50 readings a
    second, three may be lost in a row."""

    min_valid: float = 0.25
    """Share of a patch's taxels that must be valid; with fewer it sends no data."""

    max_force: float = 40.0
    """Force of an unrecognised touch above which a moving arm is held [N]."""

    max_seconds: float = 2.0
    """How long an unrecognised touch may last on a moving arm [s]."""


@final
class SkinMonitor:
    """A skin monitor keeps the age of readings, failed patches and recognised touches.

    Attributes:
        latest: stamp of the latest reading [ns since the epoch].
        last_valid: stamp of the latest reading with data of each patch [ns].
        faulty_patches: ids of patches that are faulty as a whole.
        last_contact: time of the last contact anywhere [ns since the epoch].
    """

    def __init__(self, skin: Skin, config: SkinMonitorConfig, now: int) -> None:
        """Start with a working skin, read at a time [ns since the epoch]."""
        self.config = config
        self.patches = tuple(patch.id for patch in skin.patches)
        self.patch_index = np.asarray(skin.patch_index)
        sizes = np.bincount(self.patch_index, minlength=len(self.patches))
        self.least_valid = np.maximum(1, np.ceil(config.min_valid * sizes))
        self.latest = now
        self.last_contact = now
        self.last_valid = np.full(len(self.patches), now, np.int64)
        self.faulty_patches: frozenset[str] = frozenset()
        self.recognised: set[int] = set()

    def update(self, recognition: RecognitionState) -> None:
        """Update from the next recognition state."""
        state = recognition.state
        self.latest = stamp = state.reading.stamp
        valid = np.bincount(
            self.patch_index[state.reading.valid], minlength=len(self.patches)
        )
        self.last_valid[valid >= self.least_valid] = stamp
        self.faulty_patches = frozenset(
            fault.patch for fault in state.faults if fault.kind == "patch"
        )
        if any(touch.last == stamp for touch in state.open):
            self.last_contact = stamp
        for touch in state.closed:
            self.recognised.discard(touch.id)

    def add_detection(self, detection: Detection) -> None:
        """Note that a touch was recognised as a gesture."""
        if detection.gesture not in NON_GESTURES:
            self.recognised.add(detection.touch)

    def has_data(self, patch: str) -> bool:
        """Return whether the latest reading has data of a patch."""
        return bool(self.last_valid[self.patches.index(patch)] == self.latest)

    def find_failed(self, now: int) -> tuple[str, ...]:
        """Return the ids of patches that are faulty, or without data for too long."""
        oldest = now - round(self.config.max_silence * NS_PER_S)
        silent = self.last_valid < oldest
        if not (self.faulty_patches or silent.any()):
            return ()
        return tuple(
            name
            for name, is_silent in zip(self.patches, silent, strict=True)
            if is_silent or name in self.faulty_patches
        )

    def find_problem(self, now: int) -> str | None:
        """Return why the skin cannot be relied on at a time, or None where it can."""
        age = (now - self.latest) / NS_PER_S
        if age > self.config.max_age:
            return f"stale skin: no reading for {1e3 * age:.0f} ms"
        failed = self.find_failed(now)
        return f"broken skin: patch '{failed[0]}' is out" if failed else None

    def find_unrecognised(self, recognition: RecognitionState) -> str | None:
        """Describe a strong or long touch that was not recognised; None if none is."""
        state = recognition.state
        if not state.open:
            return None
        for row in state.rows:
            if row.closed or not row.confirmed or row.last < self.latest:
                continue
            if row.id in self.recognised:
                continue
            seconds = (self.latest - row.onset) / NS_PER_S
            if row.force > self.config.max_force:
                return f"unrecognised touch of {row.force:.0f} N"
            if seconds > self.config.max_seconds:
                return f"unrecognised touch for {seconds:.1f} s"
        return None
