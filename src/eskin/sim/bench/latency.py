"""This module times one step of the engine in several scenes, in turn.

The scenes take turns, so that load on the machine affects all of them alike.
"""

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import final

import numpy as np
from threadpoolctl import threadpool_limits

from eskin.live import Recognizer, load_model
from eskin.robot import load_robot
from eskin.sim.bench.scene import (
    BenchScene,
    find_central_taxels,
    find_forearm_band,
    find_forearm_taxels,
    large_skin,
)
from eskin.sim.bench.sender import REST, build_sender_calibration
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Reading, Scan

ROUNDS = 10
WARM_UP = 210
"""Steps of the engine that are not counted: they fill its window of 2 s."""


@dataclass(frozen=True)
class LatencyRow:
    """Holds the duration of one step of one method, a row of the table."""

    name: str
    """Name of the method; `eskin` is the engine."""
    p50_ms: float
    p99_ms: float
    max_ms: float
    taxels: int
    active: int
    steps: int
    """Number of steps timed."""
    ratio: float
    """Median over the median of the first row: the engine on the configured contact."""

    def as_dict(self) -> dict[str, object]:
        """Return the fields as plain rounded values."""
        rounded: dict[str, object] = {
            "p50_ms": round(self.p50_ms, 4),
            "p99_ms": round(self.p99_ms, 4),
            "max_ms": round(self.max_ms, 4),
            "ratio": round(self.ratio, 3),
        }
        return {**asdict(self), **rounded}


class TimedMethod(ABC):
    """Times a method that takes a step at each reading of a scene."""

    def __init__(self, name: str, mounted: MountedSkin, scene: BenchScene) -> None:
        """Store the name and the scene."""
        self.name = name
        self.taxels = mounted.skin.count
        self.active = len(scene.active)
        self.scene = scene

    @abstractmethod
    def run(self, count: int) -> list[float]:
        """Take the next steps with contact; return the duration of each [s]."""

    @abstractmethod
    def steps(self, wanted: int) -> int:
        """Warm up and return how many steps to time."""


@final
class TimedEngine(TimedMethod):
    """Times `Recognizer.push` with the weights of eskin, on readings or on scans."""

    def __init__(
        self,
        name: str,
        mounted: MountedSkin,
        scene: BenchScene,
        calibration: Calibration | None = None,
    ) -> None:
        """Load a recogniser; with a calibration it is given counts."""
        super().__init__(name, mounted, scene)
        self.calibration = calibration
        self.recognizer = Recognizer(load_model("ur5"), mounted, calibration)

    def build_sample(self, reading: Reading) -> Scan | Reading:
        """Return a reading, or the scan that is measured as this reading."""
        if self.calibration is None:
            return reading
        above = np.rint(reading.pressure / self.calibration.gain).astype(np.int32)
        return Scan(reading.stamp, REST + above, reading.valid, reading.q)

    def run(self, count: int) -> list[float]:
        """Take the next steps; count those with contact, or all on an idle scene."""
        found: list[float] = []
        push = self.recognizer.push
        clock = time.perf_counter
        while len(found) < count:
            for item in self.scene.next_readings(min(count - len(found), 100)):
                sample = self.build_sample(item.reading)
                start = clock()
                push(sample)
                seconds = clock() - start
                if item.touched or not self.active:
                    found.append(seconds)
        return found

    def steps(self, wanted: int) -> int:
        """Fill the engine's window and return `wanted`."""
        self.run(WARM_UP)
        return wanted


def time_in_turn(methods: Sequence[TimedMethod], steps: int) -> list[np.ndarray]:
    """Return the duration of each step of each method [ms], timed in several rounds."""
    wanted = [method.steps(steps) for method in methods]
    found: list[list[float]] = [[] for _ in methods]
    for part in range(ROUNDS):
        for method, count, times in zip(methods, wanted, found, strict=True):
            share = count * (part + 1) // ROUNDS - count * part // ROUNDS
            times += method.run(share)
    return [1e3 * np.array(times) for times in found]


def build_latency_rows(methods: Sequence[TimedMethod], steps: int) -> list[LatencyRow]:
    """Time the methods in turn and build their rows; ratios refer to the first."""
    rows: list[LatencyRow] = []
    for method, times in zip(methods, time_in_turn(methods, steps), strict=True):
        p50, p99 = np.percentile(times, (50, 99)).tolist()
        rows.append(
            LatencyRow(
                name=method.name,
                p50_ms=p50,
                p99_ms=p99,
                max_ms=float(times.max()),
                taxels=method.taxels,
                active=method.active,
                steps=len(times),
                ratio=p50 / (rows[0].p50_ms if rows else p50),
            )
        )
    return rows


@contextmanager
def pin_to_one_core() -> Iterator[None]:
    """Run the body of `with` on one of the available cores, in one thread."""
    with threadpool_limits(1):
        if not hasattr(os, "sched_setaffinity"):
            yield
            return
        all_cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(all_cores)})
        try:
            yield
        finally:
            os.sched_setaffinity(0, all_cores)


LIGHT_TAXELS = 20
GRAB_TAXELS = 83
"""Active taxels of a light touch and of a full grab."""


@dataclass(frozen=True)
class LatencyConfig:
    """Time one step of the engine on one core: touches of several sizes, and none.

    The scene is a touch of the ur5's forearm while the arm moves.
    """

    active: int = 60
    """Active taxels of the contact that all methods are timed on."""
    taxels: int = 2112
    """Taxels of the skin: 2112 is the ur5 skin, more add panels around it."""
    steps: int = 5000
    """Timed steps of the engine in each scene."""

    def __post_init__(self) -> None:
        """Raise if a number is out of range."""
        if self.steps < 10:
            raise ValueError(f"--steps is {self.steps}; allowed are 10 and above")


def measure_latency(config: LatencyConfig) -> list[LatencyRow]:
    """Time the engine on several scenes."""
    mounted = MountedSkin(large_skin(config.taxels), load_robot("ur5"))
    methods = build_timed_engines(mounted, config.active)
    return build_latency_rows(methods, config.steps)


def build_timed_engines(mounted: MountedSkin, active: int) -> list[TimedMethod]:
    """Build the engine on the configured contact, idle, and on other touches."""
    skin = mounted.skin
    upper_arm = find_central_taxels(skin, "upper_arm_front", active)
    two = np.concatenate([find_forearm_taxels(skin, active), upper_arm])
    touch = find_forearm_taxels(skin, active)
    idle = find_forearm_taxels(skin, 1)[:0]
    calibration = build_sender_calibration(skin.count)
    scenes = (
        ("eskin", touch, None),
        ("eskin", idle, None),
        ("eskin", find_forearm_taxels(skin, LIGHT_TAXELS), None),
        ("eskin, grab", find_forearm_band(skin, GRAB_TAXELS), None),
        ("eskin, two touches", two, None),
        ("eskin, from counts", touch, calibration),
        ("eskin, from counts", idle, calibration),
    )
    return [
        TimedEngine(name, mounted, BenchScene(mounted, taxels), counts)
        for name, taxels, counts in scenes
    ]
