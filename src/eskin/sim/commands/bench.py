"""`eskin bench` times one step of the engine, and throughput from bytes on."""

import math
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from eskin.sim.bench.latency import (
    LatencyConfig,
    LatencyRow,
    measure_latency,
    pin_to_one_core,
)
from eskin.sim.bench.throughput import (
    ThroughputConfig,
    ThroughputResult,
    find_limit,
    measure_throughput,
)


def run_latency(command: LatencyConfig) -> dict[str, object]:
    """Time all scenes, print a table, and return its rows."""
    with pin_to_one_core():
        rows = measure_latency(command)
    print_latency(rows)
    return {"rows": [row.as_dict() for row in rows]}


def print_latency(rows: Sequence[LatencyRow]) -> None:
    """Print the rows as a table."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("name", no_wrap=True)
    for title in ("p50 [ms]", "p99", "max", "taxels", "active", "steps", "ratio"):
        table.add_column(title, justify="right", no_wrap=True)
    for row in rows:
        milliseconds = (format_number(t) for t in (row.p50_ms, row.p99_ms, row.max_ms))
        counts = (str(n) for n in (row.taxels, row.active, row.steps))
        table.add_row(row.name, *milliseconds, *counts, format_number(row.ratio))
    Console().print(table)
    print(f"one core; ratios are to the engine at {rows[0].active} active taxels")


def format_number(number: float) -> str:
    """Format a number with three decimals, or none from 100."""
    return f"{number:.3f}" if number < 100 else f"{number:.0f}"


def run_throughput(command: ThroughputConfig) -> dict[str, object]:
    """Measure each transport in turn, print a table, and return its rows."""
    rows = []
    limits = {}
    for over in command.transports:
        rows.append(measure_throughput(over, command.rate, command.seconds))
        if command.find_limit:
            limits[over] = find_limit(over, command.rate)
    print_throughput(rows, limits)
    return {
        "rate_hz": round(min(row.rate_hz for row in rows), 2),
        "dropped": sum(row.dropped for row in rows),
        "cpu": round(max(row.cpu for row in rows), 4),
        "rows": [row.as_dict() | format_limit(row, limits) for row in rows],
    }


def format_limit(row: ThroughputResult, limits: dict[str, float]) -> dict[str, object]:
    """Return the rate at which a transport first drops readings, if it was searched.

    None means that there is none up to the highest rate.
    """
    if row.over not in limits:
        return {}
    limit = limits[row.over]
    return {"limit_hz": limit if math.isfinite(limit) else None}


def print_throughput(
    rows: Sequence[ThroughputResult], limits: dict[str, float]
) -> None:
    """Print the rows as a table."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for title in ("over", "asked [Hz]", "reached", "dropped", "cpu", "age p50 [ms]"):
        table.add_column(title, justify="right", no_wrap=True)
    for title in ("p99", "max", "detections", *(["limit [Hz]"] if limits else [])):
        table.add_column(title, justify="right", no_wrap=True)
    for row in rows:
        ages = (f"{a:.2f}" for a in (row.age_ms_p50, row.age_ms_p99, row.age_ms_max))
        limit = [f"{limits[row.over]:.0f}"] if limits else []
        table.add_row(
            row.over,
            f"{row.asked_hz:g}",
            f"{row.rate_hz:.1f}",
            str(row.dropped),
            f"{row.cpu:.0%}",
            *ages,
            str(row.detections),
            *limit,
        )
    Console().print(table)
    for row in rows:
        if row.lost:
            lost = ", ".join(f"{key} {count}" for key, count in row.lost.items())
            print(f"{row.over} dropped: {lost}")
    print(
        "cpu is the share of a core of the receiving process; age is the time from the "
        "stamp of a reading until it is recognised"
    )
