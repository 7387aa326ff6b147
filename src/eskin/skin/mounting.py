"""This module finds the robot of a skin, and mounts the skin on it."""

from pathlib import Path

from eskin.errors import SkinMismatchError
from eskin.robot import Robot, load_robot
from eskin.robot.urdf import parse_urdf
from eskin.skin.files import ROBOT_URDF, load_skin, read_robot_urdf
from eskin.skin.presets import SKIN_PRESETS
from eskin.skin.skin import MountedSkin, Skin


def load_robot_for_skin(
    skin: str | Path, robot: str | Path | None = None, *, mimics: bool = True
) -> Robot | None:
    """Load the robot of a skin; return None where nothing says which it is.

    It is the robot that is given, else that of a preset, else the one in the skin's
    folder. Of the last, no meshes are read: its links have primitive shapes only.

    Args:
        skin: a preset's name, or a skin's folder.
        robot: a preset's name, or the path of a URDF; None for the skin's own.
        mimics: whether to read mimic rules; without them every joint has a value.

    Raises:
        RobotError: The robot cannot be used.
        SkinError: The URDF in the skin's folder is missing, or was changed.
    """
    if robot is None and str(skin) in SKIN_PRESETS:
        robot = SKIN_PRESETS[str(skin)].robot
    if robot is not None:
        return load_robot(robot, mimics=mimics)
    urdf = read_robot_urdf(Path(skin))
    if urdf is None:
        return None
    return parse_urdf(urdf, Path(skin) / ROBOT_URDF, mimics=mimics)


def mount_skin(
    skin: str | Path | Skin, robot: str | Path | Robot | None = None
) -> MountedSkin:
    """Mount a skin on its robot, both given as objects or by name.

    Args:
        skin: a preset's name, a skin's folder, or a skin.
        robot: a preset's name, a URDF, or a robot; None for the one that
            `load_robot_for_skin` finds.

    Raises:
        SkinMismatchError: The robot of the skin is not known, or lacks its links.
        EskinError: The skin or its robot cannot be used.
    """
    found = skin if isinstance(skin, Skin) else load_skin(skin)
    if not isinstance(skin, Skin) and not isinstance(robot, Robot):
        robot = load_robot_for_skin(skin, robot)
    elif isinstance(robot, str | Path):
        robot = load_robot(robot)
    if robot is None:
        raise SkinMismatchError(
            f"skin '{found.name}' is given without a robot; allowed are a robot's "
            "name, a URDF or a Robot; give the robot that it is on, with robot= in "
            "Python and --robot-urdf in a command"
        )
    return MountedSkin(found, robot)
