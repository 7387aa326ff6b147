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
    """Age from which a reading is stale, and a patch without data is out [s]."""

    max_force: float = 40.0
    """Force of an unrecognised touch above which a moving arm is held [N]."""

    max_seconds: float = 2.0
    """How long an unrecognised touch may last on a moving arm [s]."""


@final
class SkinMonitor:
    """A skin monitor keeps the age of readings, failed patches and recognised touches.

    Attributes:
        latest: stamp of the latest reading [ns since the epoch].
        failed_patches: ids of patches from which nothing can be believed.
        last_contact: time of the last contact anywhere [ns since the epoch].
    """

    def __init__(self, skin: Skin, config: SkinMonitorConfig, now: int) -> None:
        """Start with a working skin, read at a time [ns since the epoch]."""
        self.config = config
        self.patches = tuple(patch.id for patch in skin.patches)
        self.patch_index = np.asarray(skin.patch_index)
        self.latest = now
        self.last_contact = now
        self.last_valid = np.full(len(self.patches), now, np.int64)
        self.failed_patches: tuple[str, ...] = ()
        self.recognised: set[int] = set()

    def update(self, recognition: RecognitionState) -> None:
        """Update from the next recognition state."""
        state = recognition.state
        self.latest = stamp = state.reading.stamp
        valid = np.bincount(
            self.patch_index[state.reading.valid], minlength=len(self.patches)
        )
        self.last_valid[valid > 0] = stamp
        silent = stamp - self.last_valid > self.config.max_age * NS_PER_S
        faulty = {fault.patch for fault in state.faults if fault.kind == "patch"}
        self.failed_patches = tuple(
            name
            for name, is_silent in zip(self.patches, silent, strict=True)
            if is_silent or name in faulty
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
        """Return whether the latest reading has valid taxels of a patch."""
        return bool(self.last_valid[self.patches.index(patch)] == self.latest)

    def find_problem(self, now: int) -> str | None:
        """Return why the skin cannot be relied on at a time, or None where it can."""
        age = (now - self.latest) / NS_PER_S
        if age > self.config.max_age:
            return f"stale skin: no reading for {1e3 * age:.0f} ms"
        if self.failed_patches:
            return f"broken skin: patch '{self.failed_patches[0]}' is out"
        return None

    def find_unrecognised(self, recognition: RecognitionState) -> str | None:
        """Describe a strong or long touch that was not recognised; None if none is."""
        state = recognition.state
        if not state.open:
            return None
        for row in state.rows:
            if row.closed or row.last < self.latest or row.id in self.recognised:
                continue
            seconds = (self.latest - row.onset) / NS_PER_S
            if row.force > self.config.max_force:
                return f"unrecognised touch of {row.force:.0f} N"
            if seconds > self.config.max_seconds:
                return f"unrecognised touch for {seconds:.1f} s"
        return None
