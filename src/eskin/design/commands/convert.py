"""`eskin skin convert` converts a skin from and to the formats of other projects."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from eskin.cli.checks import check_folder, check_new
from eskin.cli.guided import say
from eskin.design.formats import FORMATS, ICUB_SUFFIX, SkinFormat
from eskin.errors import RobotError, SkinError
from eskin.robot import Robot, load_urdf
from eskin.skin import SKIN_PRESETS, Skin, load_robot_for_skin, load_skin, save_skin
from eskin.skin.files import MANIFEST
from eskin.units import format_count


@dataclass(frozen=True)
class ConvertSkinCommand:
    """Convert a skin from or to the tactile sensors of a URDF, iCub or GenTact files.

    The format is told by the path: NAME.urdf, NAME.csv of GenTact, NAME.txt or a folder
    of such files of the iCub; any other is a skin's folder, or the name of a preset.
    """

    source: tyro.conf.Positional[str]
    """Skin, or file of another project."""

    out: tyro.conf.Positional[Path]
    """New file or folder; or the skin's own folder, to mount it on another robot."""

    to: SkinFormat | None = None
    """Format to write, where the path does not tell it, as for a folder of iCub files.
    """

    robot_urdf: str | None = None
    """Robot of the skin: a URDF file or a preset's name; by default the skin's own, or
    the one in the .urdf that is read. GenTact files need one with shapes, which give
    the normals; to a .urdf, the sensors are added to its URDF."""

    link: str | None = None
    """Link of all taxels, where the file does not tell it."""

    name: str | None = None
    """Name of the skin; the file's name where none is given."""


def run(command: ConvertSkinCommand) -> dict[str, object]:
    """Read a skin, write it, and return its counts."""
    wanted = command.to or FORMATS.get(command.out.suffix, "skin")
    if wanted == "skin" and is_in_place(command):
        check_folder(command.out)
    else:
        check_new(command.out)
    from eskin.design.formats.gentact import write_gentact
    from eskin.design.formats.icub import write_icub_positions
    from eskin.design.formats.tactile_urdf import write_tactile_urdf

    robot = find_robot(command)
    skin = read_skin(command, robot)
    match wanted:
        case "skin":
            save_skin(skin, command.out, robot)
        case "urdf":
            write_tactile_urdf(command.out, skin, robot)
        case "icub":
            write_icub_positions(command.out, skin)
        case "gentact":
            write_gentact(command.out, skin)
    print(
        f"{command.out}: {format_count(skin.count, 'taxel')} of "
        f"{format_count(len(skin.patches), 'patch')}, on "
        f"{format_count(len(set(skin.link_names)), 'link')}"
    )
    return {
        "out": str(command.out),
        "format": wanted,
        "taxels": skin.count,
        "patches": len(skin.patches),
    }


def is_in_place(command: ConvertSkinCommand) -> bool:
    """Return whether a skin is written to the folder from which it is read."""
    source = Path(command.source)
    folder = source.parent if source.name == MANIFEST else source
    return (
        command.source not in SKIN_PRESETS
        and (folder / MANIFEST).exists()
        and folder.resolve() == command.out.resolve()
    )


def find_robot(command: ConvertSkinCommand) -> Robot | None:
    """Find the robot of the skin that is converted; None where nothing says it.

    A URDF of tactile sensors alone describes no robot, which is said.
    """
    path = Path(command.source)
    if command.robot_urdf is not None or FORMATS.get(path.suffix) != "urdf":
        return load_robot_for_skin(command.source, command.robot_urdf)
    try:
        return load_urdf(path, meshes=False)
    except RobotError as error:
        say(f"without its robot: {error}")
        return None


def read_skin(command: ConvertSkinCommand, robot: Robot | None) -> Skin:
    """Read the skin that is converted.

    Raises:
        SkinError: It cannot be read, or needs the robot.
    """
    from eskin.design.formats.gentact import read_gentact
    from eskin.design.formats.icub import read_icub_positions
    from eskin.design.formats.tactile_urdf import read_tactile_urdf

    path = Path(command.source)
    name = command.name or path.stem
    if command.source in SKIN_PRESETS or (path / MANIFEST).exists():
        return load_skin(command.source)
    files = sorted(path.glob(f"*{ICUB_SUFFIX}")) if path.is_dir() else [path]
    match FORMATS.get(files[0].suffix if files else "", "skin"):
        case "urdf":
            return read_tactile_urdf(path, name)
        case "icub":
            return read_icub_positions(files, name, command.link)
        case "gentact" if robot is not None:
            return read_gentact(path, name, robot, command.link)
        case "gentact":
            raise SkinError(
                f"{path} has no normals; allowed is a robot with shapes, which give "
                "them; name it with --robot-urdf"
            )
    return load_skin(command.source)
