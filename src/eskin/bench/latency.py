"""This module times one step of the engine and of every baseline, in turn.

The methods take turns, so that load on the machine affects all of them alike.
"""

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import final

import numpy as np
from jaxtyping import Int
from threadpoolctl import threadpool_limits

from eskin.bench.scene import (
    BenchScene,
    find_forearm_band,
    find_forearm_taxels,
    find_upper_arm_taxels,
    large_skin,
)
from eskin.learn.baselines import (
    NETWORKS,
    READINGS,
    BaselineStream,
    FitConfig,
    SkinWindows,
    build_baseline,
    use_one_thread,
)
from eskin.live import Recognizer, load_model
from eskin.robot import load_robot
from eskin.skin import MountedSkin

CLASS_COUNT = 5
RADII = (0.010, 0.015, 0.020, 0.030, 0.040)
"""Radius of the touches of each class [m]."""

LENGTHS = (15, 60, 30, 80, 45)
"""Duration of the touches of each class, in readings."""


def draw_random_clips(
    mounted: MountedSkin, count: int, seed: int = 0
) -> tuple[SkinWindows, Int[np.ndarray, "clip"]]:
    """Draw clips of round touches and noise; classes differ in size and length.

    They serve to fit baselines before timing, not to measure accuracy.

    Args:
        mounted: skin on its robot.
        count: number of clips.
        seed: random seed.
    """
    rng = np.random.default_rng(seed)
    skin, joints = mounted.skin, len(mounted.robot.joint_names)
    links = mounted.taxel_link_index
    labels = np.arange(count) % CLASS_COUNT
    pressure = rng.random((count, READINGS, skin.count), np.float32) * np.float32(0.3)
    for clip, label in enumerate(labels):
        centre = rng.integers(skin.count)
        distance = np.linalg.norm(skin.positions - skin.positions[centre], axis=1)
        near = np.flatnonzero((distance < RADII[label]) & (links == links[centre]))
        length = min(round(LENGTHS[label] * rng.uniform(0.7, 1.3)), READINGS)
        start = int(rng.integers(READINGS - length + 1))
        load = rng.uniform(5.0, 30.0, (length, 1)) * rng.uniform(0.5, 1.5, len(near))
        pressure[clip, start : start + length, near] = load.T
    q = rng.uniform(-1.0, 1.0, (count, 1, joints)).repeat(READINGS, axis=1)
    return SkinWindows(pressure, q.astype(np.float32)), labels


ROUNDS = 10
WARM_UP = 210
"""Steps of the engine that are not counted: they fill its window of 2 s."""

MAX_BASELINE_S = 5.0
"""Approximate limit on the time for which a baseline is timed [s]."""


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
    """Median divided by that of the first row: the engine on the configured contact."""

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
    """Times `Recognizer.push` with the weights of eskin."""

    def __init__(self, name: str, mounted: MountedSkin, scene: BenchScene) -> None:
        """Load a recogniser."""
        super().__init__(name, mounted, scene)
        self.recognizer = Recognizer(load_model("ur5"), mounted, None)

    def run(self, count: int) -> list[float]:
        """Take the next steps; count those with contact, or all on an idle scene."""
        found: list[float] = []
        push, clock = self.recognizer.push, time.perf_counter
        while len(found) < count:
            for item in self.scene.next_readings(min(count - len(found), 100)):
                start = clock()
                push(item.reading)
                seconds = clock() - start
                if item.touched or not self.active:
                    found.append(seconds)
        return found

    def steps(self, wanted: int) -> int:
        """Fill the engine's window and return `wanted`."""
        self.run(WARM_UP)
        return wanted


@final
class TimedBaseline(TimedMethod):
    """Times a baseline that is called at every reading."""

    def __init__(
        self, name: str, mounted: MountedSkin, scene: BenchScene, stream: BaselineStream
    ) -> None:
        """Store a baseline's stream."""
        super().__init__(name, mounted, scene)
        self.stream = stream

    def run(self, count: int) -> list[float]:
        """Take the next steps with contact; return the duration of each [s]."""
        found = []
        while len(found) < count:
            item = self.scene.next_reading()
            if item.touched:
                start = time.perf_counter()
                self.stream.push(item.reading.pressure, item.reading.q)
                found.append(time.perf_counter() - start)
        return found

    def steps(self, wanted: int) -> int:
        """Time three steps and return how many fit into the time limit."""
        seconds = float(np.median(self.run(3)))
        return min(wanted, max(ROUNDS, round(MAX_BASELINE_S / seconds)))


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


LIGHT_TAXELS, GRAB_TAXELS = 20, 83
"""Active taxels of a light touch and of a full grab."""

NETWORK_CLIPS = 20
"""Number of clips that a network is fitted on: its weights do not change its timing."""


@dataclass(frozen=True)
class LatencyConfig:
    """Sets what is timed, and how often."""

    active: int = 60
    """Active taxels of the contact that all methods are timed on."""
    taxels: int = 2112
    """Taxels of the skin: 2112 is the ur5 skin, more add panels around it."""
    steps: int = 5000
    """Timed steps of the engine in each scene, and at most of each baseline."""
    clips: int = 581
    """Number of random clips that the baselines are fitted on; the paper had 581."""

    def __post_init__(self) -> None:
        """Raise if a number is out of range."""
        if self.steps < 10:
            raise ValueError(
                f"--steps is {self.steps}; allowed are 10 and above; change it"
            )
        if self.clips < NETWORK_CLIPS:
            raise ValueError(
                f"--clips is {self.clips}; allowed are {NETWORK_CLIPS} and above; "
                "change it"
            )


def measure_latency(
    config: LatencyConfig, baselines: Sequence[str]
) -> list[LatencyRow]:
    """Time the engine on several scenes, and baselines on the first of them.

    Args:
        config: what is timed, and how often.
        baselines: names of the baselines.
    """
    mounted = MountedSkin(large_skin(config.taxels), load_robot("ur5"))
    methods = build_timed_engines(mounted, config.active)
    methods += build_timed_baselines(mounted, config, baselines)
    return build_latency_rows(methods, config.steps)


def build_timed_engines(mounted: MountedSkin, active: int) -> list[TimedMethod]:
    """Build the engine on the configured contact, idle, and on other touches."""
    skin = mounted.skin
    two = np.concatenate(
        [find_forearm_taxels(skin, active), find_upper_arm_taxels(skin, active)]
    )
    touches = {
        ("eskin", active): find_forearm_taxels(skin, active),
        ("eskin", 0): find_forearm_taxels(skin, 1)[:0],
        ("eskin", LIGHT_TAXELS): find_forearm_taxels(skin, LIGHT_TAXELS),
        ("eskin, grab", GRAB_TAXELS): find_forearm_band(skin, GRAB_TAXELS),
        ("eskin, two touches", 2 * active): two,
    }
    return [
        TimedEngine(name, mounted, BenchScene(mounted, taxels))
        for (name, _), taxels in touches.items()
    ]


def build_timed_baselines(
    mounted: MountedSkin, config: LatencyConfig, names: Sequence[str]
) -> list[TimedMethod]:
    """Fit the named baselines and build each of their streaming modes."""
    if not names:
        return []
    clips, labels = draw_random_clips(mounted, config.clips)
    few = SkinWindows(clips.pressure[:NETWORK_CLIPS], clips.q[:NETWORK_CLIPS])
    methods: list[TimedMethod] = []
    for name in names:
        baseline = build_baseline(name, mounted, FitConfig(epochs=1))
        if name in NETWORKS:
            baseline.fit(few, labels[:NETWORK_CLIPS])
        else:
            baseline.fit(clips, labels)
        for mode, stream in baseline.build_streams().items():
            scene = BenchScene(
                mounted, find_forearm_taxels(mounted.skin, config.active)
            )
            title = f"{name}, {mode}" if mode else name
            methods.append(TimedBaseline(title, mounted, scene, stream))
    return methods
