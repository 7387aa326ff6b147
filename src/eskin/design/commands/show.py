"""`eskin skin show` describes a skin and draws it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from eskin.cli.checks import check_picture
from eskin.cli.guided import say
from eskin.cli.options import ROBOT
from eskin.robot import Robot
from eskin.skin import Skin, load_robot_for_skin, load_skin

# Poses in which the arm shows its skin well [rad].
POSES = {"ur5": (0.4, -1.3, 1.5, -1.2, -1.3, 0.0)}


@dataclass(frozen=True)
class ShowCommand:
    """Show the counts, area and density of each patch of a skin, and draw a picture."""

    skin: tyro.conf.Positional[str]
    """A preset's name, or a folder with skin.yaml."""

    out: Path | None = None
    """Path of the picture to write, such as skin.png."""

    robot_urdf: Annotated[str | None, ROBOT] = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""


def run(command: ShowCommand) -> dict[str, object]:
    """Print the figures of one skin and return them."""
    skin = load_skin(command.skin)
    robot = load_robot_for_skin(
        command.skin, command.robot_urdf, mimics=not command.no_mimics
    )
    if command.out is not None:
        check_picture(command.out)
        say(robot.describe_lacking_meshes("drawn") if robot else "")
        draw_picture(skin, command.out, robot)
    patches = build_patch_rows(skin)
    total = summarise_areas(skin.areas)
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


def draw_picture(skin: Skin, out: Path, robot: Robot | None) -> None:
    """Draw the skin on its robot in a pose that shows it."""
    from eskin.skin.picture import draw_skin

    pose = POSES.get(robot.name) if robot else None
    draw_skin(skin, out, robot, None if pose is None else np.array(pose))


def summarise_areas(areas: np.ndarray) -> dict[str, object]:
    """Return count, area and density of taxels with these areas [m2]."""
    area = 1e4 * float(areas.sum())
    return {
        "taxels": len(areas),
        "area_cm2": round(area, 3),
        "density_per_cm2": round(len(areas) / area, 4) if area > 0 else 0.0,
    }


def build_patch_rows(skin: Skin) -> list[dict[str, object]]:
    """Return the figures of each patch."""
    return [
        {
            "id": patch.id,
            "link": patch.link,
            "address": patch.address,
            "rows": patch.rows,
            "columns": patch.columns,
            "kind": patch.kind,
            "units": patch.units,
            **summarise_areas(skin.areas[skin.patch_index == number]),
        }
        for number, patch in enumerate(skin.patches)
    ]


def print_table(
    skin: Skin, patches: list[dict[str, object]], total: dict[str, object]
) -> None:
    """Print one line for each patch and one for the whole skin."""
    table = Table(title=f"skin {skin.name}", title_justify="left", box=SIMPLE_HEAD)
    for name in ("patch", "link", "grid", "kind"):
        table.add_column(name)
    for name in ("taxels", "cm²", "/cm²"):
        table.add_column(name, justify="right")
    for row in patches:
        grid = f"{row['rows']} x {row['columns']}"
        named = (row["id"], row["link"], grid, row["kind"])
        table.add_row(*map(str, named), *format_areas(row))
    table.add_section()
    table.add_row("all", "", "", "", *format_areas(total))
    Console(markup=False).print(table)
    if not skin.calibrated:
        print("geometry and units are nominal: lengths and densities mean little")


def format_areas(row: dict[str, object]) -> tuple[str, str, str]:
    """Format count, area and density as they are printed."""
    return (
        str(row["taxels"]),
        f"{row['area_cm2']:.1f}",
        f"{row['density_per_cm2']:.2f}",
    )
