"""Measure how much of a recording is lost when its process is killed."""

import random
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eskin.recording import read_recording

ROOT = Path(__file__).parents[2]
LONGEST = 3.0
"""Longest time before a process is killed [s]."""
TOGETHER = 5
"""Number of processes at once."""


@dataclass(frozen=True)
class Killed:
    """Describes a recording whose process was killed with SIGKILL."""

    seconds: float
    """Duration of the recording, by its scans [s]."""
    lost: float
    """Time from the last scan in the file to the last that was streamed [s]."""
    whole: bool
    """Whether the file opens and holds every scan before its last."""


def kill_line(times: int, seed: int) -> str:
    """Kill processes and format the result."""
    with tempfile.TemporaryDirectory() as folder:
        killed = kill_often(Path(folder), times, seed)
    lost = [one.lost for one in killed]
    return (
        f"{times} recordings killed after {min(one.seconds for one in killed):.2f} to "
        f"{max(one.seconds for one in killed):.2f} s: "
        f"{sum(one.whole for one in killed)} open and lack nothing before their end; "
        f"lost p50 {np.median(lost):.2f} s, most {max(lost):.2f} s"
    )


def kill_often(folder: Path, times: int, seed: int = 0) -> list[Killed]:
    """Kill processes that record, each at a random moment of its first seconds."""
    moments = random.Random(seed)
    delays = [moments.uniform(0.0, LONGEST) for _ in range(times)]
    paths = [folder / f"{number}.mcap" for number in range(times)]
    with ThreadPoolExecutor(TOGETHER) as pool:
        return list(pool.map(kill_one, paths, delays))


def kill_one(path: Path, delay: float) -> Killed:
    """Start a process that records to a file, and kill it some seconds later."""
    command = [sys.executable, "-m", "lab.soak.recording", str(path)]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        first = child.stdout.readline()
        time.sleep(delay)
        child.kill()
        lines = [first, *child.stdout.readlines()]
    stamps = [int(line) for line in lines if line.endswith("\n")]
    recording = read_recording(path.with_name(path.name + ".part"))
    left = [scan.stamp for scan in recording.scans()]
    known = min(len(left), len(stamps))
    return Killed(
        seconds=(stamps[-1] - stamps[0]) / 1e9,
        lost=(stamps[-1] - (left[-1] if left else stamps[0])) / 1e9,
        whole=left[:known] == stamps[:known],
    )
