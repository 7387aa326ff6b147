"""This module times two checkouts of eskin in turn, each by its own commands."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

TURNS = 3
CLIPS, STEPS = 60, 1000
"""Clips that are generated, and steps that are timed, in each turn."""
MEASURES = {
    "step at 60 taxels, p50 [ms]": "step",
    "clips a minute": "clips",
    "peak memory of a replay [MB]": "memory",
}


def compare_speed(here: Path, other: Path) -> None:
    """Time two checkouts in turn, and print a table of medians and their ratio.

    Args:
        here: root of one checkout.
        other: root of the other one.
    """
    roots = {"this": here.resolve(), "other": other.resolve()}
    found: dict[str, dict[str, list[float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, root in roots.items():  # Compiles, and is not counted.
            measure(root, Path(folder) / f"warm {name}", clips=2, steps=10)
        for turn in range(TURNS):
            for name, root in roots.items():
                result = measure(root, Path(folder) / f"{turn} {name}", CLIPS, STEPS)
                print(f"turn {turn + 1}, {name}: {result}", flush=True)
                for key, value in result.items():
                    found.setdefault(key, {}).setdefault(name, []).append(value)
    for name, root in roots.items():
        print(f"{name}: {root}")
    print(f"{'':30} {'this':>9} {'other':>9} {'this/other':>10}")
    for title, key in MEASURES.items():
        this, that = (median(found[key][name]) for name in roots)
        print(f"{title:30} {this:9.3f} {that:9.3f} {this / that:10.3f}")


def measure(root: Path, folder: Path, clips: int, steps: int) -> dict[str, float]:
    """Measure one checkout once.

    Args:
        root: root of the checkout.
        folder: new folder for its recordings.
        clips: number of clips to generate.
        steps: number of steps to time.
    """
    bench = ("bench", "latency", "--steps", steps)
    rows, _ = call(root, *bench)
    made, _ = call(root, "generate", folder, "--clips", clips, "--workers", 1)
    path = min(folder.glob("*.mcap"))
    _, memory = call(root, "replay", path)
    step = next(row for row in rows["rows"] if row["active"] == 60)
    return {
        "step": step["p50_ms"],
        "clips": made["clips_per_minute"],
        "memory": round(memory, 1),
    }


def call(root: Path, *words: object) -> tuple[dict, float]:
    """Run a command of a checkout; return its result and its peak memory [MB]."""
    argv: Sequence[str] = [sys.executable, "-m", "eskin", *map(str, words), "--json"]
    environment = os.environ | {"PYTHONPATH": str(root / "src"), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryFile("w+") as out:
        process = subprocess.Popen(argv, stdout=out, env=environment, cwd=root)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, argv)
        out.seek(0)
        return json.loads(out.read().splitlines()[-1]), usage.ru_maxrss / 1024
