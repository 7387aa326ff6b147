"""`eskin skin design` makes a skin for a robot, and the drawings of its patches."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from eskin.cli.checks import Excludes, Range, check_folder, check_picture
from eskin.design.commands.show import draw_picture
from eskin.errors import ExtraError
from eskin.registry import advise_install
from eskin.robot import Robot, load_robot
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.design.spec import DesignSpec

PACKAGES = {
    "collada": "pycollada",
    "igl": "libigl",
    "manifold3d": "manifold3d",
    "embreex": "embreex",
    "ezdxf": "ezdxf",
    "shapely": "shapely",
    "trimesh": "trimesh",
}
"""Packages of the extra `design`, by the modules that they install."""
MAX_COUNT = 65535


@dataclass(frozen=True)
class DesignCommand:
    """Make a skin for a robot: patches on its links, their taxels and drawings.

    Each link is cut into patches that unroll with little distortion and that one
    board can read. The folder is a skin for every other command. It also holds a DXF,
    an SVG and a table of coordinates of every patch, a sheet of all, and a report.
    """

    robot: tyro.conf.Positional[str]
    """Robot to cover: a .urdf file, or the name of one that comes with eskin."""

    out: Path
    """Folder of the skin."""

    name: str | None = None
    """Name of the skin; the folder's name where none is given."""

    links: Annotated[tuple[str, ...], Excludes("spec")] = ()
    """Links to cover; all that have a shape where none are given."""

    spec: Path | None = None
    """YAML file with regions and keep-out zones, instead of --links."""

    density: Annotated[float, Range(0, 1e4, is_open=True)] = 1.5
    """Density of the taxels where --spec gives none [1/cm2]."""

    min_spacing: Annotated[float, Range(0, 1e3, is_open=True)] = 2.5
    """Smallest spacing of neighbouring taxels [mm]."""

    rows: Annotated[int, Range(2, MAX_COUNT)] = 16
    """Largest number of rows that a readout board reads."""

    columns: Annotated[int, Range(2, MAX_COUNT)] = 16
    """Largest number of columns that a readout board reads."""

    distortion: Annotated[float, Range(0, 1, is_open=True)] = 0.08
    """Largest relative error of the unrolled distance of neighbouring taxels."""

    clearance: Annotated[float, Range(0, 1e3)] = 3.0
    """Smallest distance of the skin from other links, while one joint moves from limit
    to limit [mm]."""

    poses: Annotated[int, Range(0, MAX_COUNT)] = 256
    """Number of poses of all joints at once in which that distance is checked too."""

    clear_poses: bool = False
    """Leave out what is nearer in one of these poses. Without it that is reported
    alone: an arm that can fold onto itself would have half of its skin left."""

    min_taxels: Annotated[int, Range(6, MAX_COUNT)] = 8
    """Smallest number of taxels of a patch."""

    rate: Annotated[float, Range(0, 1e6, is_open=True)] = 100.0
    """Rate at which the skin is read, for the bandwidth [Hz]."""

    seed: int = 0
    """Seed of the positions of the grids."""

    picture: Path | None = None
    """Path of a picture of the robot with its skin, such as skin.png."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""


def run(command: DesignCommand) -> dict[str, object]:
    """Design one skin, write its files, and return its report."""
    check_packages()
    from eskin.design.design import design_skin
    from eskin.design.files import save_design

    check_folder(command.out)
    if command.picture is not None:
        check_picture(command.picture)
    robot = load_robot(command.robot, mimics=not command.no_mimics)
    design = design_skin(robot, build_spec(command, robot), command.seed)
    report = save_design(design, command.out, robot)
    for warning in design.warnings:
        print(f"warning: {warning}")
    print_report(report, command)
    print(f"skin and drawings: {command.out}")
    if command.picture is not None:
        draw_picture(design.skin, command.picture, robot)
        print(f"picture: {command.picture}")
    return report


def check_packages() -> None:
    """Raise where a package of the extra `design` is missing."""
    missing = [name for module, name in PACKAGES.items() if find_spec(module) is None]
    if missing:
        raise ExtraError(
            f"skin design needs {', '.join(missing)}, not installed; allowed is with "
            f"all of the extra; {advise_install('design')}"
        )


def build_spec(command: DesignCommand, robot: Robot) -> "DesignSpec":
    """Build the specification of the options."""
    from eskin.design.spec import (
        MM,
        PER_CM2,
        DesignLimits,
        DesignSpec,
        RegionSpec,
        read_spec,
    )
    from eskin.design.zones import LinkZone

    density = PER_CM2 * command.density
    keep_outs = ()
    if command.spec is not None:
        regions, keep_outs = read_spec(command.spec, density)
    else:
        names = command.links or [link.name for link in robot.links if link.geoms]
        regions = tuple(RegionSpec(LinkZone(name), density) for name in names)
    limits = DesignLimits(
        min_spacing=MM * command.min_spacing,
        max_rows=command.rows,
        max_columns=command.columns,
        max_distortion=command.distortion,
        clearance=MM * command.clearance,
        poses=command.poses,
        clears_poses=command.clear_poses,
        min_taxels=command.min_taxels,
        rate=command.rate,
    )
    name = command.name or command.out.absolute().name
    return DesignSpec(name, regions, keep_outs, limits)


def print_report(report: dict[str, object], command: DesignCommand) -> None:
    """Print one line for each region, and the figures of the whole."""
    table = Table(box=SIMPLE_HEAD)
    table.add_column("link")
    for name in (
        "patches",
        "taxels",
        "/cm²",
        "cm²",
        "allowed",
        "covered",
        "distortion",
    ):
        table.add_column(name, justify="right")
    regions = report["regions"]
    assert isinstance(regions, list)
    for row in regions:
        table.add_row(
            row["link"],
            str(row["patches"]),
            str(row["taxels"]),
            f"{row['density_per_cm2']:.2f}",
            f"{row['area_cm2']:.0f}",
            f"{row['allowed_cm2']:.0f}",
            f"{row['covered_cm2']:.0f}",
            f"{row['distortion_max']:.3f}",
        )
    Console(markup=False).print(table)
    print(
        f"{format_count(report['taxels'], 'taxel')} on "
        f"{format_count(report['boards'], 'patch')}, each with a board; "
        f"{report['covered_cm2']} cm2 covered of {report['allowed_cm2']} allowed and "
        f"{report['area_cm2']} in all; distortion up to {report['distortion_max']}"
    )
    if command.poses:
        print(
            f"in one of {command.poses} poses of all joints at once, within "
            f"{command.clearance:g} mm of another link: "
            f"{format_count(report['taxels_close'], 'taxel')}"
        )
    print(
        f"traces: {report['wiring_m']} m, {report['trace_pitch_mm']} mm apart or more; "
        f"bandwidth at {report['rate_hz']} Hz: {report['bandwidth_mbit_s']} Mbit/s"
    )
