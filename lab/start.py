"""Time `eskin run` from its start to its first line, first reading and first answer.

    python -m lab.start

A recording of 4 s is replayed whose touch is recognised 0.8 s after its begin: first
with nothing compiled, then three times with what the first run has kept on disk. The
processor time of the whole run and its peak memory are printed too: on a busy machine
they say more than the times.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from resource import struct_rusage

import numpy as np

import eskin
from eskin.recording import Metadata

RATE = 50
SECONDS = 4
EVENTS = {
    "first line": re.compile("."),
    "first reading": re.compile(r"\s+time  what"),
    "first answer": re.compile(r"\s+[\d.]+s  \w+ +\d+%"),
}
"""Patterns of the lines that are waited for."""


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "poke.mcap"
        write_poke(path)
        without = shutil.ignore_patterns("*.nbi", "*.nbc")
        package = Path(eskin.__file__).parent
        copy = shutil.copytree(package, Path(folder) / "eskin", ignore=without)
        for name in ("nothing compiled", *["compiled"] * 3):
            found, usage = time_run(path, copy.parent)
            times = ", ".join(f"{event} {found[event]:.1f} s" for event in EVENTS)
            spent = usage.ru_utime + usage.ru_stime
            peak = usage.ru_maxrss / 1024
            print(
                f"{name}: {times}; processor {spent:.1f} s, {peak:.0f} MB", flush=True
            )
        functions, kinds = (len(list(copy.rglob(each))) for each in ("*.nbi", "*.nbc"))
        print(f"kept on disk: {functions} functions, {kinds} specialisations")


def write_poke(path: Path) -> None:
    """Record a poke of the ur5 skin from 0.6 to 0.9 s."""
    skin = eskin.load_skin("ur5")
    rng = np.random.default_rng(0)
    calibration = eskin.Calibration.uniform(skin.count, 4095, 100.0)
    patch = skin.find_taxels(skin.patches[4].id)
    distance = np.linalg.norm(skin.positions - skin.positions[patch[20]], axis=1)
    shape = np.zeros(skin.count)
    shape[patch] = np.exp(-((distance[patch] / 0.012) ** 2))
    metadata = Metadata("bench")
    received = np.ones(skin.count, bool)
    with eskin.RecordingWriter(path, "ur5", skin, calibration, metadata) as writer:
        for index in range(RATE * SECONDS):
            t = index / RATE
            press = 1600 * np.sin(np.pi * np.clip((t - 0.6) / 0.3, 0, 1))
            counts = np.int32(rng.normal(20, 1, skin.count) + press * shape)
            stamp = round((index + 1) * 1e9 / RATE)
            writer.write(eskin.Scan(stamp, counts, received, np.zeros(6)))


def time_run(path: Path, source: Path) -> tuple[dict[str, float], struct_rusage]:
    """Return the time of each event of `eskin run` since its start [s], and its usage.

    Args:
        path: recording that is replayed.
        source: folder of the copy of eskin that is run, which keeps its code.
    """
    words = [sys.executable, "-m", "eskin", "run", "--source"]
    others = os.environ.get("PYTHONPATH", "")
    found = {}
    began = time.monotonic()
    with subprocess.Popen(
        [*words, f"replay:{path}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONPATH": f"{source}{os.pathsep}{others}"},
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            for event, pattern in EVENTS.items():
                if event not in found and pattern.match(line):
                    found[event] = time.monotonic() - began
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return found, usage


if __name__ == "__main__":
    main()
