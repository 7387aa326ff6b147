"""Measure what seals cost: bytes and time, of the host and of the sender in C."""

import json
import shutil
import subprocess
import tempfile
import timeit
from pathlib import Path
from time import process_time
from typing import NamedTuple

from eskin.drivers import SessionSeal
from eskin.drivers.packet import MAX_PACKET_BYTES, SEAL
from lab.attacks.sealed_line import SealedLine
from lab.tables import format_head, format_row

KEY = bytes(range(32))
VARIANTS: dict[str, tuple[int, bytes | None]] = {
    "version 1": (1, None),
    "version 2": (2, None),
    "version 2 with key": (2, KEY),
}
"""Version and key of each kind of line."""
PATCHES = 9
SCANS = 25
"""Number of scans of one round."""
ROUNDS = 21
"""Number of rounds of each kind, in turn; the fastest is reported, since other work on
the computer only ever makes one slower."""
REPEATS = 2000
"""Number of repeats of what is timed alone."""
SENDER = Path(__file__).with_name("seal_cost.c")
FIRMWARE = Path(__file__).parents[2] / "firmware"


class Cost(NamedTuple):
    """The cost of packets of one kind of line."""

    bytes: float
    """Mean size of a packet [bytes]."""
    seconds: float
    """Time from bytes to the assembled scan, per packet [s]."""


def measure_round(line: SealedLine) -> Cost:
    """Measure some scans of all patches, from bytes to assembled scans."""
    size = packets = 0
    seconds = 0.0
    for _ in range(SCANS):
        made = line.wait_period() + line.build_scan()
        size += sum(map(len, made))
        packets += len(made)
        start = process_time()
        line.deliver(made)
        seconds += process_time() - start
    return Cost(size / packets, seconds / packets)


def measure_host() -> dict[str, Cost]:
    """Measure each kind of line in turn."""
    lines = {
        name: SealedLine(PATCHES, version, key, seed=0)
        for name, (version, key) in VARIANTS.items()
    }
    rounds: dict[str, list[Cost]] = {name: [] for name in lines}
    for _ in range(ROUNDS):
        for name, line in lines.items():
            rounds[name].append(measure_round(line))
    return {
        name: Cost(costs[0].bytes, min(cost.seconds for cost in costs))
        for name, costs in rounds.items()
    }


def measure_check(size: int) -> float:
    """Return the time to check the seal of a packet of some size [s]."""
    seal = SessionSeal(KEY, bytes(range(16)))
    packet = seal.close(b"\2\2" + bytes(size - SEAL.size - 2), 1)
    times = timeit.repeat(lambda: seal.is_valid(packet), number=REPEATS, repeat=21)
    return min(times) / REPEATS


def measure_sender() -> list[dict[str, float]]:
    """Compile the sender in C with -O2; return its times by counts of a packet [s]."""
    compiler = shutil.which("cc")
    if compiler is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "seal_cost"
        sources = [SENDER, FIRMWARE / "eskin_patch.c"]
        flags = ["-std=c99", "-O2", f"-I{FIRMWARE}"]
        subprocess.run([compiler, *flags, *sources, "-o", program], check=True)
        done = subprocess.run([program], check=True, capture_output=True, text=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def print_costs() -> None:
    """Print the costs of the host and of the sender as tables."""
    found = measure_host()
    first = found["version 1"]
    print(format_head(("line", "bytes", "packets a second", "us a packet", "added us")))
    for name, cost in found.items():
        added = 1e6 * (cost.seconds - first.seconds)
        print(
            format_row(
                (
                    name,
                    f"{cost.bytes:.0f}",
                    f"{1 / cost.seconds:,.0f}",
                    f"{1e6 * cost.seconds:.1f}",
                    f"{added:.1f}",
                )
            )
        )
    sizes = ", ".join(
        f"{1e6 * measure_check(size):.1f} us of {size} bytes"
        for size in (100, 300, MAX_PACKET_BYTES)
    )
    print(f"\nthe check of a seal alone: {sizes}\n")
    print(format_head(("counts", "bytes", "sender, C -O2: us", "with seal: us")))
    for row in measure_sender():
        print(
            format_row(
                (
                    f"{row['counts']}",
                    f"{row['bytes']} + {SEAL.size}",
                    f"{row['plain_us']:.2f}",
                    f"{row['sealed_us']:.2f}",
                )
            )
        )
