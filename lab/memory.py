"""Measure the memory of an hour of streaming.

    python -m lab.memory

Readings of the ur5 skin with a moving arm and touches, an hour at 50 Hz, are pushed as
fast as possible in a process of their own. The result is the memory above that of a
process that has imported numpy, scipy and numba.
"""

import os
import subprocess
import sys
from pathlib import Path

import eskin
from eskin.sim.bench.scene import BenchScene, find_forearm_taxels

HOUR = 180_000
"""Number of readings in an hour at 50 Hz."""

STREAMING = f"from lab.memory import stream; stream({HOUR})"
EMPTY = """
import numpy, scipy, numba
print(open("/proc/self/statm").read().split()[1])
"""


def main() -> None:
    """Measure and print."""
    (empty,) = run_measured(EMPTY)
    above = ", ".join(f"{part - empty:.1f}" for part in run_measured(STREAMING))
    print(
        f"{empty:.1f} MB with numpy, scipy and numba; above that, after the first "
        f"touches, half of {HOUR} readings and all of them: {above} MB"
    )


def stream(readings: int) -> None:
    """Push readings; print the resident pages after 200, after half, and after all."""
    mounted = eskin.MountedSkin(eskin.load_skin("ur5"), eskin.load_robot("ur5"))
    recognizer = eskin.Recognizer(eskin.load_model("ur5"), mounted, None)
    scene = BenchScene(mounted, find_forearm_taxels(mounted.skin, 60))
    for part in (200, readings // 2, readings):
        while scene.number < part:
            recognizer.push(scene.next_reading().reading)
        print(Path("/proc/self/statm").read_text().split()[1])


def run_measured(code: str) -> list[float]:
    """Run code in a process, and convert the pages that it prints to [MB]."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    page = os.sysconf("SC_PAGE_SIZE")
    return [int(line) * page / 1e6 for line in done.stdout.split()]


if __name__ == "__main__":
    main()
