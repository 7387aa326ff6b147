"""Time a step by the size of the skin, and by the size of the touch.

    python -m lab.scaling --picture docs/pictures/latency.png

The same contact of 60 taxels is timed on skins of 2k to 128k taxels, and contacts of 5
to 160 taxels on the ur5 skin; all in turn on one core in one run.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import tyro
from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter, LogLocator

from eskin.robot import load_robot
from eskin.sim.bench import BenchScene, large_skin
from eskin.sim.bench.latency import (
    LatencyRow,
    TimedEngine,
    build_latency_rows,
    pin_to_one_core,
)
from eskin.sim.bench.scene import find_forearm_taxels
from eskin.skin import MountedSkin
from lab.tables import format_head, format_row

UR5 = 2112
SKINS = (UR5, 8192, 32768, 131072)
ACTIVE = (5, 10, 20, 40, 60, 80, 120, 160)
USUAL = 60
HEADS = ("taxels", "active", "p50 [ms]", "p99 [ms]", "ratio to the first")
# Two colours that are distinct for all colour vision.
BLUE = "#0072b2"
ORANGE = "#d55e00"


@dataclass(frozen=True)
class Command:
    """Time skins and contacts of several sizes."""

    steps: int = 5000
    """Number of steps timed in each row."""
    picture: Path | None = None
    """Path of the picture (.png)."""


def main() -> None:
    """Time, print and draw."""
    command = tyro.cli(Command)
    with pin_to_one_core():
        skins = time_sizes(SKINS, [USUAL] * len(SKINS), command.steps)
        touches = time_sizes([UR5] * len(ACTIVE), ACTIVE, command.steps)
    for title, rows in (
        ("By taxels of the skin", skins),
        ("By active taxels", touches),
    ):
        print(f"\n{title}\n\n{format_head(HEADS)}")
        for row in rows:
            times = (f"{row.p50_ms:.3f}", f"{row.p99_ms:.3f}", f"{row.ratio:.2f} x")
            print(format_row([str(row.taxels), str(row.active), *times]))
    if command.picture is not None:
        draw(touches, skins, command.picture)


def time_sizes(
    taxels: Sequence[int], active: Sequence[int], steps: int
) -> list[LatencyRow]:
    """Time the engine alone on skins and contacts of several sizes, all in turn.

    Args:
        taxels: number of taxels of each skin.
        active: number of active taxels of each contact, on the skin in the same place.
        steps: number of steps timed of each.
    """
    skins = {count: large_skin(count) for count in sorted(set(taxels))}
    robot = load_robot("ur5")
    methods = []
    for count, pressed in zip(taxels, active, strict=True):
        mounted = MountedSkin(skins[count], robot)
        scene = BenchScene(mounted, find_forearm_taxels(mounted.skin, pressed))
        methods.append(TimedEngine("eskin", mounted, scene))
    return build_latency_rows(methods, steps)


def draw(
    touches: Sequence[LatencyRow], skins: Sequence[LatencyRow], path: Path
) -> None:
    """Draw medians and 99th percentiles of both tables."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), sharey=True)
    draw_panel(left, [row.active for row in touches], touches)
    left.set(xlabel="active taxels (ur5 skin)", ylabel="one step [ms]")
    draw_panel(right, [row.taxels for row in skins], skins)
    right.set(xlabel=f"taxels of the skin ({USUAL} active)")
    left.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def draw_panel(axes: Axes, sizes: Sequence[int], rows: Sequence[LatencyRow]) -> None:
    """Draw one panel, with both axes logarithmic."""
    axes.plot(sizes, [row.p50_ms for row in rows], "o-", color=BLUE, label="p50")
    axes.plot(sizes, [row.p99_ms for row in rows], "s--", color=ORANGE, label="p99")
    axes.set(xscale="log", yscale="log")
    axes.set_xticks(sizes, labels=[str(size) for size in sizes])
    axes.minorticks_off()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.grid(alpha=0.3)


if __name__ == "__main__":
    main()
