"""This module runs a recogniser on a simulated skin, whose scans may be corrupted."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from eskin.learn.events.matching import ScoredStream, build_events
from eskin.live import Detection, Model, Recognizer
from eskin.recording import TruthRecord
from eskin.sim.interactive import InteractiveSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S

GESTURES = ("poke", "double_pat", "grab", "stroke")
QUIET = 2.0
"""Time without touch at the start [s]."""

Path = Callable[[float], Float[np.ndarray, "joint"]]


@dataclass
class RunRecord:
    """Holds the touches of one skin and what was detected."""

    truths: list[TruthRecord] = field(default_factory=list)
    detections: list[Detection] = field(default_factory=list)
    scans: list[float] = field(default_factory=list)
    """Processor time of each scan [s]."""


class Run:
    """Runs one skin with a recogniser, and collects the results."""

    def __init__(
        self,
        live: InteractiveSkin,
        model: Model,
        path: Path,
        corrupt: Callable[[Scan], Scan] = lambda scan: scan,
    ) -> None:
        """Wait until the skin is tared; every scan is corrupted by a function."""
        self.live, self.path, self.corrupt = live, path, corrupt
        self.recognizer = Recognizer(model, live.mounted, live.calibration)
        self.time, self.record = 0.0, RunRecord()
        self.wait(QUIET)

    def scan(self) -> None:
        """Simulate and recognise one reading."""
        self.time += self.live.period
        q = self.path(self.time)
        begun = time.thread_time()
        scan = self.corrupt(self.live.scan(round(self.time * NS_PER_S), q))
        self.record.scans.append(time.thread_time() - begun)
        self.record.truths += self.live.hand.truths()
        self.record.detections += self.recognizer.push(scan)

    def wait(self, seconds: float) -> None:
        """Simulate a span of time [s]."""
        for _ in range(round(seconds / self.live.period)):
            self.scan()

    def finish(self) -> None:
        """Simulate until the last touch is over."""
        while self.live.hand.touching:
            self.scan()

    def take(self) -> ScoredStream:
        """Return the results for scoring."""
        self.record.detections += self.recognizer.finish()
        events = sorted(build_events(self.record.truths), key=lambda e: e.onset)
        person = self.live.hand.person.name
        return ScoredStream(tuple(events), self.record.detections, self.time, person)


def stand_still(q: Float[np.ndarray, "joint"], live: InteractiveSkin) -> Path:
    """Return the motion of an arm that stands still."""
    return lambda seconds: q
