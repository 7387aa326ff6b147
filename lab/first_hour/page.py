"""Run `docs/first_hour.md` from an empty folder, and time it by step.

Every block of commands on the page is run as it stands. It fails unless the touches of
its last step are recognised as they were made.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "first_hour.md"
PORT = "9750"
"""UDP port in the commands of the page."""
STEP = re.compile(r"^## (?P<title>\d+\. .*)$", re.MULTILINE)
BLOCK = re.compile(r"^```bash\n(?P<script>.*?)^```$", re.MULTILINE | re.DOTALL)
MADE = re.compile(r"hand\.py unseen\.mcap \d+ (?P<times>\d+) (?P<moves>[\w ]+)")
NAMES = {"lean": "none"}
"""Gestures that movements are labelled as, where they have other names."""
SECONDS = 300.0
"""Longest time of a step [s]."""


@dataclass(frozen=True)
class Step:
    """A step is a section of the page with commands."""

    title: str
    """Title of the section."""
    script: str
    """Its commands."""


def read_steps(port: str = PORT) -> list[Step]:
    """Return the steps of the page; its commands use a UDP port."""
    _, *parts = STEP.split(PAGE.read_text())
    steps = []
    for title, text in zip(parts[::2], parts[1::2], strict=True):
        script = "".join(BLOCK.findall(text)).replace(f":{PORT}", f":{port}")
        steps.append(Step(title, script))
    return steps


def run_step(step: Step, folder: Path) -> str:
    """Run the commands of a step in a folder; return what they print.

    Raises:
        RuntimeError: one of them failed.
    """
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", step.script],
        cwd=folder,
        env=os.environ | {"PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=SECONDS,
    )
    if done.returncode:
        raise RuntimeError(f"{step.title} failed: {done.stdout}")
    return done.stdout


def find_detections(printed: str) -> list[str]:
    """Return the gestures that `eskin run` printed, in order."""
    return re.findall(r"^ *[\d.]+s  (\w+) +\d+%", printed, re.MULTILINE)


def find_made(steps: list[Step]) -> list[str]:
    """Return the gestures that the hand makes in the last step, in order."""
    [found] = [found for step in steps if (found := MADE.search(step.script))]
    moves = [NAMES.get(move, move) for move in found["moves"].split()]
    return moves * int(found["times"])


def walk(port: int, show: bool) -> int:
    """Print the seconds of each step, and whether all touches were recognised.

    Args:
        port: UDP port for the packets of the matrix.
        show: whether what the commands print is printed too.

    Returns:
        Exit code: 0 where all touches were recognised, else 1.
    """
    steps = read_steps(str(port))
    total = 0.0
    printed = ""
    with tempfile.TemporaryDirectory() as folder:
        for step in steps:
            began = time.monotonic()
            printed = run_step(step, Path(folder))
            seconds = time.monotonic() - began
            total += seconds
            print(printed if show else "", end="")
            print(f"{seconds:6.1f} s  {step.title}", flush=True)
    made = find_made(steps)
    found = find_detections(printed)
    print(f"{total:6.1f} s  in all\nmade:       {made}\nrecognised: {found}")
    return int(made != found)
