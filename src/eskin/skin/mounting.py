"""This module finds the robot of a skin, and mounts the skin on it.

The robot of a skin is the one that is given, else the one whose URDF the recording or
the skin's folder keeps, else the one that comes with eskin and that the recording or
the preset names. Every command, source, recording and notebook asks here.
"""

from dataclasses import dataclass
from pathlib import Path

from eskin.errors import RobotError
from eskin.robot import ROBOT_PRESETS, Robot, load_robot
from eskin.robot.urdf import parse_urdf
from eskin.skin.files import ROBOT_URDF, load_skin, read_robot_urdf
from eskin.skin.presets import SKIN_PRESETS
from eskin.skin.skin import MountedSkin, Skin


@dataclass(frozen=True)
class KeptRobot:
    """A kept robot is what a recording, a skin's folder or a preset tells of a robot.

    The name is never used as a path.
    """

    name: str = ""
    """Name of the robot; empty where none is told."""
    urdf: bytes = b""
    """URDF of the robot; empty where none is kept."""
    place: str = ""
    """Where the URDF is, for messages."""


def load_robot_for_skin(
    skin: str | Path | KeptRobot | None,
    robot: str | Path | Robot | None = None,
    *,
    mimics: bool = True,
) -> Robot | None:
    """Load the robot of a skin; return None where nothing says which it is.

    Meshes are read for a robot that is given. Those that a kept URDF names are not: its
    links have primitive shapes only.

    Args:
        skin: a preset's name, a skin's folder, or what a recording keeps of the robot;
            None where nothing is kept.
        robot: the robot that is given: a preset's name, the path of a URDF, or a robot;
            None for the skin's own.
        mimics: whether to read mimic rules; without them every joint has a value.

    Raises:
        RobotError: The robot cannot be used.
        SkinError: The URDF in the skin's folder is missing, or was changed.
    """
    if isinstance(robot, Robot):
        return robot
    if robot is not None:
        return load_robot(robot, mimics=mimics)
    kept = skin if isinstance(skin, KeptRobot) else read_kept_robot(skin)
    if kept.urdf:
        return parse_urdf(kept.urdf, Path(kept.place), mimics=mimics)
    if kept.name in ROBOT_PRESETS:
        return load_robot(kept.name, mimics=mimics)
    return None


def read_kept_robot(skin: str | Path | None) -> KeptRobot:
    """Read what a preset or a skin's folder tells of its robot.

    Raises:
        SkinError: The URDF in the skin's folder is missing, or was changed.
    """
    if skin is None:
        return KeptRobot()
    if str(skin) in SKIN_PRESETS:
        return KeptRobot(SKIN_PRESETS[str(skin)].robot)
    folder = Path(skin)
    urdf = read_robot_urdf(folder) or b""
    return KeptRobot(urdf=urdf, place=str(folder / ROBOT_URDF))


def describe_robot(robot: Robot) -> KeptRobot:
    """Describe a robot as recordings keep it.

    It has no URDF where the robot comes with eskin, so that its name is enough.
    """
    if robot.name in ROBOT_PRESETS and robot.urdf == load_robot(robot.name).urdf:
        return KeptRobot(robot.name)
    return KeptRobot(robot.name, robot.urdf)


def require_robot(robot: Robot | None, told: str) -> Robot:
    """Return a robot that was found.

    Args:
        robot: what `load_robot_for_skin` returned.
        told: what there is in place of a robot, for the message.

    Raises:
        RobotError: None was found.
    """
    if robot is None:
        raise RobotError(
            f"{told}; allowed are a URDF in the skin's folder or in the recording, and "
            f"the robots {', '.join(ROBOT_PRESETS)}; give the robot that wears the "
            "skin, with --robot-urdf in a command and robot= in Python"
        )
    return robot


def mount_skin(
    skin: str | Path | Skin, robot: str | Path | Robot | None = None
) -> MountedSkin:
    """Mount a skin on its robot, both given as objects or by name.

    Args:
        skin: a preset's name, a skin's folder, or a skin.
        robot: a preset's name, a URDF, or a robot; None for the one that
            `load_robot_for_skin` finds, which a skin given as an object does not tell.

    Raises:
        RobotError: The robot of the skin is not known, or cannot be used.
        SkinMismatchError: The robot lacks links of the skin.
        EskinError: The skin cannot be used.
    """
    mounted = skin if isinstance(skin, Skin) else load_skin(skin)
    found = load_robot_for_skin(None if isinstance(skin, Skin) else skin, robot)
    told = f"skin '{mounted.name}' is given without a robot"
    return MountedSkin(mounted, require_robot(found, told))
