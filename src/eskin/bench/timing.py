"""Timing several things in turn, so that a noisy machine is noisy to all of them."""

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from eskin.bench.scene import Scene
from eskin.learn.baselines import BaselineStream, use_one_thread
from eskin.live import Recognizer
from eskin.model import load_model
from eskin.skin import MountedSkin

ROUNDS = 10
WARM_UP = 210
"""Steps of the engine that are not counted: its window of 2 s is full then."""

PATIENCE = 5.0
"""A baseline is timed no more steps than about so long takes [s]."""


@dataclass(frozen=True)
class Row:
    """What one step of one method takes."""

    name: str
    """`eskin` is the engine."""
    p50_ms: float
    p99_ms: float
    max_ms: float
    taxels: int
    active: int
    steps: int
    """How many were timed."""
    ratio: float
    """Median over the engine's at as many active taxels as were asked for."""

    def as_dict(self) -> dict[str, object]:
        """As JSON has it."""
        rounded: dict[str, object] = {
            "p50_ms": round(self.p50_ms, 4),
            "p99_ms": round(self.p99_ms, 4),
            "max_ms": round(self.max_ms, 4),
            "ratio": round(self.ratio, 3),
        }
        return {**asdict(self), **rounded}


class Subject(ABC):
    """Something that takes a step at each reading."""

    def __init__(self, name: str, mounted: MountedSkin, scene: Scene) -> None:
        """Name what is timed on a scene."""
        self.name = name
        self.taxels = mounted.skin.count
        self.active = len(scene.active)
        self.scene = scene

    @abstractmethod
    def run(self, count: int) -> list[float]:
        """Seconds that each of the next steps took, all of them with contact."""

    @abstractmethod
    def steps(self, wanted: int) -> int:
        """Warm up, and say how many steps are to be timed."""


@final
class EngineSubject(Subject):
    """`Recognizer.push` with the weights that come with eskin."""

    def __init__(self, name: str, mounted: MountedSkin, scene: Scene) -> None:
        """Start a recogniser."""
        super().__init__(name, mounted, scene)
        self.recognizer = Recognizer(load_model("ur5"), mounted, None)

    def run(self, count: int) -> list[float]:
        """Seconds that each step took, untouched ones only where none is touched."""
        found: list[float] = []
        push, clock = self.recognizer.push, time.perf_counter
        while len(found) < count:
            for instant in self.scene.instants(min(count - len(found), 100)):
                start = clock()
                push(instant.reading)
                seconds = clock() - start
                if instant.touched or not self.active:
                    found.append(seconds)
        return found

    def steps(self, wanted: int) -> int:
        """Warm up, and say how many steps are to be timed."""
        self.run(WARM_UP)
        return wanted


@final
class StreamSubject(Subject):
    """A baseline that answers at every reading."""

    def __init__(
        self, name: str, mounted: MountedSkin, scene: Scene, stream: BaselineStream
    ) -> None:
        """Take a baseline's stream."""
        super().__init__(name, mounted, scene)
        self.stream = stream

    def run(self, count: int) -> list[float]:
        """Seconds that each step took."""
        found = []
        while len(found) < count:
            instant = self.scene.instant()
            if instant.touched:
                start = time.perf_counter()
                self.stream.push(instant.reading.pressure, instant.reading.q)
                found.append(time.perf_counter() - start)
        return found

    def steps(self, wanted: int) -> int:
        """Warm up, and say how many steps are to be timed."""
        seconds = float(np.median(self.run(3)))
        return min(wanted, max(ROUNDS, round(PATIENCE / seconds)))


def time_together(subjects: Sequence[Subject], steps: int) -> list[np.ndarray]:
    """Milliseconds of each step of each subject, taken in turn in several rounds."""
    wanted = [subject.steps(steps) for subject in subjects]
    found: list[list[float]] = [[] for _ in subjects]
    for part in range(ROUNDS):
        for subject, count, times in zip(subjects, wanted, found, strict=True):
            share = count * (part + 1) // ROUNDS - count * part // ROUNDS
            times += subject.run(share)
    return [1e3 * np.array(times) for times in found]


def row_of(
    subject: Subject, milliseconds: Float[np.ndarray, "step"], unit: float
) -> Row:
    """A row of the table; `unit` is the median that the ratio is to [ms]."""
    middle, high = np.percentile(milliseconds, (50, 99))
    return Row(
        subject.name,
        float(middle),
        float(high),
        float(milliseconds.max()),
        subject.taxels,
        subject.active,
        len(milliseconds),
        float(middle) / unit,
    )


@contextmanager
def pinned() -> Iterator[None]:
    """Everything within runs on one core, in one thread; one core of several we had."""
    use_one_thread()
    with threadpool_limits(1):
        if not hasattr(os, "sched_setaffinity"):
            yield
            return
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(before)})
        try:
            yield
        finally:
            os.sched_setaffinity(0, before)
