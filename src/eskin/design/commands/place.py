"""`eskin skin place` lays a ready-made matrix on a link of a robot."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from eskin.cli.checks import Range, check_folder, check_picture
from eskin.design.commands.design import MAX_COUNT, check_packages
from eskin.design.commands.show import draw_picture
from eskin.robot import Robot, load_robot
from eskin.skin import Skin, load_skin, save_skin
from eskin.skin.files import MANIFEST
from eskin.units import format_count

MM = 1e-3


@dataclass(frozen=True)
class PlaceCommand:
    """Lay a ready-made matrix on a link, wrapped on its surface.

    The folder is a skin for every other command. Where it is one already, the matrix is
    added to it, or takes the place of the patch of its name.
    """

    robot: tyro.conf.Positional[str]
    """Robot: a .urdf file, or the name of one that comes with eskin."""

    link: str
    """Link that the matrix lies on."""

    rows: Annotated[int, Range(1, MAX_COUNT)]
    """Number of rows of the matrix."""

    columns: Annotated[int, Range(1, MAX_COUNT)]
    """Number of columns of the matrix."""

    pitch_mm: Annotated[float, Range(0, 1e3, is_open=True)]
    """Distance of neighbouring taxels [mm]."""

    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))]
    """Folder of the skin."""

    patch: str | None = None
    """Name of the patch; the link's name where none is given."""

    at: tuple[float, float, float] | None = None
    """Place of its middle in the link's frame [mm]; by default where it fits best."""

    turn: float | None = None
    """Angle from the link's x axis, or its z axis where x points out, to the direction
    in which columns are counted, counter-clockwise from outside [degrees]; by default 0
    or 90, whichever fits better."""

    flip: bool = False
    """Columns are counted from the other side, as of a matrix that lies face down."""

    distortion: Annotated[float, Range(0, 1, is_open=True)] = 0.08
    """Largest relative error of the distance of neighbouring taxels."""

    clearance: Annotated[float, Range(0, 1e3)] = 3.0
    """Smallest distance from other links, while one joint moves from limit to limit
    [mm]."""

    picture: Path | None = None
    """Path of a picture of the robot with its skin, such as skin.png."""

    no_mimics: bool = False
    """Ignore the mimic rules of the URDF: every joint has a value of its own."""


def run(command: PlaceCommand) -> dict[str, object]:
    """Place one matrix, write the skin, and return where its corners are."""
    check_packages()
    from eskin.design.placing import MatrixSpec, place_matrix

    check_folder(command.out)
    if command.picture is not None:
        check_picture(command.picture)
    robot = load_robot(command.robot, mimics=not command.no_mimics)
    at = command.at
    spec = MatrixSpec(
        command.link,
        command.rows,
        command.columns,
        MM * command.pitch_mm,
        command.patch or command.link,
        None if at is None else (MM * at[0], MM * at[1], MM * at[2]),
        None if command.turn is None else float(np.deg2rad(command.turn)),
        command.flip,
        command.distortion,
        MM * command.clearance,
    )
    skin, distortion = place_matrix(robot, spec)
    [patch] = skin.patches
    corners = {
        patch.describe_cell(row, column): [
            round(1e3 * x, 1)
            for x in skin.positions[row * command.columns + column].tolist()
        ]
        for row in sorted({0, command.rows - 1})
        for column in sorted({0, command.columns - 1})
    }
    skin = save_matrix(skin, command.out, robot)
    print(
        f"{command.out}: {format_count(skin.count, 'taxel')} of "
        f"{format_count(len(skin.patches), 'patch')}; distances of '{spec.name}' are "
        f"right to {100 * distortion:.1f} %"
    )
    for name, place in corners.items():
        print(f"  {name} at {', '.join(f'{x:g}' for x in place)} mm of its link")
    if command.picture is not None:
        draw_picture(skin, command.picture, robot)
        print(f"picture: {command.picture}")
    return {
        "out": str(command.out),
        "taxels": skin.count,
        "patches": len(skin.patches),
        "distortion": round(distortion, 4),
        "corners": corners,
    }


def save_matrix(skin: Skin, folder: Path, robot: Robot) -> Skin:
    """Write a matrix on its robot as a skin, or add it to the skin of the folder.

    Returns:
        The skin that was written.
    """
    from eskin.design.placing import add_patch

    skin = replace(skin, name=folder.absolute().name)
    if (folder / MANIFEST).exists():
        skin = add_patch(load_skin(str(folder)), skin)
    save_skin(skin, folder, robot)
    return skin
