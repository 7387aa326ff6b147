"""`eskin skin show`: how many taxels, how dense, and a picture."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from eskin.robot import Robot
from eskin.skin import Skin, load_robot_for_skin, load_skin

# Poses in which the arm shows its skin well [rad].
POSES = {"ur5": (0.4, -1.3, 1.5, -1.2, -1.3, 0.0)}


@dataclass(frozen=True)
class Command:
    """Show a skin: counts, area and density of each patch, and a picture."""

    skin: tyro.conf.Positional[str]
    """A preset's name, or a folder with skin.yaml."""

    out: Path | None = None
    """Where to write a picture, such as skin.png."""

    robot: str | None = None
    """What wears it: ur5, ur10, base, table, tube or a .urdf file; presets know it."""


def run(command: Command) -> dict[str, object]:
    """Show one skin."""
    skin = load_skin(command.skin)
    robot = load_robot_for_skin(command.skin, command.robot)
    if command.out is not None:
        draw(skin, command.out, robot)
    patches = patch_rows(skin)
    total = summary(skin.areas)
    print_table(skin, patches, total)
    if command.out is not None:
        print(f"picture: {command.out}")
    return {
        "name": skin.name,
        **total,
        "calibrated": skin.calibrated,
        "patches": patches,
        "picture": None if command.out is None else str(command.out),
    }


def draw(skin: Skin, out: Path, robot: Robot | None) -> None:
    """Write the picture, in a pose that shows the skin."""
    from eskin.skin.picture import draw_skin

    pose = POSES.get(robot.name) if robot else None
    draw_skin(skin, out, robot, None if pose is None else np.array(pose))


def summary(areas: np.ndarray) -> dict[str, object]:
    """Count, area and density of some taxels."""
    area = 1e4 * float(areas.sum())
    return {
        "taxels": len(areas),
        "area_cm2": round(area, 3),
        "density_per_cm2": round(len(areas) / area, 4) if area > 0 else 0.0,
    }


def patch_rows(skin: Skin) -> list[dict[str, object]]:
    """What there is to say of each patch."""
    return [
        {
            "id": patch.id,
            "link": patch.link,
            "address": patch.address,
            "rows": patch.rows,
            "columns": patch.columns,
            "kind": patch.kind,
            "units": patch.units,
            **summary(skin.areas[skin.patch_index == number]),
        }
        for number, patch in enumerate(skin.patches)
    ]


def print_table(
    skin: Skin, patches: list[dict[str, object]], total: dict[str, object]
) -> None:
    """Print one line a patch, and the whole."""
    table = Table(title=f"skin {skin.name}", title_justify="left", box=SIMPLE_HEAD)
    for name in ("patch", "link", "grid", "kind"):
        table.add_column(name)
    for name in ("taxels", "cm²", "/cm²"):
        table.add_column(name, justify="right")
    for row in patches:
        grid = f"{row['rows']} x {row['columns']}"
        named = (row["id"], row["link"], grid, row["kind"])
        table.add_row(*map(str, named), *figures(row))
    table.add_section()
    table.add_row("all", "", "", "", *figures(total))
    Console(markup=False).print(table)
    if not skin.calibrated:
        print("geometry and units are nominal: lengths and densities mean little")


def figures(row: dict[str, object]) -> tuple[str, str, str]:
    """Count, area and density as they are printed."""
    return (
        str(row["taxels"]),
        f"{row['area_cm2']:.1f}",
        f"{row['density_per_cm2']:.2f}",
    )
