"""This module times one step of the engine and of every baseline, in turn.

Taking turns makes a noisy machine equally noisy for all of them.
"""

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Int
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
    make_baseline,
    use_one_thread,
)
from eskin.live import Recognizer
from eskin.model import load_model
from eskin.robot import load_robot
from eskin.skin import MountedSkin

CLASSES = 5
RADII = (0.010, 0.015, 0.020, 0.030, 0.040)
"""Of the touches of each class [m]."""

LENGTHS = (15, 60, 30, 80, 45)
"""Readings that the touches of each class last."""


def draw_random_clips(
    mounted: MountedSkin, count: int, seed: int = 0
) -> tuple[SkinWindows, Int[np.ndarray, "clip"]]:
    """Round touches anywhere, their classes apart by size and length, and noise.

    Enough for timing, not for anything that accuracies are measured on.

    Args:
        mounted: the skin on its robot.
        count: how many clips.
        seed: decides everything that is drawn.
    """
    rng = np.random.default_rng(seed)
    skin, joints = mounted.skin, len(mounted.robot.joint_names)
    links = mounted.taxel_link_index
    labels = np.arange(count) % CLASSES
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
"""Steps of the engine that are not counted: its window of 2 s is full then."""

PATIENCE = 5.0
"""A baseline is timed no more steps than about so long takes [s]."""


@dataclass(frozen=True)
class LatencyRow:
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


class TimedMethod(ABC):
    """Something that takes a step at each reading."""

    def __init__(self, name: str, mounted: MountedSkin, scene: BenchScene) -> None:
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
class TimedEngine(TimedMethod):
    """`Recognizer.push` with the weights that come with eskin."""

    def __init__(self, name: str, mounted: MountedSkin, scene: BenchScene) -> None:
        """Start a recogniser."""
        super().__init__(name, mounted, scene)
        self.recognizer = Recognizer(load_model("ur5"), mounted, None)

    def run(self, count: int) -> list[float]:
        """Seconds that each step took, untouched ones only where none is touched."""
        found: list[float] = []
        push, clock = self.recognizer.push, time.perf_counter
        while len(found) < count:
            for instant in self.scene.next_readings(min(count - len(found), 100)):
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
class TimedBaseline(TimedMethod):
    """A baseline that answers at every reading."""

    def __init__(
        self, name: str, mounted: MountedSkin, scene: BenchScene, stream: BaselineStream
    ) -> None:
        """Take a baseline's stream."""
        super().__init__(name, mounted, scene)
        self.stream = stream

    def run(self, count: int) -> list[float]:
        """Seconds that each step took."""
        found = []
        while len(found) < count:
            instant = self.scene.next_reading()
            if instant.touched:
                start = time.perf_counter()
                self.stream.push(instant.reading.pressure, instant.reading.q)
                found.append(time.perf_counter() - start)
        return found

    def steps(self, wanted: int) -> int:
        """Warm up, and say how many steps are to be timed."""
        seconds = float(np.median(self.run(3)))
        return min(wanted, max(ROUNDS, round(PATIENCE / seconds)))


def time_in_turn(subjects: Sequence[TimedMethod], steps: int) -> list[np.ndarray]:
    """Milliseconds of each step of each subject, taken in turn in several rounds."""
    wanted = [subject.steps(steps) for subject in subjects]
    found: list[list[float]] = [[] for _ in subjects]
    for part in range(ROUNDS):
        for subject, count, times in zip(subjects, wanted, found, strict=True):
            share = count * (part + 1) // ROUNDS - count * part // ROUNDS
            times += subject.run(share)
    return [1e3 * np.array(times) for times in found]


def build_latency_row(
    subject: TimedMethod, milliseconds: Float[np.ndarray, "step"], unit: float
) -> LatencyRow:
    """A row of the table; `unit` is the median that the ratio is to [ms]."""
    middle, high = np.percentile(milliseconds, (50, 99))
    return LatencyRow(
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
def pin_to_one_core() -> Iterator[None]:
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


FEW, GRAB = 20, 83
"""Active taxels of a light touch and of a full grab."""

NETWORK_CLIPS = 20
"""A network is fitted on so many: its step takes as long whatever its weights are."""


@dataclass(frozen=True)
class LatencyConfig:
    """What is timed, and how often."""

    active: int = 60
    """Active taxels of the contact that all are timed on."""

    taxels: int = 2112
    """Of the skin: 2112 is the ur5 skin, more are the same with skin around it."""

    steps: int = 5000
    """Steps timed of the engine in each scene, and at most of each baseline."""

    clips: int = 581
    """Random clips that the baselines are fitted on; the paper had 581."""

    def __post_init__(self) -> None:
        """Refuse what cannot be timed."""
        if self.steps < 10:
            raise ValueError(
                f"--steps is {self.steps}; allowed are 10 and above; change it"
            )
        if self.clips < NETWORK_CLIPS:
            raise ValueError(
                f"--clips is {self.clips}; allowed are {NETWORK_CLIPS} and above; "
                "change it"
            )


def latency(config: LatencyConfig, baselines: Sequence[str]) -> list[LatencyRow]:
    """Time the engine on several scenes, and baselines on the first of them.

    Args:
        config: what is timed, and how often.
        baselines: their names.
    """
    mounted = MountedSkin(large_skin(config.taxels), load_robot("ur5"))
    subjects = build_timed_engines(mounted, config.active)
    subjects += build_timed_baselines(mounted, config, baselines)
    times = time_in_turn(subjects, config.steps)
    unit = float(np.median(times[0]))
    return [build_latency_row(s, t, unit) for s, t in zip(subjects, times, strict=True)]


def scaled(
    taxels: Sequence[int], active: Sequence[int], steps: int
) -> list[LatencyRow]:
    """Time the engine alone on skins and contacts of several sizes, all in turn.

    Args:
        taxels: of each skin.
        active: of each contact, on the skin of the same place in `taxels`.
        steps: timed of each.
    """
    skins = {count: large_skin(count) for count in sorted(set(taxels))}
    robot = load_robot("ur5")
    subjects: list[TimedMethod] = []
    for count, pressed in zip(taxels, active, strict=True):
        mounted = MountedSkin(skins[count], robot)
        scene = BenchScene(mounted, find_forearm_taxels(mounted.skin, pressed))
        subjects.append(TimedEngine("eskin", mounted, scene))
    times = time_in_turn(subjects, steps)
    unit = float(np.median(times[0]))
    return [build_latency_row(s, t, unit) for s, t in zip(subjects, times, strict=True)]


def build_timed_engines(mounted: MountedSkin, active: int) -> list[TimedMethod]:
    """The engine on the contact asked for, idle, and on other touches."""
    skin = mounted.skin
    two = np.concatenate(
        [find_forearm_taxels(skin, active), find_upper_arm_taxels(skin, active)]
    )
    touches = {
        ("eskin", active): find_forearm_taxels(skin, active),
        ("eskin", 0): find_forearm_taxels(skin, 1)[:0],
        ("eskin", FEW): find_forearm_taxels(skin, FEW),
        ("eskin, grab", GRAB): find_forearm_band(skin, GRAB),
        ("eskin, two touches", 2 * active): two,
    }
    return [
        TimedEngine(name, mounted, BenchScene(mounted, taxels))
        for (name, _), taxels in touches.items()
    ]


def build_timed_baselines(
    mounted: MountedSkin, config: LatencyConfig, names: Sequence[str]
) -> list[TimedMethod]:
    """Every way in which the named baselines, fitted, answer one reading."""
    if not names:
        return []
    clips, labels = draw_random_clips(mounted, config.clips)
    few = SkinWindows(clips.pressure[:NETWORK_CLIPS], clips.q[:NETWORK_CLIPS])
    subjects: list[TimedMethod] = []
    for name in names:
        baseline = make_baseline(name, mounted, FitConfig(epochs=1))
        if name in NETWORKS:
            baseline.fit(few, labels[:NETWORK_CLIPS])
        else:
            baseline.fit(clips, labels)
        for way, stream in baseline.streams().items():
            scene = BenchScene(
                mounted, find_forearm_taxels(mounted.skin, config.active)
            )
            title = f"{name}, {way}" if way else name
            subjects.append(TimedBaseline(title, mounted, scene, stream))
    return subjects
