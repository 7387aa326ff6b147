"""This module monitors the skin."""

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
    """When the arm is held because of its skin."""

    oldest: float = 0.1
    """Age from which a reading is stale, and a patch without data is out [s]."""

    force: float = 40.0
    """Of a touch that was not recognised, above which a moving arm is held [N]."""

    seconds: float = 2.0
    """How long a touch that was not recognised may last on a moving arm [s]."""


@final
class SkinMonitor:
    """Remembers when the skin was last heard, and what touches were recognised.

    Attributes:
        heard: stamp of the latest reading [ns since the epoch].
        out: ids of patches from which nothing can be believed.
        touching: when there was last contact anywhere [ns since the epoch].
    """

    def __init__(self, skin: Skin, config: SkinMonitorConfig, now: int) -> None:
        """Start with a skin in order, heard at a time [ns since the epoch]."""
        self.config = config
        self.patches = tuple(patch.id for patch in skin.patches)
        self.index = np.asarray(skin.patch_index)
        self.heard = now
        self.touching = now
        self.alive = np.full(len(self.patches), now, np.int64)
        self.out: tuple[str, ...] = ()
        self.recognised: set[int] = set()

    def push(self, moment: RecognitionState) -> None:
        """Take in the next moment."""
        state = moment.state
        self.heard = stamp = state.reading.stamp
        valid = np.bincount(self.index[state.reading.valid], minlength=len(self.alive))
        self.alive[valid > 0] = stamp
        silent = stamp - self.alive > self.config.oldest * NS_PER_S
        faulty = {fault.patch for fault in state.faults if fault.kind == "patch"}
        self.out = tuple(
            name
            for name, gone in zip(self.patches, silent, strict=True)
            if gone or name in faulty
        )
        if any(touch.last == stamp for touch in state.going):
            self.touching = stamp
        for touch in state.over:
            self.recognised.discard(touch.id)

    def recognise(self, detection: Detection) -> None:
        """Remember what was said of a touch."""
        if detection.gesture not in NON_GESTURES:
            self.recognised.add(detection.touch)

    def hears(self, patch: str) -> bool:
        """Whether the latest reading tells of a patch."""
        return bool(self.alive[self.patches.index(patch)] == self.heard)

    def trouble(self, now: int) -> str | None:
        """Why the skin cannot be relied on at a time; None where it can."""
        age = (now - self.heard) / NS_PER_S
        if age > self.config.oldest:
            return f"stale skin: no reading for {1e3 * age:.0f} ms"
        if self.out:
            return f"broken skin: patch '{self.out[0]}' is out"
        return None

    def unrecognised(self, moment: RecognitionState) -> str | None:
        """What is done to the skin that nobody understands; None where nothing is."""
        state = moment.state
        if not state.going:
            return None
        for row in state.rows:
            if row.closed or row.last < self.heard or row.id in self.recognised:
                continue
            seconds = (self.heard - row.onset) / NS_PER_S
            if row.force > self.config.force:
                return f"unrecognised touch of {row.force:.0f} N"
            if seconds > self.config.seconds:
                return f"unrecognised touch for {seconds:.1f} s"
        return None
