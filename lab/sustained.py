"""Stream a thousand readings per second for a minute; print the load and the stalls.

    python -m lab.sustained

Readings of the ur5 skin with a moving arm and touches are pushed when they are due;
each is tracked and encoded.
"""

import gc
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tyro
from numba.core import event

import eskin
from eskin.sim.bench.latency import pin_to_one_core
from eskin.sim.bench.scene import BenchScene, find_forearm_taxels

WARM_UP = 2000


@dataclass(frozen=True)
class Command:
    """Stream at a rate."""

    seconds: float = 60.0
    """Duration of the stream [s]."""
    rate: float = 1000.0
    """Rate of the readings [1/s]."""


@dataclass
class Causes:
    """Holds possible causes of stalls, as pairs of start and end [s]."""

    collector: list[tuple[float, float]] = field(default_factory=list)
    compiler: list[tuple[float, float]] = field(default_factory=list)
    switched: list[float] = field(default_factory=list)
    """End of each step during which another thread took the core [s]."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    with pin_to_one_core():
        sustain(command)


def sustain(command: Command) -> None:
    """Push readings when they are due; print the share of a core and the stalls."""
    mounted = eskin.MountedSkin(eskin.load_skin("ur5"), eskin.load_robot("ur5"))
    recognizer = eskin.Recognizer(eskin.load_model("ur5"), mounted, None)
    scene = BenchScene(mounted, find_forearm_taxels(mounted.skin, 60), command.rate)
    for instant in scene.next_readings(WARM_UP):
        recognizer.push(instant.reading)
    readings = [
        i.reading for i in scene.next_readings(round(command.seconds * command.rate))
    ]
    began, took, late, detections = [], [], 0.0, 0
    with record_causes() as causes:
        busy, start = time.process_time(), time.perf_counter()
        for number, reading in enumerate(readings):
            due = start + number / command.rate
            if (rest := due - time.perf_counter()) > 0:
                time.sleep(rest)
            switches = count_preemptions()
            now = time.perf_counter()
            detections += len(recognizer.push(reading))
            done = time.perf_counter()
            began.append(now)
            took.append(done - now)
            late = max(late, done - due)
            if count_preemptions() > switches:
                causes.switched.append(done)
        wall, busy = time.perf_counter() - start, time.process_time() - busy
    print(
        f"{len(readings)} readings in {wall:.1f} s ({len(readings) / wall:.0f} Hz), "
        f"{detections} detections; share of a core {busy / wall:.1%}, "
        f"in push alone {sum(took) / wall:.1%}; latest answer {1e3 * late:.2f} ms "
        "after its reading was due"
    )
    print(
        f"a push: p50 {1e3 * np.median(took):.3f} ms, "
        f"p99 {1e3 * np.percentile(took, 99):.3f} ms; the longest:"
    )
    for n in np.argsort(took)[::-1][:5]:
        cause = find_cause(began[n], began[n] + took[n], causes)
        print(f"  {1e3 * took[n]:.2f} ms at {began[n] - start:.2f} s: {cause}")
    collected = [1e3 * (b - a) for a, b in causes.collector]
    longest = max(collected, default=0.0)
    print(
        f"garbage collections {len(collected)}, longest {longest:.2f} ms; "
        f"compilations {len(causes.compiler)}; taken off the core during "
        f"{len(causes.switched)} pushes"
    )


def find_cause(start: float, end: float, causes: Causes) -> str:
    """Return the causes of a long step."""
    found = []
    for name, spans in (
        ("garbage collector", causes.collector),
        ("compiler", causes.compiler),
    ):
        spent = sum(max(0.0, min(b, end) - max(a, start)) for a, b in spans)
        if spent:
            found.append(f"{name} {1e3 * spent:.2f} ms")
    if any(start <= moment <= end + 1e-4 for moment in causes.switched):
        found.append("another process had the core")
    return ", ".join(found) or "its own work"


@contextmanager
def record_causes() -> Iterator[Causes]:
    """Record every garbage collection and every compilation."""
    causes, opened = Causes(), [0.0]

    def collected(phase: str, info: dict[str, Any]) -> None:
        if phase == "start":
            opened[0] = time.perf_counter()
        else:
            causes.collector.append((opened[0], time.perf_counter()))

    class CompilationListener(event.Listener):
        def on_start(self, happened: Any) -> None:  # noqa: ANN401
            self.begun = time.perf_counter()

        def on_end(self, happened: Any) -> None:  # noqa: ANN401
            causes.compiler.append((self.begun, time.perf_counter()))

    gc.callbacks.append(collected)
    with event.install_listener("numba:compile", CompilationListener()):
        yield causes
    gc.callbacks.remove(collected)


def count_preemptions() -> int:
    """Return how often another thread or process took this thread's core."""
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw


if __name__ == "__main__":
    main()
