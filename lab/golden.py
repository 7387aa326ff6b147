"""Compare what eskin answers with stored answers, or its speed with another checkout.

    python -m lab.golden                      compare; exit code 1 where one differs
    python -m lab.golden --keep               store the answers anew
    python -m lab.golden --against CHECKOUT   time this tree and another one in turn

The answers are in `lab/golden.json`. Inputs and seeds are fixed, and only names of
`eskin.__all__` and the command line are used, so that a change inside must not change
an answer. Counts of the simulation are compared by digest, other numbers to five
digits. They were found equal from run to run on one machine, training included; with
another processor or other versions of numpy, numba or torch the last digits may differ,
and a digest with them. What differs from run to run is not compared: times, the lengths
of the queues of `eskin run`, and the order of the lines of a DXF.

Real recordings are read from `--data`, by default `../shared/data`; checks of them are
left out where they are missing. A comparison takes about a minute and a half on one
core, and three more for the first time, which compiles.
"""

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

from threadpoolctl import threadpool_limits

import eskin
from lab.checks import CHECKS, Answer, MissingDataError

ROOT = Path(__file__).parents[1]
ANSWERS = ROOT / "lab" / "golden.json"
DIGITS = 6
TOLERANCE = 1e-5
"""Significant digits that are stored, and the largest relative difference allowed."""
PACKAGES = ("numpy", "scipy", "numba", "torch", "onnxruntime")


def main() -> int:
    """Compare, store or time; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", action="store_true", help="store the answers anew")
    parser.add_argument("--against", type=Path, help="another checkout to time")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--only", nargs="+", choices=CHECKS, help="run these alone")
    options = parser.parse_args()
    if options.against is not None:
        compare_speed(ROOT, options.against)
        return 0
    os.environ["OMP_NUM_THREADS"] = "1"  # For torch, which is not loaded yet.
    print(f"{Path(eskin.__file__).parent}")
    kept = json.loads(ANSWERS.read_text("utf-8")) if ANSWERS.is_file() else {}
    failed = False
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        for name in select_checks(options.only):
            began = time.monotonic()
            try:
                answer = round_numbers(CHECKS[name](Path(folder), options.data))
            except MissingDataError as error:
                print(f"{name:12} left out: {error}", flush=True)
                continue
            seconds = f"{time.monotonic() - began:.0f} s"
            if options.keep:
                kept[name] = answer
                print(f"{name:12} stored, {seconds}", flush=True)
                continue
            found = list(find_differences(kept.get(name), answer, name))
            failed |= bool(found)
            print(f"{name:12} {'DIFFERS' if found else 'equal'}, {seconds}", flush=True)
            for line in found[:SHOWN]:
                print(f"  {line}")
            if len(found) > SHOWN:
                print(f"  and {len(found) - SHOWN} more")
    if options.keep:
        write_answers(kept | {"made with": describe_computer()})
    elif failed and kept.get("made with") != describe_computer():
        print(f"stored with {kept.get('made with')}, now {describe_computer()}")
    return int(failed)


SHOWN = 8
"""Most differences of a check that are printed."""
USES = {"run": ["clips"], "labels": ["clips", "stream"], "tables": ["clips"]}
USES |= {"training": ["clips"]}
"""Checks whose recordings a check uses."""


def select_checks(only: list[str] | None) -> list[str]:
    """Return the checks asked for and those that they use, in their order."""
    wanted = set(only or CHECKS)
    wanted |= {used for name in only or () for used in USES.get(name, ())}
    return [name for name in CHECKS if name in wanted]


def describe_computer() -> str:
    """Return processor and versions, with which last digits may differ."""
    versions = [f"{name} {version(name)}" for name in PACKAGES]
    return ", ".join([platform.machine(), platform.python_version(), *versions])


def round_numbers(value: Any) -> Any:  # noqa: ANN401
    """Return plain values as JSON holds them, floats to `DIGITS` digits."""
    if isinstance(value, dict):
        return {str(key): round_numbers(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [round_numbers(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else str(value)
    return value


def find_differences(kept: Any, now: Any, where: str) -> Iterator[str]:  # noqa: ANN401
    """Yield a line for each value that differs: where, stored and found."""
    if isinstance(kept, dict) and isinstance(now, dict):
        for key in [*kept, *(key for key in now if key not in kept)]:
            absent = "absent"
            yield from find_differences(
                kept.get(key, absent), now.get(key, absent), f"{where}.{key}"
            )
    elif isinstance(kept, list) and isinstance(now, list) and len(kept) == len(now):
        for index, pair in enumerate(zip(kept, now, strict=True)):
            yield from find_differences(*pair, f"{where}[{index}]")
    elif {type(one) for one in (kept, now)} == {list}:
        gone = [one for one in kept if one not in now]
        new = [one for one in now if one not in kept]
        sizes = f"stored {len(kept)} values, found {len(now)}"
        yield f"{where}: {sizes}; gone {gone!s:.120}, new {new!s:.120}"
    elif not is_equal(kept, now):
        yield f"{where}: stored {shorten(kept)}, found {shorten(now)}"


def is_equal(kept: Any, now: Any) -> bool:  # noqa: ANN401
    """Return whether two values are equal, numbers within the tolerance."""
    if isinstance(kept, float) and isinstance(now, float | int):
        return math.isclose(kept, now, rel_tol=TOLERANCE, abs_tol=1e-9)
    return kept == now


def shorten(value: Any) -> str:  # noqa: ANN401
    """Return a value as text of at most 120 characters."""
    text = f"{len(value)} values" if isinstance(value, dict | list) else repr(value)
    return text if len(text) <= 120 else text[:117] + "..."


def write_answers(answers: Answer) -> None:
    """Write the answers, each value of a check's first level in a line of its own."""
    lines = []
    for name, answer in answers.items():
        rows = answer.items() if isinstance(answer, dict) else ()
        inner = (f"  {json.dumps(key)}: {json.dumps(one)}" for key, one in rows)
        text = ",\n".join(inner)
        text = f"{{\n{text}\n }}" if rows else json.dumps(answer)
        lines.append(f" {json.dumps(name)}: {text}")
    ANSWERS.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


TURNS = 3
CLIPS = 60
STEPS = 1000
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
    rows, _ = run_command(root, *bench)
    made, _ = run_command(root, "generate", folder, "--clips", clips, "--workers", 1)
    path = min(folder.glob("*.mcap"))
    _, memory = run_command(root, "replay", path)
    step = next(row for row in rows["rows"] if row["active"] == 60)
    return {
        "step": step["p50_ms"],
        "clips": made["clips_per_minute"],
        "memory": round(memory, 1),
    }


def run_command(root: Path, *words: object) -> tuple[dict, float]:
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


if __name__ == "__main__":
    sys.exit(main())
