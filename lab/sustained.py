"""Stream a thousand readings per second for a minute; print the load.

    python -m lab.sustained

Readings of the ur5 skin with a moving arm and touches are pushed when they are due;
each is tracked and encoded.
"""

import time
from dataclasses import dataclass

import numpy as np
import tyro

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


def main() -> None:
    """Push readings when they are due; print the share of a core and the times."""
    command = tyro.cli(Command)
    mounted = eskin.MountedSkin(eskin.load_skin("ur5"), eskin.load_robot("ur5"))
    recognizer = eskin.Recognizer(eskin.load_model("ur5"), mounted, None)
    scene = BenchScene(mounted, find_forearm_taxels(mounted.skin, 60), command.rate)
    for instant in scene.next_readings(WARM_UP):
        recognizer.push(instant.reading)
    readings = [
        i.reading for i in scene.next_readings(round(command.seconds * command.rate))
    ]
    took = []
    late = 0.0
    detections = 0
    with pin_to_one_core():
        busy = time.process_time()
        start = time.perf_counter()
        for number, reading in enumerate(readings):
            due = start + number / command.rate
            if (rest := due - time.perf_counter()) > 0:
                time.sleep(rest)
            now = time.perf_counter()
            detections += len(recognizer.push(reading))
            done = time.perf_counter()
            took.append(done - now)
            late = max(late, done - due)
        wall = time.perf_counter() - start
        busy = time.process_time() - busy
    print(
        f"{len(readings)} readings in {wall:.1f} s ({len(readings) / wall:.0f} Hz), "
        f"{detections} detections; share of a core {busy / wall:.1%}, "
        f"in push alone {sum(took) / wall:.1%}; latest answer {1e3 * late:.2f} ms "
        "after its reading was due"
    )
    p50, p99, longest = 1e3 * np.percentile(took, (50, 99, 100))
    print(f"a push: p50 {p50:.3f} ms, p99 {p99:.3f} ms, longest {longest:.2f} ms")


if __name__ == "__main__":
    main()
