"""`eskin bench latency` times one step of the engine and of the baselines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from eskin.bench.latency import (
    LatencyConfig,
    LatencyRow,
    measure_latency,
    pin_to_one_core,
)
from eskin.learn.baselines import BASELINES, NETWORKS

UR5_TAXELS = 2112


@dataclass(frozen=True)
class LatencyCommand:
    """Time one step of the engine and of every baseline, on one core, in turn.

    The scene is a touch of the ur5's forearm while the arm moves. Baselines are fitted
    on random clips, which is enough for timing and for nothing else.
    """

    config: Annotated[LatencyConfig, tyro.conf.arg(name="")]

    baselines: tuple[str, ...] | None = None
    """Baselines to time beside the engine: no name means none. By default all of them
    are timed, and none on larger skins."""


def run(command: LatencyCommand) -> dict[str, object]:
    """Time all methods, print a table, and return its rows."""
    config, names = command.config, command.baselines
    if names is None:
        names = (*BASELINES, *NETWORKS) if config.taxels == UR5_TAXELS else ()
    elif config.taxels != UR5_TAXELS and names:
        raise ValueError(
            f"--baselines with --taxels {config.taxels}; allowed are baselines on the "
            f"ur5 skin of {UR5_TAXELS} taxels; leave one of the two out"
        )
    with pin_to_one_core():
        rows = measure_latency(config, names)
    print_rows(rows, config)
    return {"rows": [row.as_dict() for row in rows]}


def print_rows(rows: Sequence[LatencyRow], config: LatencyConfig) -> None:
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
    print(
        f"one core; ratios are to the engine at {config.active} active taxels; "
        f"baselines are fitted on {config.clips} random clips, networks on fewer: "
        "enough for timing only"
    )


def format_number(number: float) -> str:
    """Format a number with three decimals, or none from 100."""
    return f"{number:.3f}" if number < 100 else f"{number:.0f}"
