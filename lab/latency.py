"""Time one step of the engine and of every baseline, on one core, in turn.

The paper's Table III holds such times.

    python -m lab.latency

The scene is a touch of the ur5's forearm while the arm moves. Baselines are fitted on
random clips, which is enough for timing and for nothing else.
"""

import sys
import time
from dataclasses import dataclass, field
from typing import Annotated, final

import numpy as np
import tyro
from jaxtyping import Int

from eskin.robot import load_robot
from eskin.sim.bench.latency import (
    ROUNDS,
    LatencyConfig,
    LatencyRow,
    TimedMethod,
    build_latency_rows,
    build_timed_engines,
    pin_to_one_core,
)
from eskin.sim.bench.scene import BenchScene, find_forearm_taxels, large_skin
from eskin.sim.commands.bench import print_latency
from eskin.skin import MountedSkin
from lab.baselines import (
    BASELINES,
    NETWORKS,
    READINGS,
    BaselineStream,
    FitConfig,
    SkinWindows,
    build_baseline,
    use_one_thread,
)
from lab.program import run_program

NETWORK_CLIPS = 20
"""Number of clips that a network is fitted on: its weights do not change its timing."""

MAX_BASELINE_S = 5.0
"""Approximate limit on the time for which a baseline is timed [s]."""

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
    skin = mounted.skin
    joints = len(mounted.robot.joint_names)
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


@dataclass(frozen=True)
class Command:
    """Time the engine and baselines."""

    config: Annotated[LatencyConfig, tyro.conf.arg(name="")] = field(
        default_factory=LatencyConfig
    )

    baselines: tuple[str, ...] = (*BASELINES, *NETWORKS)
    """Baselines to time beside the engine."""

    clips: int = 581
    """Number of random clips that the baselines are fitted on; the paper had 581."""

    def __post_init__(self) -> None:
        """Raise if there are too few clips."""
        if self.clips < NETWORK_CLIPS:
            raise ValueError(
                f"--clips is {self.clips}; allowed are {NETWORK_CLIPS} and above"
            )


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


def measure(command: Command) -> list[LatencyRow]:
    """Time the engine on several scenes, and baselines on the first of them."""
    config = command.config
    mounted = MountedSkin(large_skin(config.taxels), load_robot("ur5"))
    methods = build_timed_engines(mounted, config.active)
    methods += build_timed_baselines(mounted, command)
    return build_latency_rows(methods, config.steps)


def measure_on_one_core(command: Command) -> list[LatencyRow]:
    """Return the rows of `measure`, in one thread on one core."""
    use_one_thread()
    with pin_to_one_core():
        return measure(command)


def build_timed_baselines(mounted: MountedSkin, command: Command) -> list[TimedMethod]:
    """Fit the named baselines and build each of their streaming modes."""
    clips, labels = draw_random_clips(mounted, command.clips)
    few = SkinWindows(clips.pressure[:NETWORK_CLIPS], clips.q[:NETWORK_CLIPS])
    methods: list[TimedMethod] = []
    for name in command.baselines:
        baseline = build_baseline(name, mounted, FitConfig(epochs=1))
        if name in NETWORKS:
            baseline.fit(few, labels[:NETWORK_CLIPS])
        else:
            baseline.fit(clips, labels)
        for mode, stream in baseline.build_streams().items():
            scene = BenchScene(
                mounted, find_forearm_taxels(mounted.skin, command.config.active)
            )
            title = f"{name}, {mode}" if mode else name
            methods.append(TimedBaseline(title, mounted, scene, stream))
    return methods


def main(command: Command) -> dict[str, object]:
    """Print and return a row for each method."""
    rows = measure_on_one_core(command)
    print_latency(rows)
    return {"rows": [row.as_dict() for row in rows]}


if __name__ == "__main__":
    sys.exit(run_program(main))
