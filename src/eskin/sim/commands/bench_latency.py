"""`eskin bench latency` times one step of the engine."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from eskin.sim.bench.latency import (
    LatencyConfig,
    LatencyRow,
    measure_latency,
    pin_to_one_core,
)


@dataclass(frozen=True)
class LatencyCommand:
    """Time one step of the engine on one core: touches of several sizes, and none.

    The scene is a touch of the ur5's forearm while the arm moves.
    """

    config: Annotated[LatencyConfig, tyro.conf.arg(name="")]


def run(command: LatencyCommand) -> dict[str, object]:
    """Time all scenes, print a table, and return its rows."""
    with pin_to_one_core():
        rows = measure_latency(command.config)
    print_rows(rows)
    return {"rows": [row.as_dict() for row in rows]}


def print_rows(rows: Sequence[LatencyRow]) -> None:
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
